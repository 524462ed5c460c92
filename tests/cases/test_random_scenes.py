"""Random scenes: what each kind promises, held in plain numpy and scipy, and the same numbers everywhere."""

import json
import re
from functools import cache
from pathlib import Path

import jax
import numpy as np
import pytest
from dense import joint_limits
from reference import angle, assert_each, boresights, edge_states, in_body, state_margins
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

import jaxplan as jp
from jaxplan.cases import (
    RANDOM_KINDS,
    SKY_KINDS,
    any_spacecraft,
    random_kinds,
    random_scenes,
    random_starts,
)
from jaxplan.goal import decompose
from jaxplan.model.goals import Targets
from jaxplan.model.scenario import SearchSettings, TrajectorySettings
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn
from jaxplan.schema import dump_scenario, parse_scenario

SEEDS = 40
TARGETS = [[-0.5349, 0.8296, 0.1604], [0.4212, -0.9032, -0.0832], [0.4601, -0.7960, -0.3933]]  # of the paper
# deg: number of cones and range of their half-angles; terminals held, in which cone, started in; clearance.
PROMISES = {
    "keep_out": (4, 15, 30, 0, 0, 0, 2),
    "keep_in": (3, 15, 30, 1, 15, 12, 2),
    "hard_keep_out": (8, 12, 30, 0, 0, 0, 1),
    "hard_keep_in": (8, 12, 30, 1, 15, 12, 1),
    "held_links": (4, 15, 30, 2, 10, 8, 2),
}
# Rows of start (rotation vector, joints), keep-out and keep-in cones (direction, half-angle): see `numbers`.
GOLDEN = Path(__file__).parents[1] / "data" / "random_scenes.json"
NEW_KINDS = list(random_kinds.KINDS)
# Of the others: keep-out and keep-in cones, joint bounds; how many are about axes of the body, about beams,
# for vectors of the body, for vectors of terminals, moving; how many groups.
CENSUS = {
    "masks": (6, 0, 0, 6, 0, 0, 0, 0, 0),
    "beams": (3, 0, 0, 0, 3, 0, 0, 0, 0),
    "panels": (3, 1, 0, 0, 0, 4, 0, 0, 0),
    "carried": (3, 1, 0, 0, 0, 0, 4, 0, 0),
    "joint_bounds": (0, 0, 12, 0, 0, 0, 0, 0, 3),
    "grouped": (9, 3, 0, 3, 0, 6, 0, 0, 3),
    "moving": (4, 0, 0, 0, 0, 1, 0, 4, 0),
    "moved_goals": (3, 0, 12, 0, 0, 0, 3, 0, 3),
    "mixed": (10, 2, 4, 3, 1, 4, 1, 0, 2),
    "terminal_masks": (0, 0, 0, 0, 0, 0, 0, 0, 0),
    "fields": (6, 0, 0, 0, 0, 0, 0, 0, 0),
}
kinds = pytest.mark.parametrize("kind", RANDOM_KINDS)
of_the_paper = pytest.mark.parametrize("kind", [*SKY_KINDS, *NEW_KINDS])
sky_kinds = pytest.mark.parametrize("kind", SKY_KINDS)
new_kinds = pytest.mark.parametrize("kind", NEW_KINDS)


@cache
def scenes(kind, count=None):
    count = count or (SEEDS if kind in SKY_KINDS else 12)
    return [jp.random_scenario(seed, kind) for seed in range(count)]


def start_of(scene):
    return Rotation.from_rotvec(scene.start.rotation_vector).as_matrix(), scene.start.joints


def degrees_between(a, b):
    return np.rad2deg(angle(a, b))


def margins(scene, seen):
    """(..., bound pairs of zone and terminal) deg, of boresights (..., 3, 3)."""
    found = []
    for side, zones in ((1, scene.keep_out), (-1, scene.keep_in)):
        for zone in zones:
            for i, terminal in enumerate(scene.spacecraft.terminals):
                if not zone.devices or terminal.name in zone.devices:
                    angle = degrees_between(seen[..., i, :], zone.direction)
                    found.append(side * (angle - np.rad2deg(zone.half_angle)))
    return np.stack(found, axis=-1)


def goals_of(scene, **zones):
    """The goals of step 1 among the scene's cones on the sky for terminals, which change nothing."""
    craft = scene.spacecraft
    cones = tabulate(zones.get("keep_out", ()), zones.get("keep_in", ()), craft)
    return decompose(craft, start_of(scene)[0], scene.goal, cones).goals


def numbers(scene):
    """Of the start, and of all zones what tells them apart: of a direction that moves its first samples."""
    rows = [scene.start.rotation_vector, scene.start.joints]
    zones = (scene.keep_out, scene.keep_in, scene.joint_bounds)
    masks = [terminal.mask for terminal in scene.spacecraft.terminals]
    rows += [np.ravel(leaf)[:9] for leaf in jax.tree.leaves((zones, masks))]
    every = [float(number) for row in rows for number in row]
    return [round(number, 9) for number in every if np.isfinite(number)]  # most zones last for good


def straight(scene, goal):
    """The straight motion to a goal as states: attitudes (k, 3, 3), joints (k, 6), and a time for each."""
    return *edge_states(*start_of(scene), goal.attitude, goal.joints, 1001), np.zeros(1001)


def least(scene, attitudes, joints, time):
    """(k,) deg, of the zones as they are stated."""
    return np.rad2deg(np.min(list(state_margins(scene, attitudes, joints, time).values()), axis=0))


@sky_kinds
def test_zones_are_those_of_the_kind(kind):
    count, low, high, held, hold, _, _ = PROMISES[kind]
    names = ("terminal-1", "terminal-2", "terminal-3")
    for scene in scenes(kind):
        assert len(scene.keep_out) == count
        assert len(scene.keep_in) == held
        for zone in scene.keep_out:
            assert low <= np.rad2deg(zone.half_angle) <= high
            assert (zone.devices or names) == names[held:]
            np.testing.assert_allclose(np.linalg.norm(zone.direction), 1, rtol=1e-15)
        for i, zone in enumerate(scene.keep_in):
            assert np.rad2deg(zone.half_angle) == pytest.approx(hold)
            assert zone.devices == (names[i],)
            np.testing.assert_array_equal(zone.direction, scene.goal.directions[i])


@of_the_paper
def test_the_goal_is_the_papers_and_settings_are_the_defaults(kind):
    scene = scenes(kind)[0]
    np.testing.assert_allclose(scene.goal.directions, TARGETS, atol=5e-5)
    np.testing.assert_allclose(np.rad2deg([scene.goal.yaw_limit, scene.goal.pitch_limit]), [88, 13])
    np.testing.assert_allclose(
        np.rad2deg([terminal.mount for terminal in scene.spacecraft.terminals]), [0, 120, -120]
    )
    np.testing.assert_allclose(np.rad2deg(scene.spacecraft.joint_ranges[:, 1]), [90] * 3 + [15] * 3)
    assert vars(scene.search) == vars(SearchSettings(attitude_step=0.1, joint_step=0.08))
    assert vars(scene.trajectory) == vars(TrajectorySettings())
    assert scene.trajectory.duration == "stretched"


@new_kinds
def test_scenes_have_zones_of_the_sorts_of_their_kind(kind):
    for scene in scenes(kind)[:10]:
        cones = [*scene.keep_out, *scene.keep_in]
        to = [vector.to for zone in cones for vector in zone.vectors]
        found = (
            *(len(scene.keep_out), len(scene.keep_in), len(scene.joint_bounds)),
            sum(zone.axis_body is not None for zone in cones),
            sum(zone.axis_device is not None for zone in cones),
            *(to.count(None), len(to) - to.count(None)),
            sum(zone.moves for zone in cones),
            len({zone.any_of for zone in scene.zones} - {None}),
        )
        assert found == CENSUS[kind]
        assert len({zone.name for zone in scene.zones}) == len(scene.zones)
        craft = scene.spacecraft
        assert sum(len(terminal.mask) for terminal in craft.terminals) == 3 * (kind == "terminal_masks")
        assert len(craft.instruments) == sum(one.field_of_view is not None for one in craft.devices) // 4
        assert [zone.of_field for zone in cones] == [kind == "fields"] * len(cones)


def test_spacecraft_are_of_all_sorts():
    drawn = scenes("any_spacecraft", 120)
    crafts, zones = [scene.spacecraft for scene in drawn], [zone for scene in drawn for zone in scene.zones]
    terminals = [one for craft in crafts for one in craft.terminals]
    assert {len(craft.terminals) for craft in crafts} == {0, 1, 2, 3, 4}
    assert {len(craft.drives) for craft in crafts} == {0, 1, 2}
    assert {len(craft.instruments) for craft in crafts} == {1, 2, 3}
    assert {one.mounting is None for one in terminals} == {one.yaw_range is None for one in terminals}
    widths = [np.ptp(one.ranges, axis=1) for one in terminals]
    assert max(width[0] for width in widths) > 2 * np.pi > min(width[0] for width in widths)
    assert any(one.mask for one in terminals)
    assert {one.rate_limit is None for one in terminals} == {True, False}
    assert {np.ndim(craft.rate_limit) for craft in crafts} == {0, 1}
    for limit in ("rate_norm_limit", "jerk_limit", "torque_limit"):
        assert {getattr(craft, limit) is None for craft in crafts} == {True, False}
    assert {getattr(zone, "outside", None) for zone in zones} == {None, "field_of_view"}
    assert any(getattr(zone, "axis_body", None) is not None for zone in zones)
    assert any(getattr(zone, "axis_device", None) is not None for zone in zones)
    assert any(isinstance(zone, KeepIn) for zone in zones)
    goals = [scene.goal for scene in drawn]
    assert {isinstance(goal, Targets) for goal in goals} == {True, False}
    asked = [goal for goal in goals if isinstance(goal, Targets)]
    assert any(goal.hold for goal in asked)
    assert any(goal.prefer for goal in asked)
    with_targets = {name.split("-")[0] for goal in asked for name in goal.devices}
    assert with_targets == {"terminal", "drive", "instrument"}


def test_a_random_spacecraft_starts_clear_and_can_end_clear_where_its_goal_is_met():
    for seed in range(40):
        stream = np.random.SeedSequence(0, spawn_key=(1000, seed))
        drawn = any_spacecraft.draw_scene(np.random.Generator(np.random.PCG64(stream)))
        scene = any_spacecraft.draw_scenario(drawn, f"any_spacecraft {seed}")
        assert numbers(scene) == numbers(scenes("any_spacecraft", 120)[seed])
        for attitude, joints in (drawn.start, drawn.end):
            ranges, *_ = joint_limits(scene.spacecraft)
            assert_each(joints, ">=", ranges[:, 0] + np.deg2rad(2.8))
            assert_each(joints, "<=", ranges[:, 1] - np.deg2rad(2.8))
            margins = state_margins(scene, attitude[None], joints[None], np.zeros(1))
            assert_each(list(margins.values()), ">=", np.deg2rad(2))
        if isinstance(scene.goal, Targets):
            for name, target in zip(scene.goal.devices, scene.goal.directions, strict=True):
                beam = in_body(scene.spacecraft, name, drawn.end[1][None])[0]
                assert angle(drawn.end[0] @ beam, target) < 1e-12


@pytest.mark.slow
@new_kinds
def test_start_and_a_goal_are_clear_and_what_is_nearest_is_not(kind):
    """The straight motion to the nearest goal breaks something, or that goal, with another one near it."""
    times = np.linspace(0.0, random_kinds.KNOWN, 41) if kind == "moving" else np.zeros(1)
    for scene in scenes(kind):
        goal = goals_of(scene)[0]
        clear, motion = [start_of(scene), (goal.attitude, goal.joints)], straight(scene, goal)
        if kind == "moved_goals":
            clear, motion = clear[:1], [part[-1:] for part in motion]
        for state in clear:
            waiting = [np.repeat(part[None], len(times), axis=0) for part in state]
            assert np.min(least(scene, *waiting, times)) >= 2
        if kind != "moving":  # when the motion is where is not known
            assert np.min(least(scene, *motion)) <= -0.2


@sky_kinds
def test_start_and_goal_are_inside_their_constraints(kind):
    *_, held, _, start_within, clearance = PROMISES[kind]
    for scene in scenes(kind):
        attitude, joints = start_of(scene)
        assert_each(np.abs(np.rad2deg(joints)), "<=", [88] * 3 + [13] * 3)
        seen = boresights(scene.spacecraft, attitude, joints)
        assert_each(margins(scene, seen), ">=", clearance)
        assert_each(margins(scene, scene.goal.directions), ">=", clearance)
        assert_each(degrees_between(seen, scene.goal.directions)[:held], "<=", start_within)


@pytest.mark.parametrize("kind", ["hard_keep_out", "hard_keep_in", "held_links"])
def test_the_straight_motion_breaks_a_zone(kind):
    for scene in scenes(kind):
        goal, *others = goals_of(scene, keep_out=scene.keep_out, keep_in=scene.keep_in)
        assert all(other.slew_angle > goal.slew_angle + 5e-7 for other in others)
        motion = edge_states(*start_of(scene), goal.attitude, goal.joints, 1001)
        assert np.min(margins(scene, boresights(scene.spacecraft, *motion))) <= -0.2


def test_links_are_held_through_a_turn_of_40_to_100_degrees():
    turns = [np.rad2deg(goals_of(scene)[0].slew_angle) for scene in scenes("held_links")]
    assert min(turns) >= 40
    assert max(turns) <= 100
    assert np.ptp(turns) > 15


def test_starts_and_half_angles_are_uniform():
    for kind in ("keep_out", "keep_in"):
        drawn = scenes(kind, 300)
        joints = np.rad2deg([scene.start.joints for scene in drawn])
        for column, limit in zip(joints.T, [88] * 3 + [13] * 3, strict=True):
            assert kstest(column, "uniform", args=(-limit, 2 * limit)).pvalue > 1e-3
        half_angles = np.rad2deg([zone.half_angle for scene in drawn for zone in scene.keep_out])
        assert kstest(half_angles, "uniform", args=(15, 15)).pvalue > 1e-3


def test_attitudes_are_uniform():
    attitudes = np.array([start_of(scene)[0] for scene in scenes("keep_out", 300)])
    # a column is uniform on the sphere, so its components are uniform; the angle has the density 1 - cos
    for component in attitudes.reshape(-1, 9).T:
        assert kstest(component, "uniform", args=(-1, 2)).pvalue > 1e-3
    angles = Rotation.from_matrix(attitudes).magnitude()
    assert kstest(angles, lambda angle: (angle - np.sin(angle)) / np.pi).pvalue > 1e-3


def test_a_held_terminal_starts_anywhere_near_its_target():
    drawn = scenes("keep_in", 300)
    seen = np.array([boresights(scene.spacecraft, *start_of(scene))[0] for scene in drawn])
    cosines, least = seen @ drawn[0].goal.directions[0], np.cos(np.deg2rad(12))
    assert kstest(cosines, "uniform", args=(least, 1 - least)).pvalue > 1e-3


def test_directions_are_uniform_where_they_may_be():
    # the margin of one terminal's start to cones that need not mind it
    drawn = scenes("keep_in", 300)
    cosines = [
        boresights(s.spacecraft, *start_of(s))[0] @ zone.direction for s in drawn for zone in s.keep_out
    ]
    heights = [zone.direction[2] for s in drawn for zone in s.keep_out]
    assert np.min(cosines) < -0.9
    assert np.max(cosines) > 0.9
    assert np.abs(np.mean(heights)) < 0.15
    assert np.ptp(heights) > 1.9


@kinds
def test_scenes_are_those_of_the_golden_file(kind):
    golden = json.loads(GOLDEN.read_text())[kind]
    assert len(golden) == (20 if kind in SKY_KINDS else 4)
    for scene, row in zip(scenes(kind), golden, strict=False):
        np.testing.assert_allclose(numbers(scene), row, rtol=0, atol=2e-9)


@pytest.mark.slow
@kinds
def test_no_decision_hangs_on_rounding(kind, monkeypatch):
    decide, distances = random_starts.admissible, []

    def watched(slack):
        distances.append(np.min(np.abs(slack - random_starts.HAIR), initial=np.inf))
        return decide(slack)

    for module in (random_starts, random_scenes, random_kinds, any_spacecraft):
        monkeypatch.setattr(module, "admissible", watched)
    for seed in range(20 if kind in SKY_KINDS else 6):
        jp.random_scenario(seed, kind)
    assert len(distances) >= 20
    assert min(distances) > 1e-8  # step 1 is good to 1e-10, all else to rounding


@kinds
def test_scenes_belong_to_their_seed_and_kind(kind):
    assert numbers(jp.random_scenario(np.int64(7), kind)) == numbers(scenes(kind)[7])
    others = [*scenes(kind), *(scenes(other)[7] for other in RANDOM_KINDS if other != kind)]
    vectors = {tuple(scene.start.rotation_vector) for scene in others}
    assert len(vectors) == len(others)
    assert scenes(kind)[7].name == f"{kind} 7"


@kinds
def test_writing_loses_nothing(kind):
    for scene in scenes(kind)[:10]:
        again = parse_scenario(dump_scenario(scene))
        leaves, structure = jax.tree.flatten(scene)
        leaves_again, structure_again = jax.tree.flatten(again)
        assert structure == structure_again
        for own, read in zip(leaves, leaves_again, strict=True):
            np.testing.assert_array_equal(own, read)


def test_a_random_scene_can_be_planned():
    assert jp.plan(jp.random_scenario(3, "keep_in")).ok


def test_every_kind_is_told_of():
    for kind in RANDOM_KINDS:
        assert re.search(rf"^    {kind} ", random_scenes.__doc__, re.MULTILINE), kind


def test_what_is_no_seed_or_kind_is_refused():
    with pytest.raises(ValueError, match=r"kind = 'easy': must be one of keep_out, keep_in, hard_keep_out, "):
        jp.random_scenario(0, "easy")
    for seed in (-1, 1.0, "1", True, None):
        with pytest.raises(ValueError, match="must be an integer of at least 0"):
            jp.random_scenario(seed, "keep_in")
