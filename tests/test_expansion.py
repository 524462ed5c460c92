import jax
import numpy as np
import pytest
from scenes import boresights, edge_states, make_scenario, sampled_margin, scene_of
from scipy.spatial.transform import Rotation

from jaxplan.search import mha, mha_paper
from jaxplan.search.kernels import Expansion, expand
from jaxplan.search.motions import STRAIGHT_INTERVALS
from jaxplan.search.problem import Scene
from jaxplan.search.tree import Moves, Node, chosen, make_root, steps_between
from jaxplan.zones import KeepIn, KeepOut

CLEARANCE = np.deg2rad(0.5)


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


def expansion(scene: Scene, rules, clearance: float, edges: bool, seed: int = 0):
    """A node's moves and what the kernel says of them."""
    node = make_root(scene)
    settings = make_scenario().search
    moves = rules.propose(scene, node, np.random.default_rng(seed), settings)
    wanted = np.full(STRAIGHT_INTERVALS + 1, clearance)
    answer = expand(scene, node.packed, moves.turns, moves.options, moves.choice, wanted, edges=edges)
    return node, moves, answer


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
}


@pytest.mark.parametrize("name", SCENES)
def test_slack_is_a_sound_and_sharp_statement_about_whole_edges(name):
    scene = SCENES[name]()
    node, moves, found = expansion(scene, mha, CLEARANCE, edges=True)
    slacks, straight = found.slacks, found.straight
    joints = node.joints + chosen(moves.options, moves.choice)
    truth = np.array([
        [
            sampled_margin(scene, *edge_states(scene.start_attitude, node.joints, end, q, 41)).min()
            for q in joints
        ]
        for end in ends_of(scene, found).as_matrix()
    ])  # fmt: skip
    accepted = slacks >= 0
    assert np.all(truth[accepted] >= CLEARANCE - 1e-9)
    assert np.all(accepted[truth >= CLEARANCE + np.deg2rad(0.5)])
    if name != "no zones":
        assert 0 < accepted.mean() < 1, "the scene decides nothing"
    along = edge_states(
        scene.start_attitude, node.joints, scene.goal_attitude, scene.goal_joints, 40 * len(straight) + 1
    )
    margins = sampled_margin(scene, *along)
    lowest = np.array([margins[40 * k : 40 * k + 41].min() for k in range(len(straight))])
    assert np.all(lowest[straight >= 0] >= CLEARANCE - 1e-9)
    assert np.all(straight[lowest >= CLEARANCE + np.deg2rad(0.5)] >= 0)


def test_without_edges_the_slack_speaks_of_the_node_alone():
    scene = SCENES["three terminals"]()
    node, moves, found = expansion(scene, mha_paper, 0.0, edges=False)
    joints = node.joints + chosen(moves.options, moves.choice)
    for attitude, row in zip(ends_of(scene, found).as_matrix(), found.slacks, strict=True):
        margin = sampled_margin(scene, np.broadcast_to(attitude, (len(joints), 3, 3)), joints)
        assert np.array_equal(row >= 0, margin >= 0)


def test_attitude_moves_and_heuristics_are_those_of_the_paper():
    scene = SCENES["three terminals"]()
    node, moves, found = expansion(scene, mha_paper, 0.0, edges=False)
    start, goal = Rotation.from_matrix(scene.start_attitude), Rotation.from_matrix(scene.goal_attitude)
    ends = ends_of(scene, found)
    # (10): a whole step on the left of the attitude relative to the start
    relative = start.inv() * ends  # of the root
    assert np.allclose(relative.magnitude(), scene.attitude_step, atol=1e-12)
    assert np.allclose(found.places[:, 4:], (ends.inv() * goal).as_rotvec(), atol=1e-12)
    joints = node.joints + chosen(moves.options, moves.choice)
    cost, heuristics = mha_paper.price(scene, found)
    left = np.abs(joints - scene.goal_joints)
    difference = (start.inv() * ends).as_rotvec() - (start.inv() * goal).as_rotvec()
    expected = [  # (15)
        (ends.inv() * goal).magnitude()[:, None] + left.sum(axis=1),
        np.linalg.norm(difference, axis=1)[:, None] + np.linalg.norm(left, axis=1),
        np.abs(difference).sum(axis=1)[:, None] + left.sum(axis=1),
    ]
    assert np.allclose(heuristics, expected, atol=1e-12)
    assert np.allclose(cost, scene.attitude_step + scene.joint_steps.sum())  # (16)


def test_printed_moves_are_whole_steps_or_end_on_the_goal():
    scene = SCENES["four terminals"]()
    rng = np.random.default_rng(1)
    near = scene.goal_joints + 0.5 * scene.joint_steps * np.array([1, -1, 0, 3, 0.9, -4, 0.1, 1])
    near = np.clip(near, -scene.joint_limits, scene.joint_limits)
    node = Node(np.concatenate([scene.goal_quaternion, np.zeros(3), near]), 0.0, 1.0, None)
    moves = mha_paper.propose(scene, node, rng, make_scenario().search)
    ends = near + chosen(moves.options, moves.choice)
    whole = np.isclose(np.abs(ends - near), scene.joint_steps)
    on_goal = np.isclose(ends, scene.goal_joints) & (np.abs(near - scene.goal_joints) <= scene.joint_steps)
    assert np.all(whole | on_goal)
    assert np.all(np.abs(ends[moves.allowed[0]]) <= scene.joint_limits + 1e-12)
    assert not np.any(moves.allowed[1:]), "on the goal attitude there is one attitude move"
    states = ends[moves.allowed[0]]
    assert len(np.unique(np.round(states, 9), axis=0)) == len(states) or len(states) <= mha_paper.JOINT_MOVES


def test_default_moves_stay_within_the_limits_and_include_the_direct_one():
    scene = SCENES["four terminals"]()
    rng = np.random.default_rng(2)
    at_limit = scene.joint_limits * np.sign(rng.standard_normal(8))
    node = Node(np.concatenate([make_root(scene).packed[:7], at_limit]), 0.0, 1.0, None)
    moves: Moves = mha.propose(scene, node, rng, make_scenario().search)
    ends = at_limit + chosen(moves.options, moves.choice)
    assert np.all(np.abs(ends) <= scene.joint_limits + 1e-12)
    cost = steps_between(scene, np.linalg.norm(moves.turns, axis=1)[:, None], ends - at_limit)
    assert np.all(cost <= 1 + 1e-12)
    assert np.allclose(ends[0] - at_limit, np.clip(scene.goal_joints - at_limit, -0.1, 0.1))


def test_a_second_scene_of_the_same_padded_sizes_compiles_nothing():
    scenes = [
        scene_of(make_scenario(3, keep_out=zones_at_hand(3, 0, count, seed)))
        for count, seed in ((2, 1), (7, 2))
    ]
    settings = make_scenario().search
    mha.search(scenes[0], settings)
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, duration, **_: compiled.append(event) if "backend_compile" in event else None
    )
    mha.search(scenes[1], settings)
    assert not compiled
    jax.jit(lambda x: x + len(compiled))(1.0)
    assert compiled, "the counter does not count"
    jax.monitoring.clear_event_listeners()
