"""Fields of view in exported kernels, as CSPICE finds what is in them."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from exports import EPOCH, load
from reference import field_margins, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp

spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
pytest.importorskip("erfa", reason="pyerfa is not installed")

AU = 1.495978707e8  # km
SUN_IS = {"telescope": "JAXPLAN_TELESCOPE", "terminal-1": "JAXPLAN_TERMINAL_1"}


@pytest.fixture(autouse=True)
def _empty_pool():
    spice.kclear()
    yield
    spice.kclear()


def scene(device, ahead, kept):
    """The Sun is in the way of a field, to whose middle the straight motion brings it; kept away or not."""
    own = make_scenario(2, 1, turn=(0.0, 0.0, 1.2), seed=3)
    telescope = jp.Instrument(
        name="telescope",
        boresight=np.array([0.8, 0.0, 0.6]),
        up=unit(np.array([-0.6, 0.3, 0.8])),
        field_of_view=np.deg2rad([14.28, 9.0]),
    )
    terminals = tuple(
        replace(one, field_of_view=np.deg2rad([8.0, 5.0]), up=unit(np.array([0, -0.4, 1.0])))
        for one in own.spacecraft.terminals
    )
    craft = replace(own.spacecraft, terminals=terminals, instruments=(telescope,))
    halfway = own.start.attitude @ Rotation.from_rotvec([0, 0, 0.6]).as_matrix()
    joints = (own.start.joints + own.goal.joints) / 2
    number = craft.device_names.index(device)
    sun = unit(craft.boresights(halfway, joints)[number] + ahead * (halfway @ [0, 0, 1.0]))
    zone = jp.KeepOut(
        name="sun", direction=sun, half_angle=np.deg2rad(1.0), outside="field_of_view", devices=(device,)
    )
    return replace(own, spacecraft=craft, keep_out=(zone,) if kept else ()), sun


def with_sun(folder, direction, start, last):
    """Load an export, and an ephemeris in which the Sun stands still in a direction from the spacecraft."""
    moment = load(folder)
    path = str(folder.parent / "sun.bsp")
    handle = spice.spkopn(path, "test", 0)
    span = moment + start - 100, moment + last + 100
    times = np.linspace(*span, 4)
    for body, place in ((-999, np.zeros(3)), (10, AU * direction)):
        states = np.tile([*place, 0.0, 0.0, 0.0], (4, 1))
        spice.spkw13(handle, body, 0, "J2000", *span, f"of {body}", 3, 4, states, times)
    spice.spkcls(handle)
    spice.furnsh(path)
    return moment


def found_in(device, moment, last):
    """(k, 2) s, from when to when CSPICE sees the Sun in a field."""
    window, result = spice.cell_double(2), spice.cell_double(200)
    spice.wninsd(moment, moment + last, window)
    spice.gftfov(SUN_IS[device], "SUN", "POINT", "", "NONE", "-999", 0.2, window, result)
    count = spice.wncard(result)
    return np.array([spice.wnfetd(result, i) for i in range(count)]).reshape(-1, 2) - moment


@pytest.mark.slow
@pytest.mark.parametrize("device", SUN_IS)
@pytest.mark.parametrize("ahead", [0.0, 0.05, -0.04])
def test_cspice_sees_no_sun_where_none_is_certified_and_sees_it_where_we_tell_of_a_breach(
    device, ahead, tmp_path
):
    for kept in (True, False):
        own, sun = scene(device, ahead, kept)
        plan = jp.plan(own, progress=False)
        assert plan.ok, plan.message
        folder = jp.export(plan, tmp_path / f"kept-{kept}", format="ck", epoch=EPOCH, step_s=0.02)
        assert (folder / "instruments.ti").exists()
        last = plan.trajectory.duration
        spice.kclear()
        seen = found_in(device, with_sun(folder, sun, 0.0, last), last)
        (tmp_path / "sun.bsp").unlink()
        if kept:
            assert plan.certificate.certified
            assert plan.certificate.min_margin >= 0
            assert len(seen) == 0
            continue
        craft = own.spacecraft
        of = craft.devices[craft.device_names.index(device)]
        times = np.linspace(0, last, 20001)
        at = plan.trajectory.sample(times)
        inside = np.array(
            [_beyond(craft, of, a, q, sun) < 0 for a, q in zip(at.attitude, at.joints, strict=True)]
        )
        assert inside.any()
        edges = times[np.flatnonzero(np.diff(inside.astype(int)))]
        np.testing.assert_allclose(np.ravel(seen), edges, atol=last / 20000 + 0.01)
        warned, _ = scene(device, ahead, True)
        broken = jp.certify(replace(plan, scenario=replace(warned, name=plan.scenario.name)))
        assert not broken.certified
        assert any(device in fault and "too close to the zone sun at t" in fault for fault in broken.faults)


def _beyond(craft, device, attitude, joints, sun):
    """rad, how far the Sun is beyond the field of a device in a state; below zero within."""
    if device in craft.instruments:
        forward, up = device.boresight, device.up
    else:
        number, count = craft.terminals.index(device), len(craft.terminals)
        turn = Rotation.from_euler("ZY", [joints[number] + device.mount, -joints[count + number]])
        forward, up = turn.apply([1.0, 0, 0]), turn.apply(device.up)
    parts = [attitude @ own @ sun for own in (forward, np.cross(up, forward), up)]
    return field_margins(device, np.array(parts)[:, None])[0][0]
