"""The spline's durations, loads of the platform, rates at the ends, and whole plans."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dense import assert_kept, end_states, jumps, shares
from node_paths import NAMES, load
from scenes import make_spacecraft

import jaxplan as jp
from jaxplan.cases import paper_case
from jaxplan.scenario import TrajectorySettings
from jaxplan.status import Status
from jaxplan.trajectory import duration_bound, fit_global, fit_paper

CRAFT = make_spacecraft()
numbers = pytest.mark.parametrize("number", [1, 2, 3, 4])
names = pytest.mark.parametrize("name", NAMES)


@cache
def planned(number, **settings):
    case = paper_case(number)
    return jp.plan(replace(case, trajectory=TrajectorySettings(**settings)))


def zones_of(scenario):
    return (*scenario.keep_out, *scenario.keep_in)


def bound_of(trajectory, craft, rates=None):
    ends = trajectory.sample(trajectory.duration * np.array([0.0, 1.0]))
    rates = np.zeros((2, 3 + ends.joints.shape[1])) if rates is None else rates
    return duration_bound(craft, ends.attitude, ends.joints, rates[:, :3], rates[:, 3:])


@numbers
@pytest.mark.parametrize(("ends", "above"), [("zero", 0.02), ("free", 0.005)])
def test_the_shortest_plans_of_the_paper_are_near_the_strict_bound(number, ends, above):
    plan = planned(number, duration="minimum", end_acceleration=ends)
    assert plan.status is Status.OK, plan.message
    assert plan.report.certified
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    assert_kept(trajectory, craft, zones_of(plan.scenario))
    bound = bound_of(trajectory, craft)
    assert bound <= trajectory.duration <= (1 + above) * bound
    states = end_states(trajectory)
    assert np.all(np.abs(states[0]) <= 1e-9)
    assert np.all(jumps(trajectory, 3) <= 1e-9)
    if ends == "zero":
        assert np.all(np.abs(states[1]) <= 1e-8)
    else:
        assert np.any(np.abs(states[1]) > 1e-3)


@names
def test_stretched_lies_between_the_shortest_and_the_papers(name):
    path, durations = load(name), {}
    for duration in ("minimum", "stretched"):
        fit = fit_global(path, CRAFT, TrajectorySettings(duration=duration))
        assert fit.status is Status.OK
        durations[duration] = fit.trajectory.duration
        largest = {n: np.abs(s).max() for n, s in shares(fit.trajectory, CRAFT).items() if n != "range"}
        # The first limit is just met.
        assert max(largest.values()) == pytest.approx(1, abs=1e-4)
    paper = fit_paper(path, CRAFT, TrajectorySettings(method="paper", segments=3)).trajectory
    assert durations["minimum"] < durations["stretched"] < paper.duration


@pytest.mark.parametrize("name", ["rrt_c2"])
def test_a_duration_too_short_says_which_would_do(name):
    path, settings = load(name), TrajectorySettings(duration=15.0)
    fit = fit_global(path, CRAFT, settings)
    assert fit.status is Status.LIMITS_TOO_TIGHT
    assert fit.needed_duration > 15
    advised = float(re.search(r"duration_s to ([\d.]+)", fit.message).group(1))
    assert fit.needed_duration <= advised <= fit.needed_duration + 0.01
    longer = fit_global(path, CRAFT, replace(settings, duration=advised))
    assert longer.status is Status.OK, longer.message
    assert longer.trajectory.duration == advised
    assert_kept(longer.trajectory, CRAFT)
    shortest = fit_global(path, CRAFT, replace(settings, duration="minimum", node_tube=np.deg2rad(1.0)))
    assert fit.needed_duration <= 1.1 * shortest.trajectory.duration
