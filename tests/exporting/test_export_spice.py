"""Exported kernels as CSPICE reads them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_scenario
from exports import DURATION, EPOCH, LEAP_SECONDS, Truth, differences, flown_plan, load, truth
from oblique import oblique_scenario
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.epochs import ephemeris_time

spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
pytest.importorskip("erfa", reason="pyerfa is not installed")

STEP = 0.05
TIMES = STEP * np.arange(601)


@pytest.fixture(autouse=True)
def _empty_pool() -> Iterator[None]:
    """SPICE keeps one pool of kernels for the whole process."""
    spice.kclear()
    yield
    spice.kclear()


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def kernels(plan, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("exports") / "slew.ck"
    return jp.export(plan, place, format="ck", epoch=EPOCH, step_s=STEP)


@pytest.fixture(scope="module")
def expected(plan) -> Truth:
    return truth(plan, TIMES)


def turns(base: str, frame: str, moments: np.ndarray) -> np.ndarray:
    """(k, 3, 3) frame to base."""
    return np.stack([spice.pxform(frame, base, moment) for moment in moments])


def test_the_kernels_hold_the_attitude_and_its_rate(kernels, expected):
    moments = load(kernels) + TIMES
    assert sorted(file.name for file in kernels.iterdir()) == ["attitude.bc", "clock.tsc", "frames.tf"]
    np.testing.assert_allclose(turns("J2000", "JAXPLAN_BUS", moments), expected.attitude, atol=1e-9)
    # SPICE's derivative of the inverse rotation, d(R^T)/dt = -w^ R^T in body axes
    for moment, attitude, rate in list(zip(moments, expected.attitude, expected.rate, strict=True))[::20]:
        slope = spice.sxform("J2000", "JAXPLAN_BUS", moment)[3:, :3]
        hat = np.cross(np.eye(3), rate)
        np.testing.assert_allclose(slope, -hat @ attitude.T, atol=1e-8)


def test_terminals_turn_on_the_bus_and_instruments_are_fixed_to_it(kernels, expected):
    moments = load(kernels) + TIMES
    names = ["JAXPLAN_TERMINAL_0", "JAXPLAN_TERMINAL_1", "JAXPLAN_INSTRUMENT_0"]
    for device, name in enumerate(names):
        seen = turns("J2000", name, moments)[:, :, 2]
        np.testing.assert_allclose(seen, expected.boresights[:, device], atol=1e-9)
    for name in names[:2]:
        on_bus = turns("JAXPLAN_BUS", name, moments)
        spins = differences(on_bus, STEP)
        rates = [spice.xf2rav(spice.sxform("JAXPLAN_BUS", name, moment))[1] for moment in moments[1:-1]]
        in_frame = np.einsum("kji,kj->ki", on_bus[1:-1], rates)  # SPICE hands them out in base components
        np.testing.assert_allclose(in_frame, spins, atol=1e-3)
        assert np.abs(np.array(rates) - spins).max() > 0.05  # so a mixed-up frame would show


@pytest.fixture(scope="module")
def odd_plan() -> jp.Plan:
    """A plan whose spacecraft has terminals mounted in any way, and drives."""
    plan = jp.plan(oblique_scenario(2, 2, 1, seed=4, kinds=(), turn=0.5), progress=False)
    assert plan.ok, plan.message
    return plan


def test_frames_of_devices_at_odd_mounts_are_those_of_turns_about_their_axes(odd_plan, tmp_path):
    craft, duration = odd_plan.scenario.spacecraft, odd_plan.trajectory.duration
    step = duration / 400
    start = load(jp.export(odd_plan, tmp_path / "odd.ck", format="ck", epoch=EPOCH, step_s=step))
    times = step * np.arange(401)
    own = truth(odd_plan, times)
    yaws, pitches, angles = np.split(own.joints[0], [2, 4], axis=1)
    count = 0
    for number, terminal in enumerate(craft.terminals):
        up, ahead = np.array(terminal.mounting.yaw_axis), np.array(terminal.mounting.boresight)
        turn = Rotation.from_rotvec(np.outer(yaws[:, number], up))
        turn *= Rotation.from_rotvec(np.outer(-pitches[:, number], np.cross(up, ahead)))
        # at zero angles the z axis of the frame is the boresight, and y to the left of it
        base = np.stack([-up, np.cross(up, ahead), ahead], axis=-1)
        chain = own.attitude @ turn.as_matrix() @ base
        seen = turns("J2000", f"JAXPLAN_TERMINAL_{number + 1}", start + times)
        np.testing.assert_allclose(seen, chain, rtol=0, atol=1e-9)
        count += 1
    for number, drive in enumerate(craft.drives):
        up, ahead = np.array(drive.axis), np.array(drive.boresight)
        turn = Rotation.from_rotvec(np.outer(angles[:, number], up))
        left = np.cross(up, ahead) / np.linalg.norm(np.cross(up, ahead))
        base = np.stack([np.cross(left, ahead), left, ahead], axis=-1)
        chain = own.attitude @ turn.as_matrix() @ base
        seen = turns("J2000", f"JAXPLAN_DRIVE_{number + 1}", start + times)
        np.testing.assert_allclose(seen, chain, rtol=0, atol=1e-9)
        on_bus = turns("JAXPLAN_BUS", f"JAXPLAN_DRIVE_{number + 1}", start + times)
        rate = spice.xf2rav(spice.sxform("JAXPLAN_BUS", f"JAXPLAN_DRIVE_{number + 1}", start + times[200]))[1]
        spin = differences(on_bus, step)[199]
        np.testing.assert_allclose(on_bus[200].T @ rate, spin, atol=1e-3)
        count += 1
    assert count == 4
    tracker = turns("J2000", "JAXPLAN_CAMERA_1", start + times)[:, :, 2]
    np.testing.assert_allclose(tracker, own.attitude @ craft.instruments[0].boresight, rtol=0, atol=1e-9)


def test_the_coverage_begins_and_ends_with_the_manoeuvre(kernels):
    start = load(kernels)
    for number in (-999000, -999001, -999002):
        window = spice.ckcov(
            str(kernels / "attitude.bc"), number, True, "INTERVAL", 0.0, "TDB", spice.cell_double(2)
        )
        np.testing.assert_allclose(list(window), [start, start + DURATION], atol=2e-6)
    with pytest.raises(spice.utils.exceptions.SpiceNOFRAMECONNECT):
        spice.pxform("J2000", "JAXPLAN_BUS", start - 0.01)


@pytest.mark.parametrize("date", ["1972-06-30T12:00:00", "2017-01-01T00:00:00", EPOCH, "2080-07-05T01:02:03"])
def test_ephemeris_times_are_those_of_spice(date):
    lines = LEAP_SECONDS.replace("35, @2012", "10, @1972-JAN-1, 11, @1972-JUL-1, 35, @2012")
    spice.lmpool(lines.split("\n")[1:-1])
    assert abs(ephemeris_time(np.datetime64(date, "ns")) - spice.str2et(date)) < 1e-6


def test_the_pool_is_left_as_it_was(plan, tmp_path):
    spice.pdpool("FRAME_-999001_CLASS", [4.0])
    spice.pcpool("FRAME_-999001_NAME", ["MINE"])
    spice.pdpool("SOMETHING_ELSE", [1.0, 2.0])
    jp.export(plan, tmp_path / "slew.ck", format="ck", epoch=EPOCH, step_s=STEP)
    assert spice.gdpool("FRAME_-999001_CLASS", 0, 5).tolist() == [4.0]
    assert list(spice.gcpool("FRAME_-999001_NAME", 0, 5)) == ["MINE"]
    assert spice.gdpool("SOMETHING_ELSE", 0, 5).tolist() == [1.0, 2.0]
    left = spice.gnpool("*", 0, 100)
    assert sorted(left) == ["FRAME_-999001_CLASS", "FRAME_-999001_NAME", "SOMETHING_ELSE"]
    assert spice.ktotal("ALL") == 0


def test_kernels_of_several_manoeuvres_can_be_loaded_at_once(plan, kernels, tmp_path):
    later = jp.export(plan, tmp_path / "later", format="ck", epoch="2026-03-02T00:00:00", step_s=STEP)
    start = load(kernels)
    assert load(later) == start
    first, second = (spice.str2et(date) + 10.0 for date in (EPOCH, "2026-03-02T00:00:00"))
    attitudes = turns("J2000", "JAXPLAN_BUS", np.array([first, second]))
    np.testing.assert_allclose(
        attitudes, np.stack([truth(plan, np.array([10.0])).attitude[0]] * 2), atol=1e-6
    )


def test_a_manoeuvre_that_takes_no_time_is_a_second_at_rest(tmp_path):
    scenario = make_scenario(2, 1)
    resting = jp.plan(replace(scenario, goal=scenario.start))
    place = jp.export(resting, tmp_path / "rest", format="ck", epoch=EPOCH)
    start = load(place)
    for attitude in turns("J2000", "JAXPLAN_BUS", start + np.array([0, 0.5, 1])):
        np.testing.assert_allclose(attitude, resting.goal.attitude, atol=1e-9)
    proof = jp.certify_table(place, None, resting.scenario)
    assert proof.certified
    assert not proof.misses_goal


@pytest.mark.slow
def test_a_hundred_thousand_samples_are_written_and_read(plan, tmp_path):
    step = DURATION / 1e5
    start = load(jp.export(plan, tmp_path / "long", format="ck", epoch=EPOCH, step_s=step))
    times = step * np.linspace(0, 100_000, 40).astype(int)
    attitude = turns("J2000", "JAXPLAN_BUS", start + times)
    np.testing.assert_allclose(attitude, truth(plan, times).attitude, atol=1e-9)


def test_awkward_names_of_devices_become_names_of_frames(plan, tmp_path):
    craft = plan.scenario.spacecraft
    names = ["bus", "a terminal with a name that is long: \u03b1/\u03b2"]
    terminals = tuple(replace(t, name=name) for t, name in zip(craft.terminals, names, strict=True))
    instruments = (replace(craft.instruments[0], name="no-1"),)
    craft = replace(craft, terminals=terminals, instruments=instruments)
    odd = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    start = load(jp.export(odd, tmp_path / "odd", format="ck", epoch=EPOCH, step_s=STEP))
    expected = truth(odd, TIMES).boresights[0]
    for name, boresight in zip(["DEVICE_1", "DEVICE_2", "NO_1"], expected, strict=True):
        seen = turns("J2000", f"JAXPLAN_{name}", np.array([start]))[0, :, 2]
        np.testing.assert_allclose(seen, boresight, atol=1e-9)
