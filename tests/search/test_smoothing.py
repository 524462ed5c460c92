from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario, scene_of, with_search
from reference import assert_each, boresights, edge_margins, edge_states, sampled_margin, step_costs
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Path
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.search import PLANNERS, Scene, SearchResult, astar, mha, smoothing
from jaxplan.search.astar import make_root
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.paths import edge_table, make_path, subdivide
from jaxplan.search.scene import JOINT_RESERVE, TAPER_STEPS, steps_between
from jaxplan.search.smoothing import LENGTHENING


def smooth(scene: Scene, settings: SearchSettings, path: Path) -> Path:
    given = SearchResult(status=Status.OK, path=path, expansions=0)
    return smoothing.smooth_results(Scenes([scene]), [settings], [given])[0].path


def motion(scene: Scene, path: Path) -> float:
    """Steps, and a little of the steps that platform and joints make one by one."""
    turns = Rotation.from_matrix(np.swapaxes(path.attitudes[:-1], 1, 2) @ path.attitudes[1:]).magnitude()
    joints = np.abs(np.diff(path.joints, axis=0)) / scene.joint_steps
    return path.length + 0.01 * float(np.sum(turns) / scene.attitude_step + np.sum(joints))


def straight_states(scene: Scene, samples: int = 201) -> tuple[np.ndarray, np.ndarray]:
    return edge_states(
        scene.start_attitude, scene.start_joints, scene.goal_attitude, scene.goal_joints, samples
    )


def blocked(terminals: int, instruments: int, seed: int = 0, share: float = 0.6) -> Scenario:
    """A scenario whose straight motion leads every device through the middle of a zone of its own."""
    free = make_scenario(terminals, instruments, turn=(1.1, -0.9, 0.5), seed=seed)
    scene = scene_of(free)
    names = free.spacecraft.device_names
    seen = boresights(scene, *straight_states(scene))  # (k, devices, 3)
    angles = np.arccos(np.clip(np.einsum("kdi,di->kd", seen, seen[100]), -1, 1))
    zones = tuple(
        KeepOut(
            name=f"before {name}",
            direction=seen[100, i],
            half_angle=min(share * min(angles[0, i], angles[-1, i]), 0.35),
            devices=(name,),
        )
        for i, name in enumerate(names)
    )
    return replace(free, keep_out=zones)


def found_path(scenario: Scenario, scene: Scene, **changes: object) -> Path:
    """A path that the search has found, and that nobody has cut short."""
    settings = replace(scenario.search, **changes)
    return astar.search_by(mha.rules(scene), Scenes([scene]), [settings])[0].path


def wanted_margins(scene: Scene, path: Path, clearance: float) -> np.ndarray:
    """(edges,) clearance wanted by the steps behind an edge, and straight ahead of it without its own."""
    turns = Rotation.from_matrix(np.swapaxes(path.attitudes[:-1], 1, 2) @ scene.goal_attitude).magnitude()
    ahead = steps_between(scene, turns, scene.goal_joints - path.joints[:-1])
    behind = np.cumsum(path.edge_costs) - path.edge_costs
    steps = np.minimum(behind, ahead - np.maximum(path.edge_costs, 1))
    return clearance * np.clip(steps / TAPER_STEPS, 0, 1)


def assert_sound(scene: Scene, settings: SearchSettings, given: Path, smoothed: Path) -> None:
    """All that is promised of a smoothed path, checked without the code that made it."""
    assert smoothed.length <= LENGTHENING * given.length + 1e-9
    for end in (0, -1):
        np.testing.assert_array_equal(smoothed.attitudes[end], given.attitudes[end])
        np.testing.assert_array_equal(smoothed.joints[end], given.joints[end])
    costs = step_costs(scene, smoothed)
    np.testing.assert_allclose(smoothed.edge_costs, costs, rtol=0, atol=1e-9)
    assert_each(costs, "<=", 1 + 1e-9)
    products = np.swapaxes(smoothed.attitudes, 1, 2) @ smoothed.attitudes
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-12)
    reserve = JOINT_RESERVE * scene.joint_steps
    before = [*given.joints, scene.start_joints, scene.goal_joints]
    least = np.min([*before, scene.joint_ranges[:, 0] + reserve], axis=0)
    most = np.max([*before, scene.joint_ranges[:, 1] - reserve], axis=0)
    assert_each(smoothed.joints, ">=", least - 1e-12)
    assert_each(smoothed.joints, "<=", most + 1e-12)
    margins, had = edge_margins(scene, smoothed, 17), edge_margins(scene, given, 17).min()
    assert_each(margins, ">=", 0)
    # the bound that judges what the path given had may be a hair below its sampled margins
    wanted = wanted_margins(scene, smoothed, settings.clearance)
    assert_each(margins, ">=", np.minimum(wanted, had - 1e-3) - 1e-9)


@pytest.mark.parametrize(("terminals", "instruments"), [(0, 1), (4, 0)])
def test_any_number_of_devices_gets_a_shorter_path_that_keeps_every_promise(terminals, instruments):
    scenario = blocked(terminals, instruments)
    scene = scene_of(scenario)
    assert sampled_margin(scene, *straight_states(scene)).min() < 0, "the straight motion must be blocked"
    for seed in range(3):
        path = found_path(scenario, scene, seed=seed)
        smoothed = smooth(scene, scenario.search, path)
        assert_sound(scene, scenario.search, path, smoothed)
        assert motion(scene, smoothed) < motion(scene, path)


def test_a_zone_that_only_a_joint_has_to_avoid_costs_nothing():
    shortest = []
    for seed in range(6):
        scenario = blocked(3, 0, seed=seed)
        # of three zones the terminals with time to spare keep theirs: their joints need less than half
        scene = scene_of(scenario)
        change = np.abs(scene.goal_joints - scene.start_joints) / scene.joint_steps
        spare = np.maximum(change[:3], change[3:]) < make_root(scene).ahead / 2
        zones = tuple(z for z, idle in zip(scenario.keep_out, spare, strict=True) if idle)
        scenario = replace(scenario, keep_out=zones)
        scene = scene_of(scenario)
        path = found_path(scenario, scene)
        smoothed = smooth(scene, scenario.search, path)
        assert_sound(scene, scenario.search, path, smoothed)
        shortest.append(smoothed.length / make_root(scene).ahead)
    assert min(shortest) >= 1 - 1e-12
    assert np.mean(shortest) <= 1.03


def test_a_detour_around_nothing_becomes_the_straight_motion():
    for terminals, instruments in ((3, 0), (0, 0)):
        scenario = make_scenario(terminals, instruments, turn=(0.9, -1.1, 0.4))
        scene = scene_of(scenario)
        aside = Rotation.from_rotvec([0.2, 0.8, -0.5]).as_quat(scalar_first=True)
        turned = np.stack([[1.0, 0.0, 0.0, 0.0], aside, scene.goal_quaternion])
        joints = np.stack([scene.start_joints, 0.5 * scene.joint_ranges[:, 1], scene.goal_joints])
        path = subdivide(scene, np.concatenate([turned, joints], axis=1))
        smoothed = smooth(scene, scenario.search, path)
        assert_sound(scene, scenario.search, path, smoothed)
        assert smoothed.length == pytest.approx(make_root(scene).ahead, rel=1e-6)
        assert smooth(scene, scenario.search, smoothed).length == pytest.approx(smoothed.length)


def test_a_path_with_long_edges_comes_back_with_edges_of_at_most_a_step():
    scenario = blocked(3, 0)
    scene = scene_of(scenario)
    path = found_path(scenario, scene)
    with_long_edges = make_path(
        scene,
        path.attitudes[[0, *range(1, path.edges, 2), -1]],
        path.joints[[0, *range(1, path.edges, 2), -1]],
    )
    smoothed = smooth(scene, scenario.search, with_long_edges)
    assert smoothed is not with_long_edges
    assert_each(smoothed.edge_costs, "<=", 1 + 1e-9)
    assert_each(edge_margins(scene, smoothed, 17), ">=", 0)


def test_a_straight_path_comes_back_as_it_is():
    for terminals, instruments, turn in (
        (3, 0, (0.3, -0.5, 0.4)),
        (0, 2, (0.0, 0.0, np.pi)),
        (2, 0, (0, 0, 0)),
    ):
        scenario = make_scenario(terminals, instruments, turn=turn)
        scene = scene_of(scenario)
        path = PLANNERS["mha"](scene, scenario.search).path
        assert smooth(scene, scenario.search, path) is path


@pytest.mark.parametrize("lost", ["attitude", "joint"])
def test_a_node_that_is_no_number_is_never_clear(lost):
    scenario = blocked(3, 0)
    scene = scene_of(scenario)
    path = found_path(scenario, scene)
    attitudes, joints = smoothing.padded(path.attitudes, path.joints, smoothing.EDGES)
    (attitudes if lost == "attitude" else joints)[5] = np.nan
    call = Call(edge_table, (attitudes, joints, scenario.search.clearance))
    margins, slacks = Scenes([scene]).answers([call])[0][:2]
    np.testing.assert_array_equal(margins[4:6] >= 0, False)
    np.testing.assert_array_equal(slacks[4:6] >= 0, False)


def test_start_equal_to_goal_comes_back_as_it_is():
    scenario = make_scenario(3)
    scene = scene_of(replace(scenario, goal=scenario.start))
    path = PLANNERS["mha"](scene, scenario.search).path
    assert path.edges == 0
    assert smooth(scene, scenario.search, path) is path


def grouped() -> Scenario:
    """Two cameras of which one must see its own cone at any time, and terminals with zones on their way."""
    scenario = blocked(2, 2, seed=3)
    scene = scene_of(scenario)
    seen = boresights(scene, *straight_states(scene))[:, 2:]
    # the first camera's cone is about where it looks at first, the second's about where it looks at last
    reach = [float(np.arccos(seen[110, 0] @ seen[0, 0])), float(np.arccos(seen[90, 1] @ seen[-1, 1]))]
    group = tuple(
        KeepIn(
            name=f"guide {i + 1}",
            direction=seen[-i, i],
            half_angle=reach[i] + 0.05,
            devices=(f"camera-{i + 1}",),
            any_of="guide",
        )
        for i in range(2)
    )
    return replace(scenario, keep_out=scenario.keep_out[:2], keep_in=group)


def test_a_group_may_change_hands_but_holds_at_every_instant():
    scenario = grouped()
    scene = scene_of(scenario)
    assert scene.grouped_cones.half_angle.shape[0]
    path = found_path(scenario, scene)
    smoothed = smooth(scene, scenario.search, path)
    assert_sound(scene, scenario.search, path, smoothed)
    assert smoothed.length < path.length
    alone = replace(scenario, keep_in=tuple(replace(zone, any_of=None) for zone in scenario.keep_in))
    assert edge_margins(scene_of(alone), smoothed, 17).min() < 0, "no camera holds all the way"


def test_a_path_without_the_wanted_clearance_keeps_what_it_has():
    scenario = blocked(3, 0, seed=1)
    scene = scene_of(scenario)
    settings = replace(scenario.search, clearance=np.deg2rad(8.0))  # more than there is room for
    path = found_path(scenario, scene, clearance=0.0)
    assert np.any(edge_margins(scene, path, 17) < wanted_margins(scene, path, settings.clearance))
    assert_sound(scene, settings, path, smooth(scene, settings, path))
    bare = smooth(scene, replace(settings, clearance=0.0), path)
    assert_sound(scene, replace(settings, clearance=0.0), path, bare)
    assert bare.length < path.length


def test_the_same_path_gives_the_same_answer():
    scenario = blocked(3, 0)
    scene = scene_of(scenario)
    path = found_path(scenario, scene)
    first, again = (smooth(scene, scenario.search, path) for _ in range(2))
    np.testing.assert_array_equal(first.attitudes, again.attitudes)
    np.testing.assert_array_equal(first.joints, again.joints)


def test_a_second_scene_of_the_same_padded_sizes_compiles_nothing(compilations):
    problems = []
    for seed in range(4):
        scenario = blocked(3, 0, seed=seed)
        scene = scene_of(scenario)
        problems.append((scene, scenario.search, found_path(scenario, scene)))
    for scene, settings, path in problems[:2]:
        smooth(scene, settings, path)
        smooth(scene, replace(settings, clearance=0.14), path)  # more than the path has
    compilations.clear()
    for problem in problems[2:]:
        smooth(*problem)
    assert compilations == []


@pytest.mark.parametrize("kind", ["keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links"])
def test_random_scenes_get_paths_that_keep_every_promise(kind):
    from jaxplan.cases import random_scenario
    from jaxplan.planner.steps import find_goals

    shorter = 0
    for seed in range(3):
        scenario = random_scenario(seed, kind)
        scene = scene_of(scenario, find_goals(scenario)[0])
        path = found_path(with_search(scenario, max_expansions=300), scene)
        if path is not None:
            smoothed = smooth(scene, scenario.search, path)
            assert_sound(scene, scenario.search, path, smoothed)
            shorter += motion(scene, smoothed) < motion(scene, path)
    assert shorter >= (3 if kind.startswith(("hard", "held")) else 0)
