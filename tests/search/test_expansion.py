import jax
import numpy as np
import pytest
from builders import make_scenario, scene_of
from oblique import oblique_scenario
from reference import assert_each, boresights, edge_states, sampled_margin
from scipy.spatial.transform import Rotation

from jaxplan.cases import random_scenario
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.paper import search as paper
from jaxplan.search import PLANNERS, mha
from jaxplan.search import expansion as kernels
from jaxplan.search.astar import Node, make_root
from jaxplan.search.expansion import (
    EDGE_INTERVALS,
    ONWARD_INTERVALS,
    Expansion,
    Moves,
    chosen,
    expansion_call,
)
from jaxplan.search.fields import SIZE, distance_fields, look_up, no_fields
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.paths import STRAIGHT_INTERVALS, straight_call
from jaxplan.search.scene import Scene, steps_between
from jaxplan.study.printed_planners import make_problem

CLEARANCE = np.deg2rad(0.5)
IN_THE_SKY = ("sun", "station", "shade-1", "shade-2")
LAST_SCALE = len(mha.SCALES) - 1  # the number of an expansion with short moves


def zones_at_hand(
    terminals: int, instruments: int, count: int, seed: int, devices: tuple[str, ...] = ()
) -> tuple[KeepOut, ...]:
    """Keep-out zones whose edges are a few degrees from where the devices look at the start."""
    rng = np.random.default_rng(seed)
    scene = scene_of(make_scenario(terminals, instruments))
    seen = boresights(scene, scene.start_attitude[None], scene.start_joints[None])[0]
    zones = []
    for i in range(count):
        axis, half_angle = np.cross(seen[i % len(seen)], rng.standard_normal(3)), rng.uniform(0.2, 0.4)
        turn = Rotation.from_rotvec(
            axis / np.linalg.norm(axis) * (half_angle + np.deg2rad(rng.uniform(3, 8)))
        )
        direction = turn.apply(seen[i % len(seen)])
        zones.append(KeepOut(name=f"Z{i}", direction=direction, half_angle=half_angle, devices=devices))
    return tuple(zones)


def zoned(terminals: int, instruments: int, count: int, devices: tuple[str, ...] = ()) -> Scene:
    keep_out = zones_at_hand(terminals, instruments, count, 10 * terminals + instruments, devices)
    return scene_of(make_scenario(terminals, instruments, keep_out=keep_out))


def grouped_scene() -> Scene:
    """Two ground stations of which one must be seen by two terminals, and keep-out zones."""
    scene = scene_of(make_scenario(3, 1))
    seen = boresights(scene, scene.start_attitude[None], scene.start_joints[None])[0]
    apart = np.arccos(seen[0] @ seen[1])
    stations = tuple(
        KeepIn(
            name=f"station-{i}",
            direction=seen[i],
            half_angle=apart + np.deg2rad(2.0 + 3 * i),
            devices=("terminal-1", "terminal-2"),
            any_of="ground",
        )
        for i in range(2)
    )
    return scene_of(make_scenario(3, 1, keep_out=zones_at_hand(3, 1, 1, 3), keep_in=stations))


def answer(scene: Scene, call: Call) -> np.ndarray:
    return Scenes([scene]).answers([call])[0]


def expanded(
    scene: Scene, node: Node, moves: Moves, wanted: np.ndarray, table: np.ndarray, edges: bool
) -> Expansion:
    call = expansion_call(node.packed, moves, wanted, table, edges=edges)
    return kernels.expansion(answer(scene, call), moves, edges=edges)


def expansion(scene: Scene, rules, clearance: float, edges: bool, seed: int = 0):
    """A node's moves and what the kernel says of them."""
    node = make_root(scene)
    settings = make_scenario().search
    moves = rules.propose(scene, node, np.random.default_rng(seed), settings, LAST_SCALE)
    wanted = np.full(EDGE_INTERVALS + ONWARD_INTERVALS, clearance)
    table = no_fields(scene).table
    return node, moves, expanded(scene, node, moves, wanted, table, edges)


def ends_of(scene: Scene, expansion: Expansion) -> Rotation:
    """The attitudes that the moves lead to."""
    since = Rotation.from_quat(expansion.places[:, :4], scalar_first=True)
    return Rotation.from_matrix(scene.start_attitude) * since


SCENES = {
    "no terminals": lambda: zoned(0, 2, 4),
    "one terminal": lambda: zoned(1, 1, 4),
    "two terminals": lambda: zoned(2, 0, 4),
    "three terminals": lambda: zoned(3, 0, 3),
    "four terminals": lambda: zoned(4, 1, 4, ("terminal-4", "terminal-2")),
    "no zones": lambda: scene_of(make_scenario(3)),
    "groups": grouped_scene,
    "odd mounts and drives": lambda: scene_of(oblique_scenario(2, 2, 1, seed=2, kinds=IN_THE_SKY)),
    "drives alone": lambda: scene_of(oblique_scenario(0, 2, 1, seed=1, kinds=IN_THE_SKY)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_slack_is_a_sound_and_sharp_statement_about_whole_edges(name):
    scene = SCENES[name]()
    node, moves, found = expansion(scene, mha, CLEARANCE, edges=True)
    slacks, ends = found.slacks, ends_of(scene, found).as_matrix()
    every = np.broadcast_to(moves.options, (len(ends), *moves.options.shape[1:]))  # one set, or one an end
    joints = np.array([node.joints + chosen(options, moves.choice) for options in every])
    truth = np.array([
        [
            sampled_margin(scene, *edge_states(scene.start_attitude, node.joints, end, q, 41)).min()
            for q in row
        ]
        for end, row in zip(ends, joints, strict=True)
    ])  # fmt: skip
    accepted = slacks >= 0
    assert_each(truth[accepted], ">=", CLEARANCE - 1e-9)
    np.testing.assert_array_equal(accepted[truth >= CLEARANCE + np.deg2rad(0.5)], True)
    if name != "no zones":
        assert 0 < accepted.mean() < 1, "the scene decides nothing"
    # onward the bound is coarser: sound, and sharp where there is room
    for attitude, reached, row, clear in zip(ends, joints, found.onward, accepted, strict=True):
        for q, slack, possible in list(zip(reached, row, clear, strict=True))[::5]:
            if possible:
                onward = edge_states(attitude, q, scene.goal_attitude, scene.goal_joints, 81)
                lowest = sampled_margin(scene, *onward).min()
                assert slack < 0 or lowest >= CLEARANCE - 1e-9
                assert slack >= 0 or lowest < np.deg2rad(3)


@pytest.mark.parametrize("name", SCENES)
def test_slack_of_the_straight_motion_is_sound_and_sharp_on_each_interval(name):
    scene = SCENES[name]()
    root = make_root(scene)
    straight = answer(scene, straight_call(scene, np.full(STRAIGHT_INTERVALS, CLEARANCE)))
    along = edge_states(
        scene.start_attitude,
        root.joints,
        scene.goal_attitude,
        scene.goal_joints,
        40 * STRAIGHT_INTERVALS + 1,
    )
    margins = sampled_margin(scene, *along)
    lowest = np.array([margins[40 * k : 40 * k + 41].min() for k in range(STRAIGHT_INTERVALS)])
    assert_each(lowest[straight >= 0], ">=", CLEARANCE - 1e-9)
    assert_each(straight[lowest >= CLEARANCE + np.deg2rad(0.5)], ">=", 0)


def test_without_edges_the_slack_speaks_of_the_node_alone():
    scene = SCENES["three terminals"]()
    node, moves, found = expansion(scene, paper, 0.0, edges=False)
    joints = node.joints + chosen(moves.options[0], moves.choice)
    for attitude, row in zip(ends_of(scene, found).as_matrix(), found.slacks, strict=True):
        margin = sampled_margin(scene, np.broadcast_to(attitude, (len(joints), 3, 3)), joints)
        np.testing.assert_array_equal(row >= 0, margin >= 0)


def test_without_edges_what_lies_between_is_not_looked_at():
    scene = SCENES["no zones"]()
    node, moves, found = expansion(scene, paper, 0.0, edges=False)
    end, joints = ends_of(scene, found).as_matrix()[0], node.joints + chosen(moves.options[0], moves.choice)
    halfway = edge_states(scene.start_attitude, node.joints, end, joints[0], 3)
    seen = boresights(scene, *(state[1:2] for state in halfway))[0, 0]
    zone = KeepOut(name="between", direction=seen, half_angle=np.deg2rad(0.5), devices=("terminal-1",))
    scene = scene_of(make_scenario(3, keep_out=(zone,)))
    assert expansion(scene, paper, 0.0, edges=False)[2].slacks[0, 0] > 0
    assert expansion(scene, paper, 0.0, edges=True)[2].slacks[0, 0] < 0


def test_without_devices_nothing_is_in_the_way():
    zone = KeepOut(name="Sun", direction=np.array([1.0, 0, 0]), half_angle=0.5)
    scene = scene_of(make_scenario(0, 0, keep_out=(zone,)))
    straight = answer(scene, straight_call(scene, np.zeros(STRAIGHT_INTERVALS)))
    assert_each(straight, "==", np.inf)
    found = expansion(scene, mha, CLEARANCE, edges=True)[2]
    assert_each(found.slacks, "==", np.inf)
    assert_each(found.onward, "==", np.inf)
    assert_each(found.fields, "==", 0)


def test_attitude_moves_and_heuristics_are_those_of_the_paper():
    scene = SCENES["three terminals"]()
    node, moves, found = expansion(scene, paper, 0.0, edges=False)
    start, goal = Rotation.from_matrix(scene.start_attitude), Rotation.from_matrix(scene.goal_attitude)
    ends = ends_of(scene, found)
    # (10): a whole step on the left of the attitude relative to the start
    relative = start.inv() * ends  # of the root
    np.testing.assert_allclose(relative.magnitude(), scene.attitude_step, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.places[:, 4:], (ends.inv() * goal).as_rotvec(), rtol=0, atol=1e-12)
    joints = node.joints + chosen(moves.options[0], moves.choice)
    cost, heuristics = paper.price(scene, found, no_fields(scene))
    left = np.abs(joints - scene.goal_joints)
    difference = (start.inv() * ends).as_rotvec() - (start.inv() * goal).as_rotvec()
    expected = [  # (15)
        (ends.inv() * goal).magnitude()[:, None] + left.sum(axis=1),
        np.linalg.norm(difference, axis=1)[:, None] + np.linalg.norm(left, axis=1),
        np.abs(difference).sum(axis=1)[:, None] + left.sum(axis=1),
    ]
    np.testing.assert_allclose(heuristics, expected, rtol=0, atol=1e-12)
    angles_left = (ends.inv() * goal).magnitude()[:, None]
    np.testing.assert_allclose(
        found.heuristics[0], steps_between(scene, angles_left, left), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(cost, scene.attitude_step + scene.joint_steps.sum(), rtol=1e-12)  # (16)


def test_printed_moves_are_whole_steps_or_end_on_the_goal():
    scene = SCENES["four terminals"]()
    rng = np.random.default_rng(1)
    near = scene.goal_joints + 0.5 * scene.joint_steps * np.array([1, -1, 0, 3, 0.9, -4, 0.1, 1])
    near = np.clip(near, -scene.joint_ranges[:, 1], scene.joint_ranges[:, 1])
    node = Node(np.concatenate([scene.goal_quaternion, np.zeros(3), near]), 0.0, 1.0, None)
    moves = paper.propose(scene, node, rng, make_scenario().search, 0)
    ends = near + chosen(moves.options[0], moves.choice)
    whole = np.isclose(np.abs(ends - near), scene.joint_steps)
    on_goal = np.isclose(ends, scene.goal_joints) & (np.abs(near - scene.goal_joints) <= scene.joint_steps)
    np.testing.assert_array_equal(whole | on_goal, True)
    assert_each(np.abs(ends[moves.allowed[0]]), "<=", scene.joint_ranges[:, 1] + 1e-12)
    assert not np.any(moves.allowed[1:]), "on the goal attitude there is one attitude move"
    states = ends[moves.allowed[0]]
    assert len(np.unique(np.round(states, 9), axis=0)) == len(states) or len(states) <= paper.JOINT_MOVES


def test_default_moves_stay_within_the_limits_and_include_the_direct_one():
    scene = SCENES["four terminals"]()
    rng = np.random.default_rng(2)
    at_limit = scene.joint_ranges[:, 1] * np.sign(rng.standard_normal(8))
    node = Node(np.concatenate([make_root(scene).packed[:7], at_limit]), 0.0, 1.0, None)
    moves: Moves = mha.propose(scene, node, rng, make_scenario().search, 1)
    ends = at_limit + chosen(moves.options[0], moves.choice)
    assert_each(np.abs(ends), "<=", scene.joint_ranges[:, 1] + 1e-12)
    cost = steps_between(scene, np.linalg.norm(moves.turns, axis=1)[:, None], ends - at_limit)
    assert_each(cost, "<=", mha.SCALES[1] + 1e-12)
    longest = 0.1 * mha.SCALES[1]
    np.testing.assert_allclose(
        ends[0] - at_limit, np.clip(scene.goal_joints - at_limit, -longest, longest), rtol=1e-12
    )


def test_fields_lead_around_zones():
    scene = scene_of(make_scenario(1, keep_out=zones_at_hand(1, 0, 4, 5)))
    fields = distance_fields(scene)
    assert fields.table.shape == (1, SIZE, SIZE)
    node = make_root(scene)
    moves = mha.propose(scene, node, np.random.default_rng(0), make_scenario().search, 1)
    wanted = np.zeros(EDGE_INTERVALS + ONWARD_INTERVALS)
    found = expanded(scene, node, moves, wanted, fields.table, edges=True)
    joints = node.joints + chosen(moves.options[0], moves.choice)
    goal = boresights(scene, scene.goal_attitude[None], scene.goal_joints[None])[0, 0]
    for row, attitude in zip(found.fields[0], ends_of(scene, found).as_matrix(), strict=True):
        seen = boresights(scene, np.broadcast_to(attitude, (len(joints), 3, 3)), joints)[:, 0]
        straight = np.arccos(np.clip(seen @ goal, -1, 1))
        assert_each(row, ">=", straight - 0.2, "no way is shorter than the straight one, but for the grid")
    np.testing.assert_allclose(
        found.fields[0], found.fields[1], rtol=1e-12
    )  # with one device the sum is the largest


@pytest.mark.parametrize("edges", [True, False])
def test_every_child_is_told_what_the_fields_say_where_its_move_ends(edges):
    scene = SCENES["two terminals"]()
    node, rng = make_root(scene), np.random.default_rng(0)
    table = rng.uniform(0, 3, (2, SIZE, SIZE))
    moves = mha.propose(scene, node, rng, make_scenario().search, 1)
    wanted = np.zeros(EDGE_INTERVALS + ONWARD_INTERVALS)
    found = expanded(scene, node, moves, wanted, table, edges)
    ends = ends_of(scene, found).as_matrix()
    every = np.broadcast_to(moves.options, (len(ends), *moves.options.shape[1:]))
    count = len(moves.choice)
    seen = np.array([
        boresights(scene, np.broadcast_to(end, (count, 3, 3)), node.joints + chosen(options, moves.choice))
        for end, options in zip(ends, every, strict=True)
    ])  # fmt: skip
    told = np.asarray(look_up(table, np.moveaxis(seen, -1, 0)))
    np.testing.assert_allclose(found.fields, [told.sum(axis=-1), told.max(axis=-1)], rtol=0, atol=1e-12)


def test_without_zones_fields_are_distances_on_the_sphere():
    scene = scene_of(make_scenario(2, 1))
    fields = distance_fields(scene)
    start = boresights(scene, scene.start_attitude[None], scene.start_joints[None])[0]
    goal = boresights(scene, scene.goal_attitude[None], scene.goal_joints[None])[0]
    angles = np.arccos(np.clip(np.sum(start * goal, axis=1), -1, 1))
    assert_each(np.abs(fields.start - angles), "<=", 0.1 + 0.15 * angles)


@pytest.mark.slow
def test_a_second_scene_of_the_same_padded_sizes_compiles_nothing(compilations):
    search, settings = PLANNERS["mha"], make_scenario().search
    hard = [make_problem(random_scenario(seed, "hard_keep_out")) for seed in (3, 10, 15)]
    assert all(search(scene, settings).expansions for scene in hard[:-1]), "all must be compiled"
    few = [scene_of(make_scenario(3, keep_out=zones_at_hand(3, 0, count, 4))) for count in (3, 7)]
    compilations.clear()
    for scene in (*few, *hard[-1:]):
        search(scene, settings)
    assert compilations == []
    jax.jit(lambda x: x + 1.5)(1.0)
    assert compilations, "the counter does not count"
