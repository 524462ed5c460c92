import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import make_scenario, spacecraft_of, with_search
from dense import instants, shares
from reference import assert_each, attitudes_of, joints_of, sampled_margin
from scipy.spatial.transform import Rotation
from trust import flights, golden

import jaxplan as jp
from jaxplan import so3
from jaxplan.cases import SKY_KINDS
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import STRETCHED, Scenario
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import rounds
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.ladder import LADDER
from jaxplan.planner.proving import certify
from jaxplan.planner.steps import GoalQuery, SearchQuery, find_goals
from jaxplan.planner.validity import breaches
from jaxplan.report.tables import trajectory_table
from jaxplan.schema import parse_scenario, with_settings
from jaxplan.search import SearchResult, make_scene
from jaxplan.trajectory import METHODS, Fit, by_name

INSTANTS = 100_000


@pytest.fixture(scope="module")
def case_plans() -> dict[int, jp.Plan]:
    return {number: jp.plan(jp.paper_case(number)) for number in (1, 2, 3, 4)}


@pytest.mark.slow
@pytest.mark.paper
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_limits_and_margins_of_the_papers_cases_hold_at_a_hundred_thousand_instants(case_plans, number):
    plan = case_plans[number]
    assert plan.ok
    assert plan.certificate.certified
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    t = instants(trajectory, INSTANTS)
    attitudes, joints = attitudes_of(trajectory, t), joints_of(trajectory, t, orders=1)[0]
    margin = sampled_margin(make_scene(plan.scenario, plan.goal), attitudes, joints)
    assert_each(margin, ">=", 0)
    assert margin.min() >= plan.certificate.min_margin - 1e-9
    assert margin.min() <= plan.certificate.min_margin + np.deg2rad(0.05), "the proved bound is not idle"

    found = shares(trajectory, craft, INSTANTS)
    assert_each(np.abs(found["range"]), "<=", 1)
    peaks = {
        "angular_velocity": found["rate"],
        "angular_acceleration": found["acceleration"],
        "joint_rates": found["joint rate"],
        "joint_accelerations": found["joint acceleration"],
    }
    for name, own in peaks.items():
        assert_each(np.abs(own), "<=", 1, name)
        assert plan.certificate.peaks[name] == pytest.approx(np.abs(own).max(), rel=3e-3), name
        assert plan.certificate.peaks[name] >= np.abs(own).max() - 1e-6, name
    sample = trajectory.sample(t)
    np.testing.assert_allclose(sample.attitude, attitudes, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sample.angular_velocity, found["rate"] * craft.rate_limit, rtol=0, atol=1e-9)


@pytest.mark.paper
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_plans_of_the_papers_cases_run_from_start_to_the_published_targets(case_plans, number):
    plan = case_plans[number]
    scenario = plan.scenario
    ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration]))
    start = Rotation.from_rotvec(scenario.start.rotation_vector).as_matrix()
    np.testing.assert_allclose(ends.attitude[0], start, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ends.joints[0], scenario.start.joints, rtol=0, atol=1e-9)
    seen = scenario.spacecraft.boresights(ends.attitude[1], ends.joints[1])
    np.testing.assert_allclose(seen, scenario.goal.directions, rtol=0, atol=1e-8)
    np.testing.assert_allclose(ends.angular_velocity, 0, atol=1e-9)
    np.testing.assert_allclose(ends.joint_rates, 0, atol=1e-9)
    turn = (Rotation.from_matrix(ends.attitude[0]).inv() * Rotation.from_matrix(ends.attitude[1])).magnitude()
    assert plan.goal.slew_angle == pytest.approx(turn, abs=1e-8)
    assert certify(plan).certified


def test_a_goal_beyond_its_own_limits_or_with_another_slew_is_not_certified(case_plans):
    plan = case_plans[1]
    yaw, pitch = np.abs(np.split(plan.goal.joints, 2)).max(axis=1)
    for key, least in (("yaw", yaw), ("pitch", pitch)):
        for share, certified in ((1.001, True), (0.999, False)):
            limited = replace(plan.scenario.goal, **{f"{key}_limit": share * least})
            report = certify(replace(plan, scenario=replace(plan.scenario, goal=limited)))
            assert report.certified == certified
            assert any(f"goal.{key}_limit_deg" in fault for fault in report.faults) != certified
    for slew in (0.0, np.nan):
        report = certify(replace(plan, goal=replace(plan.goal, slew_angle=slew)))
        assert "the goal's slew angle is not that from the start" in report.faults


@pytest.mark.parametrize("duration", ["stretched", "minimum"])
def test_the_shortest_of_ways_is_gone_to_the_nearest_goal(case_plans, duration):
    plan = case_plans[2]
    settings = {
        "trajectory.method": "global",
        "trajectory.duration_s": duration,
    }
    goal = replace(plan.scenario.goal, criterion="least_rotation")
    for turn in (1e-3, 3e-2):
        attitude = plan.goal.attitude @ Rotation.from_rotvec([turn, 0, 0]).as_matrix()
        start = replace(
            plan.scenario.start,
            rotation_vector=Rotation.from_matrix(attitude).as_rotvec(),
            joints=plan.goal.joints,
        )
        near = jp.plan(with_settings(replace(plan.scenario, start=start, goal=goal), settings))
        assert near.goal.slew_angle < 0.2 * turn
        assert near.trajectory.duration < 2.0
        assert not near.message


def test_a_farther_goal_is_taken_with_a_word_on_the_nearest(monkeypatch):
    scenario = jp.paper_case(1)
    nearest, *others = find_goals(scenario)
    assert others
    fit_batch = rounds.fit_batch

    def fail(queries, *rest):
        jump = Fit(trajectory=None, status=jp.Status.UNCERTIFIED, message="it jumps")
        near = nearest.attitude
        fits = fit_batch(queries, *rest)
        return [
            jump if so3.distance(query.path.attitudes[-1], near) < 1e-6 else fit
            for query, fit in zip(queries, fits, strict=True)
        ]

    monkeypatch.setattr(rounds, "fit_batch", fail)
    plan = jp.plan(scenario)
    assert plan.goal.slew_angle > nearest.slew_angle + 0.01
    assert "this is not the nearest goal" in plan.message
    assert "ended as UNCERTIFIED; it jumps" in plan.message


def test_plans_of_the_papers_cases_are_those_of_the_golden_set(case_plans):
    for number, plan in case_plans.items():
        golden.verdict(f"case {number}", plan)


def test_motions_are_those_of_a_body_under_their_torque(case_plans):
    for number in (1, 4):
        found = flights.errors(case_plans[number].trajectory, flights.random_inertia(number), steps=480)
        assert all(error <= 2e-6 for error in found.values()), found


def test_integration_finds_a_rate_that_is_off_by_a_thousandth(case_plans):
    trajectory = case_plans[1].trajectory

    def sample(times):
        right = trajectory.sample(times)
        return replace(right, angular_velocity=1.001 * right.angular_velocity)

    times = {"breaks": trajectory.breaks, "joint_breaks": trajectory.joint_breaks}
    wrong = SimpleNamespace(duration=trajectory.duration, sample=sample, **times)
    found = flights.errors(wrong, flights.random_inertia(1), steps=480)
    assert found["attitude by kinematics"] > 1e-4


@pytest.mark.parametrize(("terminals", "instruments"), [(0, 0), (0, 2), (1, 0), (2, 1), (4, 0), (12, 3)])
def test_any_number_of_devices_is_planned_and_certified(terminals, instruments):
    scenario = make_scenario(terminals, instruments, turn=(0.2, -0.3, 0.25))
    plan = jp.plan(scenario)
    assert plan.certificate.certified
    assert plan.certificate.min_margin is None
    largest = max(
        plan.certificate.peaks[name] for name in plan.certificate.peaks if name not in ("yaw", "pitch")
    )
    assert 1 - 1e-4 <= largest <= 1 + 1e-9, "a stretched manoeuvre is at its first limit"


def test_stretched_is_much_shorter_than_the_papers_duration():
    scenario = jp.paper_case(2)
    stretched = replace(scenario, trajectory=replace(scenario.trajectory, duration="stretched"))
    plan = jp.plan(stretched)
    assert plan.certificate.certified
    assert plan.trajectory.duration < 60


def test_half_a_turn_is_planned():
    assert jp.plan(make_scenario(2, turn=(0.0, np.pi, 0.0))).certificate.certified


def test_start_equal_to_goal_takes_no_time():
    scenario = make_scenario(3)
    plan = jp.plan(replace(scenario, goal=scenario.start))
    assert plan.ok
    assert plan.path.edges == 0
    assert plan.trajectory.duration == 0
    assert plan.certificate.certified
    np.testing.assert_allclose(plan.trajectory.sample(0.0).joints, scenario.start.joints, rtol=0, atol=1e-8)
    assert plan.explained is None
    assert plan.summary()["explained"] is None


def seen_at(state, device: int) -> np.ndarray:
    craft = make_scenario(3).spacecraft
    attitude = Rotation.from_rotvec(state.rotation_vector).as_matrix()
    return np.array(craft.boresights(attitude, state.joints))[device]


def off(direction: np.ndarray, angle: float) -> np.ndarray:
    axis = np.cross(direction, [0.1, 0.7, -0.4])
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).apply(direction)


def broken_scenarios() -> dict[str, tuple[jp.Scenario, str, list[str]]]:
    """Scene, status, and what the message must name."""
    free = make_scenario(3)
    at_start, at_goal = seen_at(free.start, 1), seen_at(free.goal, 2)
    sun = KeepOut(name="Sun", direction=off(at_start, 0.3), half_angle=0.3 + np.deg2rad(1.25))
    moon = KeepOut(name="Moon", direction=off(at_goal, 0.2), half_angle=0.2 + np.deg2rad(0.5))
    link = KeepIn(
        name="link", direction=off(at_start, 0.4), half_angle=0.4 - np.deg2rad(2.0), devices=("terminal-2",)
    )
    beyond = np.array(free.start.joints)
    beyond[4] = np.deg2rad(17.5)
    fast = np.array([0.0, np.deg2rad(4.0), 0.0])
    at_limit, onward = (np.deg2rad(value) * (np.arange(6) == 4) for value in (15.0, 1.0))
    only = {"devices": ("terminal-2",)}
    return {
        "start in keep-out": (
            make_scenario(3, keep_out=(replace(sun, **only),)),
            "INVALID_START",
            ["terminal-2", "Sun", "1.25 deg"],
        ),
        "start out of keep-in": (
            make_scenario(3, keep_in=(link,)),
            "INVALID_START",
            ["terminal-2", "link", "2 deg"],
        ),
        "start beyond a joint limit": (
            replace(free, start=replace(free.start, joints=beyond)),
            "INVALID_START",
            ["terminal-2 pitch", "2.5 deg", "15 deg"],
        ),
        "start too fast": (
            replace(free, start=replace(free.start, angular_velocity=fast)),
            "INVALID_START",
            ["platform", "4 deg/s", "3 deg/s"],
        ),
        "start at a joint limit and going on": (
            replace(free, start=replace(free.start, joints=at_limit, joint_rates=onward)),
            "INVALID_START",
            ["terminal-2 pitch", "0 deg from its limit of 15 deg", "toward it at 1 deg/s"],
        ),
        "start too near a joint limit to stop": (
            replace(free, start=replace(free.start, joints=0.99 * at_limit, joint_rates=2 * onward)),
            "INVALID_START",
            ["terminal-2 pitch", "0.15 deg from its limit", "toward it at 2 deg/s"],
        ),
        "goal at a joint limit and coming from beyond": (
            replace(free, goal=replace(free.goal, joints=-at_limit, joint_rates=onward)),
            "INVALID_GOAL",
            ["terminal-2 pitch", "0 deg from its limit of 15 deg", "away from it at 1 deg/s"],
        ),
        "goal in keep-out": (
            make_scenario(3, keep_out=(replace(moon, devices=("terminal-3",)),)),
            "INVALID_GOAL",
            ["terminal-3", "Moon", "0.5 deg"],
        ),
        "no station in sight": (
            make_scenario(3, keep_in=(replace(link, any_of="ground"),)),
            "INVALID_START",
            ["terminal-2", "link", "ground", "2 deg"],
        ),
    }


@pytest.mark.parametrize("name", broken_scenarios())
def test_a_start_or_goal_that_breaks_something_is_named_before_any_search(name):
    scenario, status, words = broken_scenarios()[name]
    plan = jp.plan(scenario, throw=False)
    assert plan.status.name == status
    assert plan.search is None
    assert plan.path is None
    assert plan.certificate is None
    for word in words:
        assert word in plan.message, plan.message
    with pytest.raises(jp.PlanningError, match=status) as caught:
        jp.plan(scenario)
    assert caught.value.status is plan.status


def test_a_joint_at_its_limit_may_rest_or_turn_back():
    scenario = make_scenario(2)
    limit, rate = (np.deg2rad(value) * (np.arange(4) == 0) for value in (90.0, 1.0))
    for side in (-1, 1):
        for outward in (-1, 0, 1):
            for arriving in (False, True):
                rates = (-1 if arriving else 1) * outward * side * rate
                found = breaches(scenario, np.eye(3), side * limit, np.zeros(3), rates, arriving=arriving)
                assert len(found) == (outward == 1)


@pytest.mark.parametrize("given", ["case-2", None, 2], ids=str)
def test_what_is_no_scenario_is_told_how_to_get_one(given):
    with pytest.raises(TypeError, match=rf"Scenario, not {type(given).__name__}; jp\.load_scenario"):
        jp.plan(given)


@pytest.mark.parametrize("part", ["search", "trajectory"])
def test_a_method_that_does_not_exist_is_refused_by_name(part):
    scenario = make_scenario(1)
    odd = replace(scenario, **{part: replace(getattr(scenario, part), method="astar")})
    with pytest.raises(jp.ScenarioError, match=rf"scenario: {part}\.method = 'astar': must be \"\w+"):
        jp.plan(odd)
    with pytest.raises(jp.ScenarioError, match=rf"scenarios\[1\]: {part}\.method"):
        jp.plan_batch([scenario, odd])


def test_what_the_method_of_the_paper_cannot_time_is_refused():
    scenario = make_scenario(1)
    settings = replace(scenario.trajectory, method="paper", duration="stretched")
    at_speed = replace(scenario.goal, joint_rates=np.array([0.0, 1e-3]))
    with pytest.raises(ValueError, match=r"scenario: trajectory\.duration = 'stretched': must be a number"):
        jp.plan(replace(scenario, goal=at_speed, trajectory=settings))
    with pytest.raises(ValueError, match=r"duration = 'minimum': only"):
        jp.plan(replace(scenario, trajectory=replace(settings, duration="minimum")))


def test_limits_at_the_ends_of_their_ranges_are_planned():
    scenario = make_scenario(1)
    craft = scenario.spacecraft
    slow = replace(craft, acceleration_limit=np.deg2rad(1e-9))
    weak = replace(craft, inertia=np.eye(3) * 1e12, torque_limit=np.full(3, 1.0))
    quick = replace(craft, rate_limit=np.deg2rad(1e6), acceleration_limit=np.deg2rad(1e9))
    for name, odd in (("slow", slow), ("weak", weak), ("quick", quick)):
        assert jp.plan(replace(scenario, spacecraft=odd)).ok, name


def test_targets_that_cannot_be_reached_together_say_by_how_much():
    scenario = jp.paper_case(2)
    same = np.array([[1.0, 0.0, 0.0]] * 3)  # no direction lies in the yaw ranges of all three
    goal = Targets(directions=same, angular_velocity=np.zeros(3), joint_rates=np.zeros(6))
    plan = jp.plan(replace(scenario, goal=goal), throw=False)
    assert plan.status is jp.Status.GOAL_UNREACHABLE
    assert plan.goal is None
    assert "deg beyond" in plan.message
    assert "terminal-" in plan.message


def test_an_instrument_keeps_the_platform_from_the_nearest_goal():
    from jaxplan.model.devices import Instrument

    scenario = jp.paper_case(2)
    nearest = jp.plan(scenario).goal
    tracker = Instrument(name="star-tracker", boresight=np.array([0.0, 0.0, 1.0]))
    craft = replace(scenario.spacecraft, instruments=(tracker,))
    sun = KeepOut(
        name="Sun", direction=nearest.attitude[:, 2], half_angle=np.deg2rad(10), devices=("star-tracker",)
    )
    plan = jp.plan(replace(scenario, spacecraft=craft, keep_out=(*scenario.keep_out, sun)))
    assert plan.goal.slew_angle > nearest.slew_angle + 0.01
    angle = np.arccos(plan.goal.attitude[:, 2] @ sun.direction)
    assert angle >= sun.half_angle - 1e-9


def test_a_search_without_success_names_the_setting_to_change_and_the_zone_in_the_way():
    scenario = with_search(jp.random_scenario(10, "hard_keep_out"), max_expansions=1)
    plan = jp.plan(scenario, throw=False)
    assert plan.status is jp.Status.NODE_LIMIT
    assert "search.max_expansions" in plan.message
    assert any(zone.name in plan.message for zone in scenario.keep_out)
    assert plan.trajectory is None
    late = jp.plan(with_search(jp.random_scenario(10, "hard_keep_out"), time_limit=1e-9), throw=False)
    assert late.status is jp.Status.TIME_LIMIT
    assert "search.time_limit_s" in late.message


def test_a_search_whose_time_is_over_is_not_begun_again():
    scenario = jp.random_scenario(10, "hard_keep_out")
    tried = Attempts(scenario, Clock(np.inf))
    assert isinstance(tried.need, GoalQuery)
    tried.accept_goals(find_goals(scenario, tried.need.time))
    assert isinstance(tried.need, SearchQuery)
    tried.accept_path(SearchResult(status=jp.Status.TIME_LIMIT, path=None, expansions=7))
    assert tried.need is None
    assert tried.result().status is jp.Status.TIME_LIMIT
    assert "7 expansions" in tried.result().message


def test_a_ring_of_zones_around_the_goal_is_a_proof_that_no_path_exists():
    scenario = jp.paper_case(2)
    assert isinstance(scenario.goal, Targets)
    target = scenario.goal.directions[0]
    side = np.cross(target, [0.0, 0.0, 1.0])
    out = Rotation.from_rotvec(np.deg2rad(30) * side / np.linalg.norm(side)).apply(target)
    ring = tuple(
        KeepOut(
            name=f"ring-{k}",
            direction=Rotation.from_rotvec(2 * np.pi * k / 12 * target).apply(out),
            half_angle=np.deg2rad(9.0),
            devices=("terminal-1",),
        )
        for k in range(12)
    )
    plan = jp.plan(replace(scenario, keep_out=ring), throw=False)
    assert plan.status is jp.Status.NO_PATH
    assert plan.goal is not None
    assert plan.path is plan.trajectory is None
    assert "terminal-1" in plan.message
    assert all(zone.name in plan.message for zone in ring)
    gap = jp.plan(replace(scenario, keep_out=ring[1:]), throw=False)
    assert gap.status is jp.Status.OK


STRAIT = """
schema_version = 1
name = "strait"
[spacecraft]
rate_limit_deg_s = 3.0
acceleration_limit_deg_s2 = 2.0
[[spacecraft.instrument]]
name = "telescope"
boresight = [0.0, 0.0, 1.0]
[start]
attitude = [0.0, 0.6457718, 0.0]
[goal]
attitude = [0.0, -0.6457718, 0.0]
[[keep_out]]
name = "port"
direction = [0.0, 0.258819, 0.965926]
half_angle_deg = 28.0
[[keep_out]]
name = "starboard"
direction = [0.0, -0.258819, 0.965926]
half_angle_deg = 28.0
[[keep_in]]
name = "channel"
direction = [0.0, 0.0, 1.0]
half_angle_deg = 40.0
devices = ["telescope"]
"""


@pytest.mark.slow
@pytest.mark.parametrize("group", ["", 'any_of = "alone"'])
def test_a_strait_shut_by_a_keep_in_zone_opens_as_the_message_says(group):
    shut = parse_scenario(STRAIT + group)
    plan = jp.plan(shut, throw=False)
    assert plan.status is jp.Status.NO_PATH
    assert "make a keep-out zone smaller or a keep-in zone larger" in plan.message
    (channel,) = shut.keep_in
    wide = jp.plan(replace(shut, keep_in=(replace(channel, half_angle=np.deg2rad(70)),)), throw=False)
    assert wide.status is jp.Status.OK


@pytest.mark.parametrize("part", range(4))
def test_a_state_that_is_no_number_breaks_something_without_zones_too(part):
    scenario = make_scenario(1)
    state = [np.eye(3), np.zeros(2), np.zeros(3), np.zeros(2)]
    assert breaches(scenario, *state) == ()
    state[part] = np.full_like(state[part], np.nan)
    named = ("the attitude", "terminal-1 yaw", "the platform's rate", "the rate of terminal-1 yaw")
    assert any(named[part] in breach for breach in breaches(scenario, *state))


def test_a_duration_that_is_too_short_says_how_long_it_takes():
    scenario = jp.paper_case(2)
    short = replace(scenario, trajectory=replace(scenario.trajectory, duration=30.0))
    plan = jp.plan(short, throw=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert "trajectory.duration_s" in plan.message
    hopeless = replace(scenario, trajectory=replace(scenario.trajectory, duration=2.0))
    assert jp.plan(hopeless, throw=False).status in (
        jp.Status.GOAL_UNREACHABLE,
        jp.Status.LIMITS_TOO_TIGHT,
    )


@pytest.mark.slow
def test_a_duration_that_is_said_to_be_enough_is():
    asked, some = [], SKY_KINDS[::2]
    for seed, method, kinds in ((0, "global", SKY_KINDS), (2, "global", some), (3, "paper", some)):
        for kind in kinds:
            scenario = jp.random_scenario(seed, kind)
            settings = replace(scenario.trajectory, method=method, duration=16.0)
            if seed > 1:
                at_speed = replace(scenario.start, angular_velocity=np.array([0.01, -0.005, 0.008]))
                scenario = replace(scenario, start=at_speed)
            asked.append(replace(scenario, trajectory=settings))
    short = [plan for plan in jp.plan_batch(asked) if plan.status is jp.Status.LIMITS_TOO_TIGHT]
    assert len(short) >= 9
    assert sum(plan.scenario.trajectory.method == "paper" for plan in short) >= 2
    longer = []
    for plan in short:
        said = re.search(
            r"at most ([\d.]+) s are needed: set trajectory.duration_s to ([\d.]+)", plan.message
        )
        assert said.group(1) == said.group(2), plan.message
        paper = plan.scenario.trajectory.method == "paper"  # which does not stretch what is at speed
        assert ("stretched" in plan.message) is not paper
        settings = replace(plan.scenario.trajectory, duration=float(said.group(1)))
        longer.append(replace(plan.scenario, trajectory=settings))
    assert all(plan.ok for plan in jp.plan_batch(longer))


def test_a_goal_too_far_for_a_duration_is_not_to_be_stretched_by_the_papers_method():
    scenario = jp.paper_case(2)
    for method in METHODS:
        settings = replace(scenario.trajectory, method=method, duration=2.0)
        plan = jp.plan(replace(scenario, trajectory=settings), throw=False)
        assert plan.status is jp.Status.GOAL_UNREACHABLE
        assert ("stretched" in plan.message) is (method == "global")


def test_what_is_not_proved_is_never_ok(monkeypatch):
    """A fit that ignores the path and cuts through a zone is refused after every attempt."""
    scenario = jp.paper_case(3)
    attempts = []

    def straight_on(queries, seconds):
        paths = [query.path for query in queries]
        attempts.extend(paths)
        ends = [
            replace(
                path, attitudes=path.attitudes[[0, -1]], joints=path.joints[[0, -1]], edge_costs=np.ones(1)
            )
            for path in paths
        ]
        return real([replace(query, path=own) for query, own in zip(queries, ends, strict=True)], seconds)

    real = by_name(METHODS, "paper")
    monkeypatch.setitem(METHODS, "paper", straight_on)
    plan = jp.plan(scenario, throw=False)
    assert plan.status is jp.Status.UNCERTIFIED
    assert not plan.certificate.certified
    assert plan.certificate.min_margin < 0
    assert plan.trajectory is not None
    assert "CZ" in plan.message
    assert len(attempts) >= len(LADDER)
    assert len({len(path.edge_costs) for path in attempts}) > 1, "with more nodes too"


def test_the_same_scenario_gives_the_same_plan():
    first, second = (jp.plan(jp.paper_case(3)) for _ in range(2))
    np.testing.assert_array_equal(first.trajectory.coefficients, second.trajectory.coefficients)
    np.testing.assert_array_equal(first.trajectory.joint_coefficients, second.trajectory.joint_coefficients)
    assert first.certificate.min_margin == second.certificate.min_margin
    assert set(first.timings) == {"decompose", "search", "trajectory", "certificate", "compile", "total"}


def test_a_plan_prints_itself_as_a_table(case_plans):
    text, page = str(case_plans[2]), case_plans[2]._repr_html_()
    for word in ("case 2", "OK", "deg", "steps", "certified"):
        assert word in text
        assert word in page
    assert page.count("<tr>") == page.count("</tr>") == len(case_plans[2].rows())


def test_a_bound_of_the_time_is_said_to_be_of_the_goal_where_step_1_chose_that(case_plans):
    plans = {True: case_plans[2], False: jp.plan(make_scenario(1))}
    for chosen, plan in plans.items():
        bound = f"above the strict bound of {plan.duration_bound:.2f} s"
        for shown in (str(plan), plan._repr_html_()):
            assert bound in shown
            assert (f"{bound} for this goal" in shown) is chosen
        assert ("No motion to this goal is quicker than" in str(trajectory_table(plan))) is chosen
        assert plan.summary()["goal_chosen"] is chosen


def test_a_duration_below_the_bound_is_said_to_be_less():
    short = make_scenario(1)
    short = replace(short, trajectory=replace(short.trajectory, duration=1.0))
    plan = jp.plan(short, throw=False, progress=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert f"less than the strict bound of {plan.duration_bound:.2f} s" in str(plan)


def test_actuator_limits_a_body_axis_are_kept():
    case = jp.paper_case(1)
    inertia = np.array([[120.0, 3.0, -2.0], [3.0, 90.0, 1.0], [-2.0, 1.0, 60.0]])
    torque, momentum = np.array([0.5, 0.4, 0.3]), np.array([5.0, 4.0, 3.0])
    craft = replace(case.spacecraft, inertia=inertia, torque_limit=torque, wheel_momentum_limit=momentum)
    case = replace(case, spacecraft=craft, trajectory=replace(case.trajectory, duration=STRETCHED))
    plan = jp.plan(case, progress=False)
    assert max(plan.certificate.peaks.values()) <= 1
    assert {"torque", "wheel_momentum"} <= set(plan.certificate.peaks)
    s = plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 20_001))
    spin = s.angular_velocity @ inertia
    load = s.angular_acceleration @ inertia + np.cross(s.angular_velocity, spin)
    for name, sampled, limit in (("torque", load, torque), ("wheel_momentum", spin, momentum)):
        peak = np.max(np.abs(sampled) / limit)
        assert peak <= plan.certificate.peaks[name] <= peak + 1e-3


def test_a_plan_is_certified_anew_and_what_is_none_is_refused():
    plan = jp.plan(jp.paper_case(4))
    assert jp.certify(plan).certified
    shifted = replace(plan.trajectory, joint_coefficients=plan.trajectory.joint_coefficients + 1e-3)
    assert not jp.certify(replace(plan, trajectory=shifted)).certified
    with pytest.raises(TypeError, match=r"plan must be a Plan, not Scenario; jp\.plan makes one"):
        jp.certify(plan.scenario)
    with pytest.raises(ValueError, match="has no trajectory"):
        jp.certify(replace(plan, trajectory=None))


def test_a_wish_that_no_path_leads_to_is_left_aside():
    along = {"tele": np.eye(3)[2], "star": np.eye(3)[0]}
    craft = spacecraft_of([], along)
    around = np.pi * np.arange(10) / 5
    ring = [
        KeepOut(
            name=f"lamp {k}",
            direction=np.array([-np.cos(0.6), np.sin(0.6) * np.cos(a), np.sin(0.6) * np.sin(a)]),
            half_angle=0.23,
            devices=("star",),
        )
        for k, a in enumerate(around)
    ]
    wish = jp.Wish(device="star", direction=-np.eye(3)[0])
    target = np.array([0.0, 0.6, 0.8])
    goal = Targets.of({"tele": target}, prefer=[wish])
    start = GivenState(rotation_vector=np.zeros(3), joints=np.zeros(0))
    scenario = Scenario(name="x", spacecraft=craft, start=start, goal=goal, keep_out=tuple(ring))
    plan = jp.plan(scenario)
    assert plan.ok
    assert plan.message.startswith("this is not the goal nearest to the wishes: that, 180 deg away, ended as")
    assert "star cannot get from its start direction to its goal direction" in plan.message
    np.testing.assert_allclose(plan.goal.attitude[:, 2], target, rtol=0, atol=1e-7)
    assert plan.goal.slew_angle == pytest.approx(np.arccos(0.8), abs=1e-6)
    alone = jp.plan(replace(scenario, keep_out=()))
    np.testing.assert_allclose(alone.goal.attitude[:, 0], wish.direction, rtol=0, atol=1e-6)
