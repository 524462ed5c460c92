from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import make_scenario, named_craft, scene_of
from reference import boresights, unit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from jaxplan.cases import paper_case
from jaxplan.model.path import Goal
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.search import Scene
from jaxplan.search.barriers import TOLERANCE, Barrier, find_barrier, separating_caps, separating_zones

Caps = tuple[np.ndarray, np.ndarray]  # (Z, 3) axes and (Z,) half-angles, rad
NORTH, SOUTH = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])


def margins(caps: Caps, directions: np.ndarray) -> np.ndarray:
    """(...) rad outside the worst cap."""
    axes, half_angles = caps
    angles = np.arccos(np.clip(directions @ axes.T, -1, 1))
    return np.min(angles - half_angles, axis=-1, initial=np.inf)


# --- an oracle that knows nothing of circles: flood fill over points of the sphere


class Grid:
    """Fibonacci points, each linked to all within twice the covering radius."""

    def __init__(self, count: int) -> None:
        turn, height = np.pi * (3 - np.sqrt(5)) * np.arange(count), 1 - (2 * np.arange(count) + 1) / count
        level = np.sqrt(1 - height**2)
        self.points = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=-1)
        # every direction is at most this far from a point: the widest empty circle through three of them
        self.covering = np.arccos(np.min(-ConvexHull(self.points).equations[:, 3])) * 1.001
        self.tree = cKDTree(self.points)
        self.links = self.tree.query_pairs(2 * np.sin(self.covering), output_type="ndarray")

    def connected(self, caps: Caps, start: np.ndarray, goal: np.ndarray) -> bool | None:
        """Whether two free directions are connected outside the caps, None where the grid cannot tell.

        A curve of margin >= 0 has a chain of points near it, of margin at least minus the covering radius and
        each linked to the next. A link between two points of margin at least the covering radius is free.
        """
        ends = self.tree.query([start, goal])[1]
        depth = margins(caps, self.points)
        if not self._linked(depth >= -self.covering, ends):
            return False
        near = [margins(caps, direction) for direction in (start, goal)]
        if min(near) >= self.covering and self._linked(depth >= self.covering, ends):
            return True
        return None

    def _linked(self, free: np.ndarray, ends: np.ndarray) -> bool:
        first, second = self.links[free[self.links].all(axis=1)].T
        size = len(self.points)
        graph = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(size, size))
        labels = connected_components(graph, directed=False)[1]
        return bool(free[ends].all() and labels[ends[0]] == labels[ends[1]])


@cache
def grid() -> Grid:
    return Grid(20_000)


# --- scenes of caps


def ring(count: int, colatitude: float, overlap: float) -> Caps:
    """Caps of equal size around the north pole, each overlapping the next by an angle (a gap below 0)."""
    azimuth = 2 * np.pi * np.arange(count) / count
    level, height = np.sin(colatitude), np.cos(colatitude)
    axes = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.full(count, height)], axis=-1)
    apart = 2 * np.arcsin(level * np.sin(np.pi / count))
    return axes, np.full(count, (apart + overlap) / 2)


def joined(*parts: Caps) -> Caps:
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def scattered(rng: np.random.Generator, count: int, low_deg: float, high_deg: float) -> Caps:
    return unit(rng.standard_normal((count, 3))), np.deg2rad(rng.uniform(low_deg, high_deg, count))


def noisy_ring(rng: np.random.Generator) -> Caps:
    """A ring around the pole of random sizes, closed or not, with other caps about."""
    axes, half = ring(int(rng.integers(3, 9)), rng.uniform(0.4, 2.6), np.deg2rad(rng.uniform(-6, 12)))
    return joined(
        (unit(axes + 0.05 * rng.standard_normal(axes.shape)), half),
        scattered(rng, int(rng.integers(4)), 5, 20),
    )


def kept_in(rng: np.random.Generator) -> Caps:
    """What is outside of a cone to be kept, and a row of cones across it, closed or not."""
    half, count = np.deg2rad(rng.uniform(25, 70)), int(rng.integers(2, 6))
    tilt = np.linspace(-1, 1, count) * half * rng.uniform(0.7, 1.0)
    row = np.stack([np.sin(tilt), rng.uniform(-0.1, 0.1, count) * half, np.cos(tilt)], axis=-1)
    size = half / (count - 1) * rng.uniform(0.7, 1.5)
    return joined((SOUTH[None], np.array([np.pi - half])), (unit(row), np.full(count, size)))


def large(rng: np.random.Generator) -> Caps:
    """Two caps of more than 90 deg that overlap on both sides, and a row of cones across what they leave."""
    axes, half_angles = kept_in(rng)
    second = unit(SOUTH + 0.3 * rng.standard_normal(3))
    return joined((axes, half_angles), (second[None], np.deg2rad(rng.uniform(95, 120, 1))))


def nested(rng: np.random.Generator) -> Caps:
    """Rings with each cap twice and smaller caps within."""
    axes, half = noisy_ring(rng)
    inner = unit(axes + 0.1 * half[:, None] * rng.standard_normal(axes.shape))
    return joined((axes, half), (axes, half), (inner, half * 0.5))


def belt(rng: np.random.Generator) -> Caps:
    """A chain of caps on a great circle through both poles, some of them missing."""
    count = int(rng.integers(6, 12))
    angle = 2 * np.pi * np.arange(count) / count
    kept = rng.uniform(size=count) > rng.choice([0.0, 0.1])
    axes = np.stack([np.sin(angle), np.zeros(count), np.cos(angle)], axis=-1)
    return axes[kept], np.full(count, np.pi / count)[kept] * rng.uniform(0.95, 1.4)


KINDS: dict[str, Callable[[np.random.Generator], Caps]] = {
    "few": lambda rng: scattered(rng, int(rng.integers(0, 6)), 15, 60),
    "many": lambda rng: joined(
        ring(12, rng.uniform(0.7, 1.2), rng.uniform(-0.15, 0.15)), scattered(rng, 18, 8, 15)
    ),
    "noisy ring": noisy_ring,
    "kept in": kept_in,
    "large": large,
    "nested": nested,
    "belt": belt,
}


def random_case(kind: str, seed: int) -> tuple[Caps, np.ndarray, np.ndarray] | None:
    """Caps turned at random and two free directions, one of them near the pole of rings where it is free."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    axes, half_angles = KINDS[kind](rng)
    turn = Rotation.random(rng=rng)
    caps = turn.apply(axes.reshape(-1, 3)).reshape(-1, 3), half_angles
    near = turn.apply(unit(NORTH + 0.3 * rng.standard_normal((20, 3))))
    candidates = np.concatenate([near, unit(rng.standard_normal((400, 3)))])
    free = candidates[margins(caps, candidates) > 0]
    return (caps, free[0], free[-1]) if len(free) > 1 else None


@pytest.mark.parametrize("kind", KINDS)
def test_a_flood_fill_agrees(kind):
    told = {True: 0, False: 0, None: 0}
    for seed in range(40):
        case = random_case(kind, seed)
        if case is None:
            continue
        caps, start, goal = case
        verdict = grid().connected(caps, start, goal)
        told[verdict] += 1
        found = separating_caps(*caps, start, goal)
        if verdict is not None:
            assert (found is None) == verdict, (kind, seed)
        if found is not None:  # the caps named are enough, and none of them is idle
            named = caps[0][list(found)], caps[1][list(found)]
            assert separating_caps(*named, start, goal) == tuple(range(len(found)))
            for place in range(len(found)):
                fewer = [np.delete(part, place, axis=0) for part in named]
                assert separating_caps(*fewer, start, goal) is None
    assert told[True] + told[False] >= 2 * told[None]  # the grid does tell
    assert told[True] >= 5
    assert told[False] >= (0 if kind == "few" else 5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_answer_depends_on_neither_sense_nor_order_nor_frame(kind):
    for seed in range(40, 80):
        case = random_case(kind, seed)
        if case is None:
            continue
        (axes, half_angles), start, goal = case
        found = separating_caps(axes, half_angles, start, goal)
        rng = np.random.default_rng(seed)
        order, turn = rng.permutation(len(axes)), Rotation.random(rng=rng)
        for other in (
            separating_caps(axes, half_angles, goal, start),
            separating_caps(axes[order], half_angles[order], start, goal),
            separating_caps(axes @ turn.as_matrix().T, half_angles, turn.apply(start), turn.apply(goal)),
        ):
            assert (other is None) == (found is None)
            assert found is None or len(other) == len(found)


# --- what holds by construction


@pytest.mark.parametrize("count", [3, 4, 7, 32])
@pytest.mark.parametrize("colatitude", [0.3, 1.2, np.pi / 2, 2.5])
@pytest.mark.parametrize("near", [False, True])
def test_a_ring_parts_what_it_surrounds_once_it_is_closed(count, colatitude, near):
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7])
    for overlap in (np.deg2rad(0.5), 1e-6, -1e-6, -np.deg2rad(0.5), 0.0):
        axes, half_angles = ring(count, colatitude, overlap)
        goal = SOUTH
        if near:  # just beyond the point where the first two caps touch, or the tip of what both cover
            reach = np.arccos(min(np.cos(half_angles[0]) / np.linalg.norm(axes[0] + axes[1]) * 2, 1.0))
            middle = unit(axes[0] + axes[1])
            outward = -unit(np.cross(axes[0], axes[1]))
            goal = np.cos(reach + 1e-3) * middle + np.sin(reach + 1e-3) * outward
        found = separating_caps(turn.apply(axes), half_angles, turn.apply(NORTH), turn.apply(goal))
        assert found == (tuple(range(count)) if overlap > 0 else None)


def test_one_gap_opens_a_ring():
    axes, half_angles = ring(6, 0.8, 1e-4)
    half_angles[2] -= 2e-4
    assert separating_caps(axes, half_angles, NORTH, SOUTH) is None


def test_touching_caps_are_never_a_proof():
    rng = np.random.default_rng(3)
    for _ in range(200):
        axes, half_angles = ring(int(rng.integers(3, 12)), rng.uniform(0.2, 2.9), 0.0)
        turn = Rotation.random(rng=rng)
        for widened in (0.0, 1e-15, TOLERANCE / 10):
            assert (
                separating_caps(turn.apply(axes), half_angles + widened, *turn.apply([NORTH, SOUTH])) is None
            )


def test_three_caps_that_meet_in_one_point_leave_it_free():
    # each touches the point from its own side, so that two and two overlap and the point is all that is free
    axes, half_angles = ring(3, 0.7, 0.0)[0], np.full(3, 0.7)
    assert separating_caps(axes, half_angles, NORTH, SOUTH) == (0, 1, 2)
    assert separating_caps(axes, half_angles, NORTH, NORTH) is None
    assert separating_caps(axes, half_angles, SOUTH, SOUTH) is None


def test_the_nearest_directions_that_a_ring_can_part():
    # start and goal on either side of where two caps of a great ring overlap by 1e-6 rad, both at their rims
    axes, half_angles = ring(4, 0.8, 1e-6)
    middle = unit(axes[0] + axes[1])
    for distance in (2e-3, 1e-2):
        pair = [unit(middle + sign * distance * unit(NORTH - middle * middle[2])) for sign in (1, -1)]
        assert separating_caps(axes, half_angles, *pair) == (0, 1, 2, 3)
        assert separating_caps(axes, half_angles - 1e-6, *pair) is None


def test_start_and_goal_on_the_rim_are_free():
    axes, half_angles = ring(5, 0.9, 0.02)
    inner = unit(np.array([np.sin(0.9 - half_angles[0]), 0, np.cos(0.9 - half_angles[0])]))
    outer = unit(np.array([np.sin(0.9 + half_angles[0]), 0, np.cos(0.9 + half_angles[0])]))
    assert separating_caps(axes, half_angles, inner, outer) == (0, 1, 2, 3, 4)
    assert separating_caps(axes, half_angles, inner, NORTH) is None


@pytest.mark.parametrize("count", [0, 1, 2])
def test_two_caps_part_nothing(count):
    # not even a cap of more than 90 deg and one that cuts across what it leaves free
    axes, half_angles = np.array([SOUTH, NORTH])[:count], np.array([2.5, 0.3])[:count]
    start, goal = unit(np.array([[0.4, 0, 1], [-0.4, 0, 1]]))
    assert separating_caps(axes, half_angles, start, goal) is None


def test_a_broken_start_or_goal_proves_nothing():
    axes, half_angles = ring(5, 0.9, 0.1)
    assert separating_caps(axes, half_angles, NORTH, axes[0]) is None
    assert separating_caps(axes, half_angles, axes[0], SOUTH) is None
    assert separating_caps(axes, half_angles, np.full(3, np.nan), SOUTH) is None


def test_the_fewest_zones_are_named():
    wide, narrow = ring(9, 1.2, 0.1), ring(4, 0.7, 0.02)
    assert separating_caps(*joined(wide, narrow), NORTH, SOUTH) == (9, 10, 11, 12)
    # a cap that bridges two of the ring's own makes a shorter one
    axes, half_angles = ring(8, 1.3, 0.02)
    bridge = axes[2:3], np.array([1.15])
    assert separating_caps(*joined((axes, half_angles), bridge), NORTH, SOUTH) == (0, 4, 5, 6, 7, 8)


# --- zones and scenes


def zone(kind: type, name: str, axis: np.ndarray, half_angle: float, devices: tuple[str, ...], **more: str):
    return kind(name=name, direction=axis, half_angle=float(half_angle), devices=devices, **more)


def fence(
    start: np.ndarray, goal: np.ndarray, devices: tuple[str, ...], **group: str
) -> tuple[list[KeepOut], list[KeepIn]]:
    """Within a keep-in cone around start and goal, a row of keep-out cones between the two."""
    middle, across = unit(start + goal), unit(np.cross(start, goal))
    half = 1.5 * np.arccos(start @ goal)
    row = [
        zone(KeepOut, f"out-{k}", np.cos(t) * middle + np.sin(t) * across, 0.31 * half, devices)
        for k, t in enumerate(half * np.linspace(-0.9, 0.9, 4))
    ]
    return row, [zone(KeepIn, "in", middle, half, devices or ("camera-1",), **group)]


def ends(scene: Scene) -> np.ndarray:
    """(2, devices, 3) directions at start and goal."""
    return boresights(
        scene,
        np.array([scene.start_attitude, scene.goal_attitude]),
        np.array([scene.start_joints, scene.goal_joints]),
    )


def fenced_scene(device: int, devices: tuple[str, ...], more: tuple[KeepIn, ...] = (), **group: str) -> Scene:
    """Two terminals and a camera, with a fence around one of them and a harmless zone before it."""
    plain = make_scenario(terminals=2, instruments=1, turn=(0.1, -0.3, 0.2))
    plain = replace(plain, goal=replace(plain.goal, joints=0.9 * plain.start.joints))
    start, goal = ends(scene_of(plain))[:, device]
    keep_out, keep_in = fence(start, goal, devices, **group)
    harmless = zone(KeepOut, "harmless", -unit(start + goal), 0.2, devices)
    return scene_of(replace(plain, keep_out=(harmless, *keep_out), keep_in=(*keep_in, *more)))


@pytest.mark.parametrize(("device", "name"), [(0, "terminal-1"), (1, "terminal-2"), (2, "camera-1")])
def test_a_fenced_device_is_named_with_its_zones(device, name):
    scene = fenced_scene(device, (name,))
    assert find_barrier(scene) == Barrier(device=device, zones=(1, 2, 3, 4, 5))
    start, goal = ends(scene)[:, device]
    assert separating_zones(scene.cones, device, start, goal) == (1, 2, 3, 4, 5)
    assert separating_zones(scene.cones, device, start, start) is None
    # the same fence does not bind another device that goes the same way
    assert separating_zones(scene.cones, (device + 1) % 3, start, goal) is None


def test_a_group_is_no_proof():
    alone = fenced_scene(2, ("camera-1",), any_of="trackers")
    assert find_barrier(alone) is not None, "alone in its group, a zone must hold"
    start, goal = ends(alone)[:, 2]
    another = zone(KeepIn, "another", -start, 1.0, ("terminal-1",), any_of="trackers")
    assert find_barrier(fenced_scene(2, ("camera-1",), (another,), any_of="trackers")) is None
    out, kept = fence(start, goal, ("camera-1",), any_of="trackers")
    other = zone(KeepIn, "other", -start, 1.0, ("camera-2",), any_of="trackers")
    craft = named_craft("camera-1", "camera-2")
    assert separating_zones(tabulate(out, [*kept, other], craft), 0, start, goal) is None
    # alone in its group, a zone must hold
    assert separating_zones(tabulate(out, kept, craft), 0, start, goal) == (0, 1, 2, 3, 4)


@pytest.mark.parametrize(("terminals", "instruments"), [(0, 2), (2, 0), (4, 1)])
def test_scenes_without_zones_have_no_barrier(terminals, instruments):
    assert find_barrier(scene_of(make_scenario(terminals, instruments))) is None


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_papers_cases_have_no_barrier(number):
    case = paper_case(number)
    craft = case.spacecraft
    attitude = Rotation.from_rotvec(
        case.start.rotation_vector
    ).as_matrix()  # any that reaches the targets will do
    goal = Goal(
        attitude=attitude,
        joints=np.array(craft.joints_toward(attitude, case.goal.directions)),
        slew_angle=0.0,
    )
    scene = scene_of(case, goal)
    np.testing.assert_allclose(ends(scene)[1], case.goal.directions, rtol=1e-12)
    assert find_barrier(scene) is None
