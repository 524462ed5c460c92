"""Exports that are held against the scene as their readers fly them, and those with few rows."""

from dataclasses import replace

import numpy as np
import pytest
from exports import EPOCH, flown_day, flown_plan
from reference import assert_each, random_units
from scipy.spatial.transform import Rotation, Slerp

import jaxplan as jp
from jaxplan.tables import sampled
from jaxplan.tables.table import column_name

DENSE = np.linspace(0, 30, 20_001)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.mark.parametrize("format", ["csv", "basilisk", "aem"])
@pytest.mark.parametrize("tolerance", [None, 0.2, 0.005])
def test_the_sparsest_table_is_as_near_as_asked_for_with_few_rows(plan, tmp_path, format, tolerance):
    if format == "aem":
        pytest.importorskip("ccsds_ndm")
    file = jp.export(
        plan, tmp_path / "few", format=format, step_s="sparsest", tolerance_deg=tolerance, epoch=EPOCH
    )
    table = jp.load_attitude(file)
    allowed = np.deg2rad(tolerance or 0.05)
    quaternions, joints = sampled(table, table.interpolation, DENSE)
    truth = plan.trajectory.sample(DENSE)
    turn = Rotation.from_quat(quaternions, scalar_first=True).inv() * Rotation.from_matrix(truth.attitude)
    assert_each(turn.magnitude(), "<=", allowed)
    if joints is not None:
        order = [table.joint_names.index(column_name(name)) for name in plan.scenario.spacecraft.joint_names]
        assert_each(np.abs(joints[:, order] - truth.joints).max(axis=1), "<=", allowed)
    assert table.times[0] == 0
    assert table.times[-1] == pytest.approx(30.0, abs=1e-6)
    if tolerance is None:
        assert len(table.times) <= 300 / 2  # of a manoeuvre that wiggles all the time


def test_fewer_rows_than_the_sparsest_tables_would_not_do(plan, tmp_path):
    """Leaving out any row takes the table farther off than is allowed."""
    table = jp.load_attitude(jp.export(plan, tmp_path / "few", format="csv", step_s="sparsest"))
    times = DENSE[::10]
    truth = plan.trajectory.sample(times)
    attitudes = Rotation.from_matrix(truth.attitude)
    order = [table.joint_names.index(column_name(name)) for name in plan.scenario.spacecraft.joint_names]

    def off(kept: np.ndarray) -> float:
        """The largest angle off the motion of the rows kept, of platform and joints, rad."""
        rows = Rotation.from_quat(table.quaternions[kept], scalar_first=True)
        turned = (Slerp(table.times[kept], rows)(times).inv() * attitudes).magnitude().max()
        own = [np.interp(times, table.times[kept], table.joints[kept, column]) for column in order]
        return max(float(turned), float(np.abs(np.array(own).T - truth.joints).max()))

    every = np.arange(len(table.times))
    assert off(every) <= np.deg2rad(0.05)
    assert_each(np.array([off(np.delete(every, row)) for row in every[1:-1]]), ">", np.deg2rad(0.05))


def beside_the_way(plan: jp.Plan, clearance: float) -> jp.Plan:
    """The plan with a zone that the instrument misses by an angle, rad, and cuts into between far rows."""
    boresight = plan.scenario.spacecraft.instruments[0].boresight
    track = plan.trajectory.sample(DENSE).attitude @ boresight
    rows = np.array([0.0, 10.0, 20.0, 30.0])
    between = Slerp(rows, Rotation.from_matrix(plan.trajectory.sample(rows).attitude))
    coarse = between(DENSE).apply(boresight)
    axes = random_units(np.random.default_rng(1), 4000)
    gap = np.arccos(np.clip(track[::50] @ axes.T, -1, 1)).min(axis=0)
    cut = np.arccos(np.clip(coarse[::50] @ axes.T, -1, 1)).min(axis=0)
    axis = axes[np.argmax(np.where(gap > 0.2, gap - cut, -1))]
    least = np.arccos(np.clip(track @ axis, -1, 1)).min()
    zone = jp.KeepOut(
        name="Sun", direction=axis, half_angle=float(least - clearance), devices=("instrument-0",)
    )
    return replace(plan, scenario=replace(plan.scenario, keep_out=(zone,)))


def test_a_table_that_breaks_a_zone_between_its_rows_is_refused_by_name_and_instant(plan, tmp_path):
    near = beside_the_way(plan, 1e-3)
    jp.export(near, tmp_path / "fine", format="csv", step_s=0.1)
    with pytest.raises(
        ValueError, match=r"instrument-0 is .* inside the keep-out zone Sun at t = .* smaller step_s"
    ):
        jp.export(near, tmp_path / "coarse", format="csv", step_s=10.0)
    assert not (tmp_path / "coarse").exists()
    few = jp.load_attitude(
        jp.export(near, tmp_path / "few", format="csv", step_s="sparsest", tolerance_deg=1.0)
    )
    assert jp.certify_table(few, None, near.scenario).min_margin >= -np.deg2rad(1e-3)


def test_a_day_may_have_few_rows_too(tmp_path):
    day = flown_day()
    table = jp.load_attitude(jp.export(day, tmp_path / "day", format="npz", step_s="sparsest"))
    whole = jp.load_attitude(jp.export(day, tmp_path / "whole", format="npz"))
    assert len(table.times) < len(whole.times) / 5
    ends = np.unique([segment.end for segment in day.segments])
    assert_each(np.abs(table.times[:, None] - ends).min(axis=0), "<", 1e-6)


@pytest.mark.parametrize(
    ("step", "tolerance", "told"),
    [
        ("sparse", None, "step_s = 'sparse': must be a number of seconds, or 'sparsest'"),
        ("sparsest", 2.0, "tolerance_deg = 2.0: must lie in"),
    ],
)
def test_other_words_for_a_step_are_refused(plan, tmp_path, step, tolerance, told):
    with pytest.raises(ValueError, match=told):
        jp.export(plan, tmp_path / "x", format="csv", step_s=step, tolerance_deg=tolerance)
