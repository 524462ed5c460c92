"""Fits made together: each agrees with the one that it is alone, whatever is fitted beside it."""

from dataclasses import fields, replace

import numpy as np
import pytest
from builders import make_spacecraft
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.runtime.batching import Seconds
from jaxplan.trajectory import FitQuery, fit_batch, interior_point, sqp

EACH = 5
AGREE = 1e-6  # rad of coefficients, s of times


@pytest.fixture(scope="module")
def queries() -> list[FitQuery]:
    """Of paths among the zones of every kind of random scene, and between them one that breaks a limit."""
    scenes = [jp.random_scenario(seed, kind) for kind in SKY_KINDS for seed in range(EACH)]
    plans = [plan for plan in jp.plan_batch(scenes, progress=False) if plan.path is not None]
    assert len(plans) == len(scenes)
    found = []
    for plan in plans:
        scene = plan.scenario
        cones = tabulate(scene.keep_out, scene.keep_in, scene.spacecraft)
        found.append(
            FitQuery(path=plan.path, spacecraft=scene.spacecraft, settings=TrajectorySettings(), cones=cones)
        )
    slow = replace(found[3].spacecraft, rate_limit=0.2 * found[3].spacecraft.rate_limit)
    wheels = replace(
        found[4].spacecraft, inertia=np.diag([2.0, 3.0, 4.0]), torque_limit=0.02, jerk_limit=0.05
    )
    found[3], found[4] = replace(found[3], spacecraft=slow), replace(found[4], spacecraft=wheels)
    found[5] = replace(found[5], start_angular_velocity=np.array([0.004, -0.002, 0.001]))
    return found


def asked(queries, method, duration):
    settings = TrajectorySettings(method=method, duration=duration)
    return [replace(query, settings=settings) for query in queries]


def alone(query):
    return fit_batch([query])[0]


def expect_to_agree(one, other):
    assert (one.status, one.message) == (other.status, other.message)
    assert (one.trajectory is None) == (other.trajectory is None)
    if one.trajectory is not None:
        for field in fields(one.trajectory):
            own, its = (getattr(curve, field.name) for curve in (one.trajectory, other.trajectory))
            if isinstance(own, np.ndarray):
                np.testing.assert_allclose(own, its, rtol=0, atol=AGREE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "duration"),
    [
        ("global", 80.0),
        ("global", "stretched"),
        ("global", "minimum"),
        ("paper", 80.0),
        ("paper", "stretched"),
    ],
)
def test_fits_made_together_agree_with_those_made_alone(queries, method, duration):
    given = asked(queries, method, duration)
    if duration == "minimum":
        given = given[::3]
    for query, fit in zip(given, fit_batch(given), strict=True):
        expect_to_agree(fit, alone(query))


def bare(turn, **limits):
    """A straight motion of a spacecraft without devices."""
    attitudes = Rotation.from_rotvec(np.outer([0, 1], turn)).as_matrix()
    path = Path(attitudes=attitudes, joints=np.zeros((2, 0)), edge_costs=np.ones(1))
    usual = {"rate_limit": np.deg2rad(3), "acceleration_limit": np.deg2rad(2)}
    craft = Spacecraft(terminals=(), instruments=(), **(usual | limits))
    return FitQuery(path=path, spacecraft=craft, settings=TrajectorySettings())


@pytest.mark.slow
@pytest.mark.parametrize("duration", ["minimum", "stretched"])
def test_free_end_accelerations_never_make_a_motion_longer(queries, duration):
    sphere = {"rate_limit": 99.0, "acceleration_limit": 99.0, "inertia": np.eye(3), "torque_limit": 1.0}
    given = [*(queries[number] for number in (0, 3, 4, 5, 8, 12, 17)), bare([0, 0, np.pi], **sphere)]
    for number in (1, 6):  # where by themselves free ones end in a longer motion
        loaded = replace(queries[number].spacecraft, inertia=np.diag([12.0, 18.0, 24.0]), torque_limit=0.1)
        given.append(replace(queries[number], spacecraft=loaded))
    given += [bare(np.pi * axis) for axis in np.eye(3)]
    given += [bare([0.3, 0.5, 0.2], jerk_limit=np.deg2rad(limit)) for limit in (0.3, 0.03)]
    zero, free = (
        [
            replace(query, settings=TrajectorySettings(duration=duration, end_acceleration=ends))
            for query in given
        ]
        for ends in ("zero", "free")
    )
    found = fit_batch(free)
    for resting, fit in zip(fit_batch(zero), found, strict=True):
        assert fit.status is resting.status is jp.Status.OK
        assert fit.trajectory.duration <= resting.trajectory.duration
    for number in (0, 5, 10):
        expect_to_agree(found[number], alone(free[number]))


def test_the_same_call_gives_the_same_bytes(queries):
    given = [*asked(queries[:8], "global", "stretched"), *asked(queries[:8], "paper", 80.0)]
    for one, other in zip(fit_batch(given), fit_batch(given), strict=True):
        assert one.message == other.message
        for field in fields(one.trajectory):
            np.testing.assert_array_equal(
                getattr(one.trajectory, field.name), getattr(other.trajectory, field.name)
            )


def test_fits_agree_in_stacks_of_few(queries, monkeypatch):
    """Stacks are split where they are large, which here they are not."""
    given = [*asked(queries, "global", 80.0), *asked(queries, "paper", 80.0)]
    expected = fit_batch(given)
    monkeypatch.setattr(sqp, "TOGETHER", 4)
    monkeypatch.setattr(interior_point, "TOGETHER", 3)
    for one, other in zip(fit_batch(given), expected, strict=True):
        expect_to_agree(one, other)


def test_fits_with_other_settings_are_made_beside_each_other(queries):
    given = asked(queries[:10], "global", 80.0)
    changes = [{"node_tube": 0.0}, {"node_tube": 0.0}, {"end_acceleration": "free"}, {"jerk_weight": 0.0}, {}]
    for number, query in enumerate(given):
        given[number] = replace(query, settings=replace(query.settings, **changes[number % 5]))
    for number in (4, 9):
        count = len(given[number].path.attitudes)
        given[number] = replace(given[number], node_fractions=np.linspace(0, 1, count) ** 1.1)
    for query, fit in zip(given, fit_batch(given), strict=True):
        expect_to_agree(fit, alone(query))


def test_seconds_are_shared_out_to_the_fits(queries):
    seconds = Seconds(len(queries))
    fit_batch(asked(queries, "paper", 80.0), seconds)
    assert_each(seconds.spent, ">", 0)
    assert np.max(seconds.spent) < 0.9 * np.sum(seconds.spent)


def test_no_fits_are_none_and_what_makes_no_sense_is_said_by_its_name(queries):
    assert fit_batch([]) == []
    wrong = asked(queries[:2], "global", 80.0)
    wrong[1] = replace(wrong[1], settings=replace(wrong[1].settings, duration=-1.0))
    with pytest.raises(ValueError, match=r"trajectory\.duration_s"):
        fit_batch(wrong)


def test_a_path_of_numbers_that_are_none_harms_no_other_fit(queries):
    given = asked(queries[:3], "global", 80.0)
    broken = np.full_like(given[1].path.joints, np.nan)
    given[1] = replace(given[1], path=replace(given[1].path, joints=broken))
    first, middle, last = fit_batch(given)
    assert middle.trajectory is None
    assert middle.status is jp.Status.INFEASIBLE
    for fit, query in ((first, given[0]), (last, given[2])):
        expect_to_agree(fit, alone(query))


def test_spacecraft_of_other_shapes_are_fitted_beside_each_other(queries):
    one = queries[0]
    few = replace(
        one,
        spacecraft=make_spacecraft(1),
        path=replace(one.path, joints=one.path.joints[:, [0, one.path.joints.shape[1] // 2]]),
        cones=None,
    )
    given = asked([one, few, one], "global", "stretched")
    for query, fit in zip(given, fit_batch(given), strict=True):
        expect_to_agree(fit, alone(query))
