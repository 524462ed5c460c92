"""Tables beside plans in one figure: turns, differences and rates against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_plan, make_spacecraft
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.trajectory import Trajectory

RATE, END = np.deg2rad(12.0), 20.0
TIMES = np.array([0.0, 5.0, 12.0, END])


def spinning(joints: int = 6, rate: float = RATE) -> Trajectory:
    """A turn about body z at a constant rate, to 240 deg, while the first joint falls."""
    coefficients, of_joints = np.zeros((1, 2, 3)), np.zeros((1, 2, joints))
    coefficients[0, :, 2] = rate * END / 2
    of_joints[0, :, 0] = -0.1  # from 0 to -0.2 rad
    return Trajectory(
        breaks=np.array([0.0, END]),
        chart_attitude=np.eye(3)[None],
        chart_start=np.zeros(1),
        chart_rate=np.array([[0.0, 0.0, rate]]),
        coefficients=coefficients,
        joint_breaks=np.array([0.0, END]),
        joint_coefficients=of_joints,
        node_times=np.array([0.0, END]),
        smoothness=2,
        method="global",
    )


def table(angles: np.ndarray, times: np.ndarray = TIMES, **more) -> jp.AttitudeTable:
    """Rows of turns about body z by angles, rad."""
    turned = Rotation.from_rotvec(np.outer(angles, [0, 0, 1.0])).as_quat()
    return jp.AttitudeTable(times=times, quaternions=np.roll(turned, 1, axis=1), **more)


def lines(axes: Axes) -> list[np.ndarray]:
    """The curves of a panel, (2, k) each; lines across it are none."""
    return [line.get_xydata().T for line in axes.lines if list(line.get_xdata()) != [0, 1]]


def test_turns_differences_and_rates_stand_at_their_values():
    late = 0.2 * np.array([0.0, 1.0, -1.0, 0.0])  # rad, by which the rows are off
    own = table(RATE * TIMES + late)
    panels = jp.plot.compare({"plan": spinning(), "table": own}, make_spacecraft())
    assert [axes.get_ylabel() for axes in panels[::4]] == [
        "turned from the start\n(deg)",
        "off plan\n(deg)",
        "rate\n(deg/s)",
    ]
    of_plan, of_table = lines(panels[2])  # without a jump at half a turn
    np.testing.assert_allclose(of_plan[1], np.rad2deg(RATE) * of_plan[0], atol=1e-7)
    between = np.interp(of_table[0], TIMES, np.rad2deg(late))  # a turn about one axis is linear in time
    np.testing.assert_allclose(of_table[1], np.rad2deg(RATE) * of_table[0] + between, atol=1e-7)
    of_plan, of_table = lines(panels[6])
    np.testing.assert_allclose(of_plan[1], 0.0, atol=1e-9)
    np.testing.assert_allclose(of_table[1], np.interp(of_table[0], TIMES, np.rad2deg(late)), atol=1e-7)
    of_plan, of_table = lines(panels[10])
    slopes = np.rad2deg(RATE + np.diff(late) / np.diff(TIMES))
    row = np.searchsorted(TIMES[1:-1], of_table[0], side="right")
    np.testing.assert_allclose(of_table[1], slopes[row], atol=1e-7)
    assert np.diff(of_table[0])[np.searchsorted(of_table[0], 5.0) - 1] < 1e-12  # both sides of a row
    for panel in (0, 1, 4, 5, 8, 9):
        assert all(np.max(np.abs(values)) < 1e-7 for _, values in lines(panels[panel]))


def test_a_joint_is_drawn_as_far_as_it_is_known():
    craft = make_spacecraft()
    named = [name.replace(" ", "_") for name in craft.joint_names]
    joints = np.zeros((4, len(named)))
    joints[:, 0] = -0.2 * TIMES / END
    joints[:, 3] = [0.0, 0.1, 0.1, 0.0]  # which is still in the plan
    order = [4, 2, 3, 0, 1, 5]
    known = table(RATE * TIMES, joints=joints[:, order], joint_names=tuple(named[number] for number in order))
    panels = jp.plot.compare({"plan": spinning(), "with": known, "bare": table(RATE * TIMES)}, craft)
    assert panels[3].get_title() == craft.joint_names[3]
    assert panels[3].get_ylabel() == "angle (deg)"
    assert [len(lines(panels[number])) for number in (3, 7, 11)] == [2, 2, 2]  # not of the bare table
    of_plan, of_table = lines(panels[7])
    np.testing.assert_allclose(of_plan[1], 0.0, atol=1e-9)
    expected = np.rad2deg(np.interp(of_table[0], TIMES, joints[:, 3]))
    np.testing.assert_allclose(of_table[1], expected, atol=1e-9)
    times, rates = lines(panels[11])[1]
    np.testing.assert_allclose(rates[(times > 5) & (times < 12)], 0.0, atol=1e-7)
    np.testing.assert_allclose(rates[times < 5 - 1e-9], np.rad2deg(0.02), atol=1e-7)
    nothing = jp.plot.compare({"one": table(RATE * TIMES), "other": table(RATE * TIMES)}, craft)
    assert len(nothing) == 9  # of joints nothing is known


def test_the_legend_says_what_each_motion_is():
    plan = make_plan(duration=30.0)
    times = np.linspace(0.0, 30.0, 31)
    values = plan.trajectory.sample(times)
    turned = Rotation.from_matrix(values.attitude).as_quat()
    flown = jp.AttitudeTable(
        times=times,
        quaternions=np.roll(turned, 1, axis=1),
        angular_velocity=values.angular_velocity,
        interpolation="hermite",
    )
    rows = table(0.01 * TIMES)
    panels = jp.plot.compare({"mine": plan, "theirs": flown, "rest": plan.trajectory, "spin": rows})
    told = [text.get_text() for text in panels[3].get_legend().get_texts()]
    assert told[:4] == [
        f"mine\n({'certified plan' if plan.ok else f'plan, {plan.status.value}'})",
        "theirs\n(table, 31 rows, hermite)",
        "rest\n(trajectory)",
        "spin\n(table, 4 rows, slerp)",
    ]
    off = np.concatenate([lines(axes)[1][1] for axes in panels[4:7]])
    assert 0 < np.max(np.abs(off)) < 0.05  # deg: a cubic over a second is close
    assert len(jp.plot.compare({"mine": plan, "same": plan}, legend=False)) == 12  # plans alone, as before


def test_tables_with_an_epoch_stand_at_their_times():
    plan = make_plan(duration=30.0)
    epoch = np.datetime64("2026-01-01T00:00:00", "ns")
    dated = replace(plan, scenario=replace(plan.scenario, epoch=epoch))
    later = table(0.01 * TIMES, times=TIMES + 1.0, epoch=epoch + np.timedelta64(4, "s"))
    for scene, begin in ((dated, 5.0), (plan, 0.0)):
        panels = jp.plot.compare({"plan": scene, "table": later})
        times = lines(panels[4])[1][0]
        assert (times[0], times[-1]) == pytest.approx((begin, begin + END))
    panels = jp.plot.compare({"table": later, "plan": dated})  # what is off it is told while it is there
    times, off = lines(panels[4])[1]
    assert np.array_equal(np.isfinite(off), (times >= 5) & (times <= 25))


def test_what_cannot_be_compared_is_refused():
    rows = table(RATE * TIMES)
    failed = replace(make_plan(), trajectory=None)
    for given, craft, error, words in (
        ({}, make_spacecraft(), ValueError, "there are no trajectories"),
        ({"one": rows}, None, ValueError, "spacecraft: missing, whose limits are meant"),
        ({"one": rows}, 3, TypeError, "spacecraft must be a Spacecraft, not int"),
        ({"one": rows, "two": "slew.aem"}, make_spacecraft(), TypeError, r"trajectories\['two'\] must be"),
        ([rows], make_spacecraft(), TypeError, "trajectories must be a dict by names"),
        (
            {"one": rows, "two": failed},
            None,
            ValueError,
            r"trajectories\['two'\]: the plan has no trajectory",
        ),
    ):
        with pytest.raises(error, match=words):
            jp.plot.compare(given, craft)
