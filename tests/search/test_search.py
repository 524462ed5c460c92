from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario, scene_of, with_search
from reference import assert_each, assert_leads, boresights, edge_margins, edge_states, sampled_margin
from scipy.spatial.transform import Rotation

from jaxplan.cases import paper_case, random_scenario
from jaxplan.model.path import Goal
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepOut
from jaxplan.planner.steps import find_goals
from jaxplan.search import PLANNERS, Scene, SearchResult, mha
from jaxplan.search.scene import steps_between

# Equations (50) and (53): attitude as rotation vector, yaws, pitches.
PUBLISHED_GOALS = {
    1: ([0.4025, 1.3486, 1.4256], [0.6032, 1.5359, -0.2236, 0.0253, -0.1317, -0.1396]),
    2: ([1.9598, 1.2862, 1.8662], [-0.7386, 0.2610, -1.5359, -0.1394, -0.0092, 0.1396]),
    3: ([0.1547, -0.1803, 1.5131], [0.6137, 1.5359, -0.5119, -0.0080, 0.1017, -0.2269]),
    4: ([0.5993, 2.1165, 1.2377], [0.5054, 1.5359, -0.3006, 0.0717, -0.2269, -0.0151]),
}


def published_scene(number: int) -> Scene:
    attitude, joints = PUBLISHED_GOALS[number]
    goal = Goal(attitude=Rotation.from_rotvec(attitude).as_matrix(), joints=np.array(joints), slew_angle=0.0)
    return scene_of(paper_case(number), goal)


def solve(scene: Scene, number: int, method: str, **changes: object) -> SearchResult:
    return PLANNERS[method](scene, replace(paper_case(number).search, method=method, **changes))


def needed_steps(scene: Scene) -> float:
    turn = Rotation.from_matrix(scene.start_attitude.T @ scene.goal_attitude).magnitude()
    return float(steps_between(scene, turn, scene.goal_joints - scene.start_joints))


@pytest.mark.paper
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_both_variants_solve_the_papers_cases(number):
    scene = published_scene(number)
    for method in ("mha", "mha-paper"):
        result = solve(scene, number, method)
        assert result.status is Status.OK
        path = result.path
        assert_leads(scene, path)
        assert_each(sampled_margin(scene, path.attitudes, path.joints), ">=", 0)
        assert result.expansions == sum(result.queue_expansions)


@pytest.mark.paper
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_default_paths_are_clear_along_every_edge_and_near_the_shortest(number):
    scene = published_scene(number)
    extra = []
    for seed in range(5):
        result = solve(scene, number, "mha", seed=seed)
        assert_each(edge_margins(scene, result.path), ">=", 0)
        extra.append(result.path.length - needed_steps(scene))
    assert min(extra) >= -1e-9
    assert extra[0] <= 2 + 1e-9, "the case file's own seed"
    assert np.median(extra) <= 2 + 1e-9


def test_edges_keep_the_wanted_clearance_away_from_start_and_goal():
    scene = published_scene(3)
    wanted = np.deg2rad(0.5)
    margins = edge_margins(scene, solve(scene, 3, "mha", clearance=wanted).path)
    assert_each(margins[4:-4], ">=", wanted - 1e-9)
    bare = edge_margins(scene, solve(scene, 3, "mha", clearance=0.0).path)
    assert_each(bare, ">=", 0)


def test_the_same_seed_gives_the_same_path_and_another_seed_another():
    scene = published_scene(3)
    for method in ("mha", "mha-paper"):
        first, again, other = (solve(scene, 3, method, seed=seed) for seed in (4, 4, 5))
        np.testing.assert_array_equal(first.path.attitudes, again.path.attitudes)
        np.testing.assert_array_equal(first.path.joints, again.path.joints)
        assert first.queue_expansions == again.queue_expansions
    assert first.path.joints.shape != other.path.joints.shape or not np.array_equal(
        first.path.joints, other.path.joints
    )


@pytest.mark.slow
@pytest.mark.parametrize(("terminals", "instruments"), [(0, 1), (2, 2), (4, 0), (12, 1)])
def test_any_number_of_devices_finds_a_way_round_a_zone_on_the_straight_motion(terminals, instruments):
    free = scene_of(make_scenario(terminals, instruments))
    attitudes, joints = edge_states(
        free.start_attitude, free.start_joints, free.goal_attitude, free.goal_joints, 101
    )
    seen = boresights(free, attitudes, joints)[:, -1]  # of the last device
    nearest_end = np.arccos(max(seen[0] @ seen[50], seen[-1] @ seen[50]))
    zone = KeepOut(
        name="Sun", direction=seen[50], half_angle=0.6 * nearest_end, devices=(device_names(free)[-1],)
    )
    scenario = with_search(make_scenario(terminals, instruments, keep_out=(zone,)), attitude_step=0.05)
    scene = scene_of(scenario)
    assert sampled_margin(scene, attitudes, joints).min() < 0, "the straight motion must be blocked"
    result = PLANNERS["mha"](scene, scenario.search)
    assert result.status is Status.OK
    assert_each(edge_margins(scene, result.path, 51), ">=", 0)


def device_names(scene: Scene) -> list[str]:
    terminals, cameras = scene.gimbals.count, len(scene.fixed_boresights)
    return [f"terminal-{i + 1}" for i in range(terminals)] + [f"camera-{i + 1}" for i in range(cameras)]


def test_start_equal_to_goal_is_a_path_of_one_node():
    scenario = make_scenario(3)
    scene = scene_of(replace(scenario, goal=scenario.start))
    for search in PLANNERS.values():
        result = search(scene, scenario.search)
        assert result.status is Status.OK
        assert result.path.edges == 0
        assert result.path.attitudes.shape == (1, 3, 3)
        assert result.path.joints.shape == (1, 6)


def test_half_a_turn_is_a_straight_motion_like_any_other():
    scene = scene_of(make_scenario(3, turn=(0.0, 0.0, np.pi)))
    result = PLANNERS["mha"](scene, make_scenario(3).search)
    assert result.status is Status.OK
    assert result.path.length == pytest.approx(np.pi / 0.1, abs=1e-9)


def enclosed_scene() -> Scene:
    """A telescope at the centre of a ring of zones that nothing passes."""
    scene = scene_of(make_scenario(0, 1))
    axis = boresights(scene, scene.start_attitude[None], scene.start_joints[None])[0, 0]
    side = np.cross(axis, [0.3, -0.4, 0.5])
    ring = [
        Rotation.from_rotvec(axis * angle).apply(
            Rotation.from_rotvec(side / np.linalg.norm(side) * 0.6).apply(axis)
        )
        for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ]
    zones = tuple(KeepOut(name=f"Z{i}", direction=v, half_angle=0.35) for i, v in enumerate(ring))
    return scene_of(make_scenario(0, 1, keep_out=zones, turn=(1.9, 1.9, 0.0)))


@pytest.mark.slow
def test_further_searches_shorten_the_path_and_stay_within_the_effort():
    shorter = 0
    for seed in (3, 10, 15, 17, 19):  # scenes whose straight motion cannot be bent clear
        scenario = random_scenario(seed, "hard_keep_out")
        scene = scene_of(scenario, find_goals(scenario)[0])
        once = PLANNERS["mha"](scene, scenario.search)
        settings = replace(scenario.search, improvements=4)
        more, again = (PLANNERS["mha"](scene, settings) for _ in range(2))
        assert once.expansions <= more.expansions
        assert sum(more.queue_expansions) == more.expansions
        assert more.path.length <= once.path.length
        assert_each(edge_margins(scene, more.path, 21), ">=", 0)
        np.testing.assert_array_equal(more.path.joints, again.path.joints)
        shorter += more.path.length < once.path.length - 1e-6
        for most in (1, once.expansions, once.expansions + 30):
            limited = PLANNERS["mha"](scene, replace(settings, improvements=50, max_expansions=most))
            assert limited.expansions <= most
    assert shorter >= 1
    spent = PLANNERS["mha"](scene, replace(scenario.search, improvements=50, time_limit=1e-9))
    assert spent.path is None or spent.expansions <= 2, "no time is left for another"


def test_instead_of_a_detour_others_are_looked_for(monkeypatch):
    scenes = []
    for seed in (10, 17, 149, 178, 217):
        scenario = random_scenario(seed, "hard_keep_out")
        scenes.append((scene_of(scenario, find_goals(scenario)[0]), scenario.search))
    looked = [PLANNERS["mha"](*one) for one in scenes]
    monkeypatch.setattr(mha, "DETOUR_LOOKS", 0)
    first = [PLANNERS["mha"](*one) for one in scenes]
    for (scene, _), before, after in zip(scenes, first, looked, strict=True):
        detour = before.path.length > mha.DETOUR * scene.straight_steps
        assert after.path.length <= before.path.length
        assert (after.expansions > before.expansions) == detour
        assert_each(edge_margins(scene, after.path, 21), ">=", 0)
    # Which of them begin with a detour is a matter of last digits.
    assert sum(one.path.length for one in looked) < 0.9 * sum(one.path.length for one in first)


def test_a_bent_straight_motion_is_kept_where_no_search_finds_a_better_path():
    scenario = random_scenario(6, "hard_keep_out")  # bent clear, to 1.025 times its length
    scene = scene_of(scenario, find_goals(scenario)[0])
    bent = PLANNERS["mha"](scene, scenario.search)
    assert (bent.status, bent.expansions) == (Status.OK, 0)
    tried = PLANNERS["mha"](scene, replace(scenario.search, improvements=3, max_expansions=1))
    assert (tried.status, tried.expansions) == (Status.OK, 1)
    np.testing.assert_array_equal(tried.path.joints, bent.path.joints)


def test_a_search_that_cannot_succeed_ends_at_its_limits():
    settings = replace(make_scenario().search, max_expansions=20)
    scene = enclosed_scene()
    for search in PLANNERS.values():
        spent = search(scene, settings)
        assert (spent.status, spent.path, spent.expansions) == (Status.NODE_LIMIT, None, 20)
        late = search(scene, replace(settings, time_limit=0.0))
        assert (late.status, late.path) == (Status.TIME_LIMIT, None)
