"""Figures of the tube about a plan, and of the spectrum of its torque."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.legend import Legend
from reference import angle, direction
from wheels import random_wheels, with_wheels

import jaxplan as jp
from jaxplan.plotting.tracks import NAME, edges, radii
from jaxplan.plotting.tracks import told as tube_name

ROBUST = jp.Robust(attitude_error=np.deg2rad(0.8), joint_error=np.deg2rad(0.4))


@pytest.fixture(scope="module")
def bare():
    return jp.plan(jp.paper_case(2), progress=False)


@pytest.fixture(scope="module")
def plan(bare):
    """A plan as it is drawn where the scenario asks for a tube."""
    return replace(bare, scenario=replace(bare.scenario, robust=ROBUST))


@pytest.fixture(scope="module")
def on_wheels():
    return jp.plan(with_wheels(random_wheels(3, seed=1)), progress=False)


def told(axes):
    """All texts of the legends of a figure, of which long ones are broken."""
    texts = [text for legend in axes.figure.findobj(Legend) for text in legend.get_texts()]
    return [" ".join(text.get_text().split()) for text in texts]


def test_edges_of_a_tube_are_its_radius_off_the_track_and_close_about_its_ends():
    track = direction(np.linspace(0.2, 1.4, 200), 0.3 * np.sin(np.linspace(0, 4, 200)))
    left, right, first, last = edges(track, 0.02)
    for line in (left, right):
        apart = np.min(angle(line[:, None], track[None]), axis=1)
        np.testing.assert_allclose(apart, 0.02, rtol=2e-3)
    for end, line in ((track[0], first), (track[-1], last)):
        np.testing.assert_allclose(angle(line, end), 0.02, rtol=1e-9)
    (still,) = edges(np.tile(track[:1], (5, 1)), 0.02)
    np.testing.assert_allclose(angle(still, track[0]), 0.02, rtol=1e-9)


def test_figures_draw_the_tube_only_where_there_is_one(plan, bare):
    swing = 2 * np.arccos(np.cos(ROBUST.joint_error / 2) ** 2)
    np.testing.assert_allclose(radii(plan.scenario), ROBUST.attitude_error + swing, rtol=1e-9)
    assert not np.any(radii(bare.scenario))
    for draw in (jp.plot.sphere, jp.plot.globe):
        with_tube, without = draw(plan), draw(bare)
        assert f"{NAME}, ±1.37 deg" in told(with_tube)  # 0.8 deg and 2 arccos(cos(0.2 deg)^2)
        assert NAME not in "".join(told(without))
        assert len(with_tube.lines) > len(without.lines)
    with_tube, without = jp.plot.angles(plan), jp.plot.angles(bare)
    assert f"{NAME}, ±0.4 deg" in told(with_tube[0])
    assert NAME not in "".join(told(without[0]))
    assert [len(axes.collections) for axes in with_tube] > [len(axes.collections) for axes in without]
    for axes, count in ((jp.plot.joint_map(plan)[0], 1), (jp.plot.joint_map(bare)[0], 0)):
        assert len(axes.findobj(PatchCollection)) == count
    plt.close("all")


def test_a_tube_has_the_radii_of_all_devices_in_its_name(plan):
    camera = jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0]))
    craft = replace(plan.scenario.spacecraft, instruments=(camera,))
    thin = jp.Robust(attitude_error=np.deg2rad(0.1), joint_error=np.deg2rad(0.02))
    scenario = replace(plan.scenario, spacecraft=craft, robust=thin)
    assert tube_name(radii(scenario)).split("\n") == [f"{NAME},", "±0.1 to 0.128 deg"]


def test_a_limit_less_the_reserve_is_told_apart_from_the_whole_one(on_wheels):
    kept = jp.Robust(torque_reserve=25.0)
    reserved = replace(on_wheels, scenario=replace(on_wheels.scenario, robust=kept))
    torques, momenta = jp.plot.torque(reserved)
    whole = {one.torque for one in on_wheels.scenario.spacecraft.wheels}
    drawn = {
        round(abs(float(line.get_ydata()[0])), 9) for line in torques.lines if len(line.get_xdata()) == 2
    }
    assert drawn == {round(share * own, 9) for own in whole for share in (0.75, 1.0)}
    assert {"limit", "limit less the reserve"} <= set(told(torques))
    for other in (jp.plot.torque(on_wheels)[0], momenta):
        lines = [line for line in other.lines if len(line.get_xdata()) == 2]
        assert len(lines) <= 2 * len(whole)
    assert "limit less the reserve" not in told(jp.plot.torque(on_wheels)[0])
    plt.close("all")


def test_a_spectrum_has_units_and_the_value_at_each_frequency(bare, on_wheels):
    (axes,) = jp.plot.spectrum(bare, [0.05, 0.5])
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert axes.get_ylabel() == "angular acceleration\n(deg/s)"  # there is no inertia
    assert axes.get_xlabel() == "frequency (Hz)"
    craft = bare.scenario.spacecraft
    found = np.rad2deg(jp.measures.torque_spectrum(bare.trajectory, craft, [0.05, 0.5]))
    for frequency, own in zip((0.05, 0.5), found, strict=True):
        assert f"{frequency:g} Hz: {np.linalg.norm(own):.3g} deg/s (vector's length)" in told(axes)
    platform, wheels = jp.plot.spectrum(on_wheels, [0.5])
    assert platform.get_ylabel() == "torque\n(N m s)"
    assert wheels.get_ylabel() == "wheel torques\n(N m s)"
    craft = on_wheels.scenario.spacecraft
    own = jp.measures.torque_spectrum(on_wheels.trajectory, craft, [0.5], of="wheel_torques")
    assert f"0.5 Hz: {np.max(own):.3g} N m s (largest wheel)" in told(platform)
    assert len(wheels.lines) == 4  # three wheels and the frequency
    names = [name for name, _ in jp.plot.figures(on_wheels)]
    assert "spectrum" not in names
    plt.close("all")


@pytest.mark.parametrize("inertia", [None, np.eye(3)])
def test_a_spectrum_of_a_platform_that_does_not_turn_is_zero(inertia):
    craft = replace(jp.paper_case(2).spacecraft, inertia=inertia)
    start = jp.paper_case(2).start
    goal = replace(start, joints=np.asarray(start.joints) - 0.1)
    plan = jp.plan(jp.Scenario(name="arms", spacecraft=craft, start=start, goal=goal), progress=False)
    (axes,) = jp.plot.spectrum(plan, [0.5])
    axes.figure.canvas.draw()  # warnings are errors
    assert not np.any([line.get_ydata() for line in axes.lines[:3]])
    assert axes.get_ylim()[0] == 0
    plt.close("all")


def test_frequencies_that_are_none_are_refused(bare):
    for wrong in ([0.0], -1.0, [np.nan], [[0.5]], ["a"]):
        for draw in (jp.plot.spectrum, lambda *given: list(jp.plot.figures(*given))):
            with pytest.raises(ValueError, match=r"frequencies = .* must be positive numbers of Hz"):
                draw(bare, wrong)
