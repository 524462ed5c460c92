"""Shorter plans along the paths of other searches, and for as long as is asked."""

import re
from dataclasses import replace

import numpy as np
import pytest
from dense import assert_kept
from scipy.optimize import brentq

import jaxplan as jp
from jaxplan import so3
from jaxplan.model.duration_bound import times_along
from jaxplan.model.path import Path, halve
from jaxplan.model.status import Status
from jaxplan.planner.shorter import Shorter, looks_sooner, may_be_sooner
from jaxplan.planner.steps import SearchQuery, find_goals
from jaxplan.search import SearchResult, make_scene
from jaxplan.trajectory import Fit
from jaxplan.trajectory.node_times import turn_time

SHORT = 40.3  # s; the first search passes the cones on the side that takes 47.8


@pytest.fixture(scope="module")
def scene():
    """A camera that slews far among six cones."""
    rng = np.random.default_rng([77, 0])

    def drawn():
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)

    boresight = np.array([1.0, 0.0, 0.0])
    while True:
        start = so3.exp(rng.uniform(0, np.pi) * drawn())
        goal = start @ so3.exp(rng.uniform(1.5, np.pi - 1e-3) * drawn())
        cones = [(drawn(), np.deg2rad(rng.uniform(10, 35))) for _ in range(6)]
        ends = [attitude @ boresight for attitude in (start, goal)]
        if all(np.arccos(np.clip(end @ axis, -1, 1)) > half + 0.03 for end in ends for axis, half in cones):
            break
    craft = jp.Spacecraft(
        terminals=(),
        instruments=(jp.Instrument(name="camera", boresight=boresight),),
        rate_limit=np.deg2rad(3.0),
        acceleration_limit=np.deg2rad(1.0),
    )
    return jp.Scenario(
        name="among cones",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=so3.log(start), joints=np.zeros(0)),
        goal=jp.GivenState(rotation_vector=so3.log(goal), joints=np.zeros(0)),
        keep_out=tuple(
            jp.KeepOut(name=f"cone {number}", direction=axis, half_angle=half)
            for number, (axis, half) in enumerate(cones)
        ),
        trajectory=jp.TrajectorySettings(duration="minimum"),
    )


def with_guesses(scene, count):
    return replace(scene, trajectory=replace(scene.trajectory, first_guesses=count))


def test_the_quicker_side_of_cones_is_found_and_certified(scene):
    plan = jp.plan(scene)
    assert plan.ok
    assert plan.certificate.certified
    assert plan.trajectory.duration < SHORT
    assert_kept(plan.trajectory, scene.spacecraft, scene.keep_out)
    alone = jp.plan(with_guesses(scene, 0))
    assert alone.trajectory.duration > SHORT + 5


def test_the_path_of_a_shorter_plan_is_the_one_that_it_follows(scene):
    plan = jp.plan(scene)
    samples = plan.trajectory.sample(plan.trajectory.node_times)
    offs = so3.distance(samples.attitude, plan.path.attitudes)
    assert np.max(offs) < 0.6  # rad; the other way round is farther off


def test_of_the_paths_of_a_round_only_those_that_lead_another_quick_way_are_fitted(scene):
    near, other = jp.plan(with_guesses(scene, 0)), jp.plan(scene).path
    far = Path(
        attitudes=np.concatenate([other.attitudes, other.attitudes[::-1], other.attitudes]),
        joints=np.zeros((3 * len(other.attitudes), 0)),
        edge_costs=np.ones(3 * len(other.attitudes) - 1),
    )
    shorter = Shorter(replace(near, scenario=scene), make_scene(scene, near.goal), 1e3, 0.0)
    paths = [far, near.path, other, None, *[near.path] * 4, *[other] * 4]
    seeds = set()
    for path in paths:
        assert isinstance(shorter.need, SearchQuery)
        seeds.add((shorter.need.settings.method, shorter.need.settings.seed))
        status = Status.NO_PATH if path is None else Status.OK
        shorter.accept_path(SearchResult(status=status, path=path, expansions=1))
    assert len(seeds) == len(paths)
    assert shorter.need.path is other
    shorter.accept_fit(Fit(status=Status.LIMITS_TOO_TIGHT, trajectory=None, message=""))
    assert shorter.need is None
    assert shorter.plan.path is near.path


@pytest.fixture(scope="module")
def plan_and_goals(scene):
    """A plan without zones, and goals slightly slower and quicker to reach directly, with lower bounds below.

    About one axis a turn takes longer than its bound, which leaves room for turns about others.
    """
    craft, start = scene.spacecraft, np.asarray(scene.start.attitude)
    slow = np.array([1.7, 0.0, 0.0])
    diagonal = np.ones(3) * brentq(
        lambda a: turn_time(a * np.ones(3), craft) / turn_time(slow, craft) - 0.97, 0.1, 3
    )
    attitudes = {"own": diagonal, "slow": slow, "near": 0.98 * diagonal}
    goals = {name: start @ so3.exp(turn) for name, turn in attitudes.items()}
    to_own = jp.GivenState(rotation_vector=so3.log(goals["own"]), joints=np.zeros(0))
    plan = jp.plan(replace(scene, goal=to_own, keep_out=()))
    return plan, *(replace(plan.goal, attitude=goals[name]) for name in ("slow", "near"))


def test_a_goal_looks_sooner_only_if_a_direct_motion_to_it_is_quicker(plan_and_goals):
    plan, slow, near = plan_and_goals
    assert may_be_sooner(plan, slow)
    assert not looks_sooner(plan, slow)
    assert looks_sooner(plan, near)


def test_a_goal_that_is_slower_to_reach_directly_looks_sooner_where_something_holds_the_plan_up(
    plan_and_goals,
):
    plan, slow, _ = plan_and_goals
    path = plan.path
    aside = path.attitudes[0] @ so3.exp(np.array([0.0, 0.4, 0.0]))
    bent = replace(
        path,
        attitudes=np.stack([path.attitudes[0], aside, path.attitudes[-1]]),
        joints=np.zeros((3, 0)),
        edge_costs=np.ones(2),
    )
    assert looks_sooner(replace(plan, trajectory=plan.trajectory.scaled(1.05)), slow)
    assert looks_sooner(replace(plan, path=bent), slow)


def test_direct_motions_say_nothing_of_a_start_that_turns(plan_and_goals):
    plan, slow, _ = plan_and_goals
    turning = replace(plan.scenario.start, angular_velocity=np.array([1e-6, 0.0, 0.0]))
    assert looks_sooner(replace(plan, scenario=replace(plan.scenario, start=turning)), slow)


def test_a_round_searches_for_ways_to_other_goals_too_and_fits_the_quickest_to_any(scene):
    near, other = jp.plan(with_guesses(scene, 0)), jp.plan(scene).path
    rolled = replace(near.goal, attitude=near.goal.attitude @ so3.exp(np.array([0.2, 0.0, 0.0])))
    there = replace(other, attitudes=np.concatenate([other.attitudes[:-1], rolled.attitude[None]]))
    shorter = Shorter(replace(near, scenario=scene), make_scene(scene, near.goal), 1e3, 0.0, [rolled])
    first = replace(near.path, attitudes=np.concatenate([near.path.attitudes[:-1], rolled.attitude[None]]))
    assert shorter.need.settings.seed == scene.search.seed
    shorter.accept_path(SearchResult(status=Status.OK, path=first, expansions=1))
    assert shorter.need.path is first
    shorter.accept_fit(Fit(status=Status.LIMITS_TOO_TIGHT, trajectory=None, message=""))
    ends = []
    while isinstance(shorter.need, SearchQuery):
        ends.append(shorter.need.scene.goal_attitude)
        to_other = np.array_equal(ends[-1], rolled.attitude)
        path = {True: there, False: near.path}[to_other]
        shorter.accept_path(SearchResult(status=Status.OK, path=path, expansions=1))
    assert sum(np.array_equal(end, near.goal.attitude) for end in ends) == 12
    assert sum(np.array_equal(end, rolled.attitude) for end in ends) == 6
    assert shorter.need.path is there
    shorter.accept_fit(Fit(status=Status.LIMITS_TOO_TIGHT, trajectory=None, message=""))
    assert shorter.need is None
    assert shorter.plan.goal is near.goal


def test_what_a_path_looks_to_take_hardly_depends_on_the_number_of_its_nodes(scene):
    path = jp.plan(scene).path
    craft = scene.spacecraft
    paths = [path, halve(path), halve(halve(path))]
    nodes = [(own.attitudes, own.joints) for own in paths]
    takes = times_along(craft, nodes)
    np.testing.assert_allclose(takes, takes[0], rtol=0.02)
    slow = replace(craft, rate_limit=craft.rate_limit / 4)
    np.testing.assert_allclose(times_along(slow, nodes[:1]), 4 * takes[0], rtol=0.05)


def test_what_paths_look_to_take_does_not_depend_on_others(scene):
    path = jp.plan(scene).path
    turned = path.attitudes[::-1], path.joints[::-1]
    still = path.attitudes[:1], path.joints[:1]
    nodes = [(path.attitudes, path.joints), still, turned, (path.attitudes[:2], path.joints[:2])]
    alone = [times_along(scene.spacecraft, [own])[0] for own in nodes]
    np.testing.assert_allclose(times_along(scene.spacecraft, nodes), alone, rtol=1e-14)
    assert alone[1] == 0
    assert alone[2] == pytest.approx(alone[0])


def test_improving_never_ends_with_a_longer_plan_and_stops_in_time(scene):
    first = jp.plan(with_guesses(scene, 0))
    improved = jp.plan(with_guesses(scene, 0), improve_for_s=2.0)
    assert improved.certificate.certified
    assert improved.trajectory.duration < first.trajectory.duration


def test_a_batch_finds_the_same_plan(scene):
    (together,) = jp.plan_batch([scene])
    assert together.trajectory.duration == pytest.approx(jp.plan(scene).trajectory.duration, rel=1e-6)


@pytest.mark.parametrize("seconds", [-1.0, np.nan, np.inf, "long", None])
def test_a_time_to_improve_that_makes_no_sense_is_refused_by_name(scene, seconds):
    with pytest.raises(ValueError, match="improve_for_s"):
        jp.plan(scene, improve_for_s=seconds)


@pytest.mark.parametrize("duration", ["stretched", 80.0])
def test_only_the_shortest_duration_is_improved(scene, duration):
    given = replace(scene, trajectory=replace(scene.trajectory, duration=duration))
    needed = re.escape('improve_for_s = 3: needs trajectory.duration_s = "minimum", and that of ')
    with pytest.raises(ValueError, match=f"{needed}.* is {duration}"):
        jp.plan(given, improve_for_s=3)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("keep_out", 152), ("hard_keep_out", 31), ("keep_in", 1)])
def test_the_goal_of_least_time_is_never_later_than_that_of_least_rotation(kind, seed):
    scenario = jp.random_scenario(
        seed, kind
    )  # in the first two zones are in the way to the one of least bound
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration="minimum"))
    soonest, nearest = (
        jp.plan(replace(scenario, goal=replace(scenario.goal, criterion=word)))
        for word in ("least_time", "least_rotation")
    )
    assert soonest.trajectory.duration <= nearest.trajectory.duration * (1 + 1e-4)
    assert nearest.goal.slew_angle <= soonest.goal.slew_angle + 1e-9
    first = find_goals(scenario)[0]
    if kind != "keep_in":
        assert so3.distance(soonest.goal.attitude, first.attitude) > 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("hard_keep_out", 10), ("hard_keep_out", 71), ("keep_out", 103)])
def test_round_zones_the_nearest_goal_is_planned_as_if_it_were_asked_for(kind, seed):
    scenario = jp.random_scenario(seed, kind)  # the goal of least time is close to the nearest one
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration="minimum"))
    soonest = jp.plan(scenario)
    nearest = jp.plan(replace(scenario, goal=replace(scenario.goal, criterion="least_rotation")))
    assert soonest.scenario.goal.criterion is None
    assert soonest.certificate.certified
    assert soonest.trajectory.duration <= nearest.trajectory.duration * (1 + 1e-4)
    assert_kept(soonest.trajectory, scenario.spacecraft, scenario.keep_out)


@pytest.mark.slow
def test_the_quicker_way_is_found_that_few_searches_find():
    scenario = jp.random_scenario(45, "hard_keep_out")  # most ways to its two goals take 32.6 s and more
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration="minimum"))
    assert jp.plan(scenario).trajectory.duration < 30.8
