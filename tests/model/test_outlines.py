"""Fields of view and masks: their shapes, the rows made of them, and derivatives by their numbers."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario, turning_direction
from reference import angle, assert_each, field_margins, outside, random_units, state_margins, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model import constraints, outlines, zones
from jaxplan.model.zones import FIELD_OF_VIEW, FixedVector, KeepIn, KeepOut

SHAPES = np.deg2rad([[14.28, 14.28], [3.5, 3.5], [20, 10], [2, 60], [120, 100], [0.01, 170]])
MASK = np.deg2rad([[160.0, -10.0], [195.0, -12.0], [190.0, 8.0], [170.0, 12.0]])
TRIANGLE = np.deg2rad([[-20.0, 0.0], [10.0, -5.0], [5.0, 12.0]])


def frame(rng):
    """A boresight and up, at random."""
    forward, up = random_units(rng, 2)
    return forward, unit(up - (up @ forward) * forward)


def parts(forward, up, directions):
    """(3, k) along the boresight, along up x boresight, and along up."""
    return np.stack([directions @ own for own in (forward, np.cross(up, forward), up)])


def distance(forward, up, angles, directions):
    """(k,) rad to a field, zero inside: to the nearest point of the arcs between its corners."""
    half = np.tan(angles / 2)
    left = np.cross(up, forward)
    corners = [
        unit(forward + x * half[0] * left + y * half[1] * up) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    found = []
    for here, there in zip(corners, corners[1:] + corners[:1], strict=True):
        normal = unit(np.cross(here, there))
        ahead = (np.cross(normal, here) @ directions.T > 0) & (np.cross(there, normal) @ directions.T > 0)
        ends = np.minimum(angle(directions, here), angle(directions, there))
        found.append(np.where(ahead, np.abs(np.arcsin(np.clip(directions @ normal, -1, 1))), ends))
    x, y, z = parts(forward, up, directions)
    inside = (x > 0) & (np.abs(y) <= half[0] * x) & (np.abs(z) <= half[1] * x)
    return np.where(inside, 0.0, np.min(found, axis=0))


@pytest.mark.parametrize("angles", SHAPES, ids=lambda angles: str(np.rad2deg(angles).round(2)))
def test_the_margin_of_a_field_is_never_above_the_distance_and_exact_beside_an_edge(angles):
    rng = np.random.default_rng(1)
    forward, up = frame(rng)
    device = jp.Instrument(name="camera", boresight=forward, up=up, field_of_view=angles)
    near = unit(forward + 3 * np.tan(angles.max() / 2) * rng.normal(size=(300, 3)))
    directions = np.concatenate([near, random_units(rng, 300), [-forward]])
    true = distance(forward, up, angles, directions)
    beyond, far = field_margins(device, parts(forward, up, directions))
    own = np.maximum(beyond, far)
    assert_each(own[true > 0], "<=", true[true > 0] + 1e-9)
    assert np.all(own[true == 0] <= 0)
    assert own[-1] > 0  # behind the device nothing is in the way
    edges = outlines.field_edges(forward, up, angles)
    corners = outlines.field_corners(forward, up, angles)
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        for small in (0.001, 0.01):
            beside = unit(here + there)
            normal = edges[np.argmin(np.abs(edges @ here) + np.abs(edges @ there))]
            beside = unit(np.cos(small) * beside + np.sin(small) * normal)
            found, _ = field_margins(device, parts(forward, up, beside[None]))
            assert found[0] == pytest.approx(small, abs=1e-12)
            assert distance(forward, up, angles, beside[None])[0] == pytest.approx(small, abs=1e-9)


def test_a_corner_is_short_by_a_factor_of_the_square_root_of_two_at_most():
    """Of a square field it is 1.08, since farther than the corners from the boresight is enough, too."""
    rng, shortest = np.random.default_rng(2), []
    for angles in SHAPES[[0, 1, 3]]:
        forward, up = frame(rng)
        device = jp.Instrument(name="camera", boresight=forward, up=up, field_of_view=angles)
        for corner in outlines.field_corners(forward, up, angles):
            out = unit(corner + 0.05 * random_units(rng, 2000))
            true = distance(forward, up, angles, out)
            found = np.max(field_margins(device, parts(forward, up, out)), axis=0)
            outer = true > 2e-3
            shortest.append(np.max(true[outer] / found[outer]))
    square, narrow = max(shortest[:8]), max(shortest[8:])
    assert 1.07 < square < 1.09
    assert 1.3 < narrow < np.sqrt(2)


def test_corners_are_where_edges_meet():
    for angles in SHAPES:
        forward, up = frame(np.random.default_rng(3))
        edges, corners = (
            outlines.field_edges(forward, up, angles),
            outlines.field_corners(forward, up, angles),
        )
        np.testing.assert_allclose(np.sort(np.abs(corners @ edges.T), axis=1)[:, :2], 0, atol=1e-14)
        np.testing.assert_allclose(angle(corners, forward), outlines.corner_angle(angles), atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(edges, axis=1), 1, atol=1e-15)
        np.testing.assert_allclose(edges[:2] @ up, 0, atol=1e-14)


@pytest.mark.parametrize("way", [1, -1])
def test_half_planes_are_outside_of_a_polygon_whichever_way_its_corners_go(way):
    points = np.random.default_rng(4).uniform(-1, 4, (2000, 2))
    for corners in (MASK, TRIANGLE):
        normals, least = outlines.half_planes(corners[::way])
        found = np.max(points @ normals.T - least, axis=1)
        np.testing.assert_allclose(found, outside(corners, points), atol=1e-14)
        assert (found < 0).any()


def test_masks_are_repeated_as_far_as_the_yaw_reaches_and_no_farther():
    degrees = np.deg2rad
    corners = degrees([[170.0, 0.0], [190.0, 0.0], [180.0, 10.0]])
    for low, high, expected in (
        (-180, 180, (-1, 0)),
        (-90, 90, ()),
        (-171, 90, (-1,)),
        (-170, 170, ()),
        (-270, 270, (-1, 0)),
        (-720, 720, (-2, -1, 0, 1)),
        (171, 530.5, (0, 1)),
    ):
        assert outlines.turns(corners, degrees(low), degrees(high)) == expected, (low, high)
    seen = []
    jax.jit(lambda corners: seen.append(outlines.turns(corners, -1.0, 1.0)) or 0)(corners)
    assert seen == [(-2, -1, 0, 1, 2)]


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([[0, 0], [1, 0]], "have 3 corners or more, not 2"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "corner [1] is at the next one"),
        ([[0, 0], [1, 0], [0, 1], [0, 0]], "the last is the first again"),
        ([[0, 0], [1, 1], [2, 2]], "have an area"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "not cross itself"),
        ([[0, 0], [2, 0], [0.5, 0.5], [0, 2]], "bends inward at corner [2]: cut it there into convex ones"),
        ([[np.cos(a), np.sin(a)] for a in 0.8 * np.pi * np.arange(5)], "not cross itself"),
    ],
)
def test_what_is_no_convex_polygon_says_why(corners, said):
    assert said in outlines.fault(np.array(corners, float))
    assert said in outlines.fault(np.array(corners, float)[::-1]) or "corner" in said
    assert outlines.fault(MASK) is outlines.fault(MASK[::-1]) is None


def looking(*, keep_out=(), keep_in=(), mask=()):
    """Two terminals, of which one has a field and masks, and two star trackers with fields."""
    scene = make_scenario(2, 0)
    rng = np.random.default_rng(5)
    first, second = scene.spacecraft.terminals
    trackers = []
    for name, angles in (("tracker-1", [20, 10]), ("tracker-2", [8, 30])):
        forward, up = frame(rng)
        trackers.append(jp.Instrument(name=name, boresight=forward, up=up, field_of_view=np.deg2rad(angles)))
    first = replace(first, field_of_view=np.deg2rad([12.0, 7.0]), yaw_limit=np.pi, mask=tuple(mask))
    second = replace(second, field_of_view=np.deg2rad([5.0, 9.0]), up=np.array([0, 0.6, 0.8]))
    craft = replace(scene.spacecraft, terminals=(first, second), instruments=tuple(trackers))
    return replace(scene, spacecraft=craft, keep_out=tuple(keep_out), keep_in=tuple(keep_in))


def beside(name, direction=None, half_angle=0.2, devices=(), sort=KeepOut, **more):
    field = {"outside" if sort is KeepOut else "inside": FIELD_OF_VIEW}
    return sort(name=name, direction=direction, half_angle=half_angle, devices=devices, **field, **more)


RNG = np.random.default_rng(6)
SUN, EARTH, MOON = random_units(RNG, 3)
TIMES = np.linspace(0, 50, 11)
ALL = looking(
    keep_out=[
        beside("sun, all", SUN),
        beside("sun, camera", SUN, 0.0, ("tracker-1",)),
        beside(
            "panel", axis_body=np.array([0.6, 0.0, 0.8]), half_angle=1.0, devices=("terminal-1", "terminal-2")
        ),
        beside("beam", axis_device="terminal-2", half_angle=0.1, devices=("terminal-1", "tracker-1")),
        beside("passing", turning_direction(RNG, 0.02, TIMES), 0.7, ("tracker-2", "terminal-2")),
        KeepOut(name="plain", direction=MOON, half_angle=0.3, vectors=(FixedVector(along=EARTH),)),
        *(
            beside(
                f"{body}, {number}", at, width, (f"tracker-{number}",), any_of="a tracker", entry=str(number)
            )
            for number in (1, 2)
            for body, at, width in (("sun", SUN, 0.5), ("earth", EARTH, 1.1))
        ),
    ],
    keep_in=[beside("guide star", -SUN, 0.02, ("tracker-1", "terminal-2"), KeepIn)],
    mask=[MASK, TRIANGLE],
)


def test_margins_of_all_that_has_a_field_or_a_mask_are_those_of_plain_numpy():
    rng, count = np.random.default_rng(7), 400
    attitudes = Rotation.random(count, rng=rng).as_matrix()
    joints = rng.uniform(-1, 1, (count, 4)) * [np.pi, np.pi, 0.4, 0.4]
    times = rng.uniform(0, 50, count)
    rows, craft = ALL.constraints, ALL.spacecraft
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    table = constraints.state_margins(rows, sights, attitudes, joints, times)
    found = constraints.constraint_margins(rows, table)
    expected = state_margins(ALL, attitudes, joints, times)
    stated = ALL.zones
    own = {name: np.full(count, np.inf) for name in expected}
    for leader in np.unique(rows.group[rows.zone >= 0]):
        zone = stated[rows.zone[leader]]
        name = zone.any_of or zone.name
        own[name] = np.minimum(own[name], found[:, leader])
    for name, margin in expected.items():
        # the expected has masks also after turns that the yaw's range is far from
        near = (lambda values: np.minimum(values, 0.3)) if name.startswith("mask") else np.asarray
        np.testing.assert_allclose(near(own[name]), near(margin), atol=1e-9, err_msg=name)
        assert (margin < 0).any(), name
        assert (margin > 0).any() or name == "guide star", name


def test_one_of_two_star_trackers_sees_neither_sun_nor_earth():
    """The group holds where both hold for one tracker, whatever the other one sees."""
    rows, count = ALL.constraints, 600
    attitudes = Rotation.random(count, rng=np.random.default_rng(8)).as_matrix()
    joints, craft = np.zeros((count, 4)), ALL.spacecraft
    table = constraints.state_margins(
        rows, rows.sights(craft.gimbals, craft.fixed_boresights), attitudes, joints, np.zeros(count)
    )
    number = [zone.name for zone in ALL.zones].index("sun, 1")
    leader = rows.group[np.flatnonzero(rows.zone == number)[0]]
    holds = constraints.constraint_margins(rows, table)[:, leader] >= 0
    clear = []
    for tracker in craft.instruments:
        axes = tracker.boresight, np.cross(tracker.up, tracker.boresight), tracker.up
        kept = [
            np.max(field_margins(tracker, np.stack([attitudes @ own @ body for own in axes])), axis=0)
            >= width
            for body, width in ((SUN, 0.5), (EARTH, 1.1))
        ]
        clear.append(np.all(kept, axis=0))
    np.testing.assert_array_equal(holds, np.any(clear, axis=0))
    assert 0.2 < np.mean(holds) < 0.95
    assert np.any(clear[0] != clear[1])


def test_edges_are_named_after_their_field_and_masks_after_their_terminal():
    names = ALL.sight_names
    assert len(names) == ALL.constraints.bound.shape[1]
    assert names[:4] == ("terminal-1", "terminal-2", "tracker-1", "tracker-2")
    assert "left edge of tracker-1's field" in names
    assert [zone.name for zone in ALL.zones[-2:]] == ["mask 1 of terminal-1", "mask 2 of terminal-1"]
    assert ALL.zones[-2].turns == (-1, 0)


def test_margins_have_derivatives_by_corners_angles_up_and_boresights():
    """Those of the worst and the second margin of some states, against central differences in numpy."""
    rng = np.random.default_rng(9)
    attitudes = Rotation.random(6, rng=rng).as_matrix()
    joints, times = rng.uniform(-2, 2, (6, 4)), rng.uniform(1, 49, 6)

    def changed(numbers):
        first, second = ALL.spacecraft.terminals
        camera, tracker = ALL.spacecraft.instruments
        first = replace(first, mask=(numbers["corners"], TRIANGLE), field_of_view=numbers["angles"])
        second = replace(second, up=numbers["up"])
        camera = replace(camera, boresight=numbers["boresight"], up=numbers["camera up"])
        craft = replace(ALL.spacecraft, terminals=(first, second), instruments=(camera, tracker))
        return replace(ALL, spacecraft=craft)

    def margins(numbers):
        scene = changed(numbers)
        rows, craft = scene.rows(TURNS), scene.spacecraft
        sights = rows.sights(craft.gimbals, craft.fixed_boresights)
        return constraints.state_margins(rows, sights, attitudes, joints, times)

    camera = ALL.spacecraft.instruments[0]
    numbers = {
        "corners": MASK,
        "angles": ALL.spacecraft.terminals[0].field_of_view,
        "up": ALL.spacecraft.terminals[1].up,
        "boresight": camera.boresight,
        "camera up": camera.up,
    }
    with jax.enable_x64(True):
        told = jax.jit(jax.jacfwd(margins))(numbers)
    for name, value in numbers.items():
        for _ in range(3):
            way = rng.normal(size=value.shape)
            if name == "boresight":  # turned with up at right angles to it, as a unit vector
                way -= (way @ value) * value
            ends = [margins(numbers | {name: value + step * way}) for step in (1e-6, -1e-6)]
            with np.errstate(invalid="ignore"):
                expected = (ends[0] - ends[1]) / 2e-6
            found = np.tensordot(np.asarray(told[name]), way, axes=value.ndim)
            bound = np.isfinite(ends[0])
            np.testing.assert_allclose(found[bound], expected[bound], atol=1e-6, err_msg=name)
            assert np.abs(found[bound]).max() > 0.05, name


TURNS = tuple(mask.turns for mask in zones.masks(ALL.spacecraft))
