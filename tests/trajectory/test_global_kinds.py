"""The method "global" among rows of every kind: against rotations, dense samples and differences."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from builders import make_spacecraft
from fits import problem_of, stack_at
from held_plans import metric
from kinds import Row, least_margins, pair_margins_of, row_values, seen_by, table
from node_paths import wandering
from oblique import oblique_craft, oblique_scenario
from quick import quick_jit
from reference import assert_each, attitudes_of, joints_of
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.status import Status
from jaxplan.trajectory import FitQuery, fit_batch
from jaxplan.trajectory.constraints import MarginBlock, margin_reach, margin_slopes
from jaxplan.trajectory.curve_attempts import Attempt
from jaxplan.trajectory.derivative import refit
from jaxplan.trajectory.measures import least_margin
from jaxplan.trajectory.motion import LIMIT
from jaxplan.trajectory.node_times import FEWEST_NODES, padded
from jaxplan.trajectory.splines import Basis

CRAFT = make_spacecraft(2, 1)  # sights 0 and 1 are terminals, 2 is a camera, 3 an axis of the body
PANEL = (0.0, 0.0, 1.0)
FIELD = np.deg2rad(3.0)  # half the width of a rectangular field
EDGES = [  # normals of its edges, inward, along the boresight of terminal 2, to its left and upward
    (np.sin(FIELD), sign * np.cos(FIELD) * left, sign * np.cos(FIELD) * up)
    for left, up in ((1, 0), (0, 1))
    for sign in (1, -1)
]
EXTRA = {"body": [PANEL], "carrier": [1] * 4, "carried": EDGES}  # the edges are sights 4 to 7
START, TURN = Rotation.from_rotvec([0.4, -0.3, 0.8]), np.array([0.5, -0.6, 0.4])
ENDS = np.deg2rad([[-25.0, 30, 3, -2], [48, -48, -1, -3]])
RATES = np.array([-0.01, 0.012, 0.01]), np.array([-0.04, 0.03, 0.006, -0.004])  # the other way at first
SETTINGS = TrajectorySettings(duration=45.0, node_tube=np.inf)
DEPTH = np.deg2rad(1.5)  # at most so far into every constraint the curve goes that knows of none


def straight():
    share = np.linspace(0, 1, 5)[:, None]
    return Path(
        attitudes=(START * Rotation.from_rotvec(share * TURN)).as_matrix(),
        joints=ENDS[0] + share * (ENDS[1] - ENDS[0]),
        edge_costs=np.ones(4),
    )


PATH = straight()


def query(rows, craft=CRAFT, settings=SETTINGS, path=PATH):
    return FitQuery(
        path=path,
        spacecraft=craft,
        settings=settings,
        cones=rows,
        start_angular_velocity=RATES[0],
        start_joint_rates=RATES[1],
    )


def states(trajectory, count=2001):
    """Attitudes and joints at many times."""
    t = np.linspace(0, trajectory.duration, count)
    return attitudes_of(trajectory, t), joints_of(trajectory, t)[0]


@cache
def alone():
    """States of the fit without constraints, and what it sees: (k, S, 3), in body axes and inertial."""
    (fit,) = fit_batch([query(None)])
    assert fit.status is Status.OK
    attitudes, joints = states(fit.trajectory)
    seen = seen_by(CRAFT, table([], 3, **EXTRA), joints)
    return attitudes, joints, seen, np.einsum("kij,ksj->ksi", attitudes, seen)


def beside(vectors, degrees):
    """A direction beside the middle of a curve of unit vectors (k, 3), so that it passes by at that angle."""
    middle = len(vectors) // 2
    along = vectors[middle + 1] - vectors[middle - 1]
    away = np.cross(vectors[middle], along)
    angle = np.deg2rad(degrees)
    return tuple(np.cos(angle) * vectors[middle] + np.sin(angle) * away / np.linalg.norm(away))


def in_the_way(row):
    """A row with such an angle that the curve without constraints breaks it, but not at its ends."""
    attitudes, joints, _, _ = alone()
    side = 1.0 if row.frame == JOINTS else row.side
    of_row = table([[[row]]], 3, **EXTRA)
    held = side * np.min(
        side * row_values(CRAFT, of_row, 0, seen_by(CRAFT, of_row, joints), attitudes, joints), axis=1
    )
    worst, at_ends = np.min(side * held), np.min(side * held[[0, -1]])
    assert worst < at_ends
    return replace(row, half_angle=side * (worst + min(DEPTH, 0.4 * (at_ends - worst))))


def single_rows():
    """By kind, a row that stands in the way."""
    _, _, body, sky = alone()
    rows = {
        "device out of a cone in the sky": Row(axis=beside(sky[:, 2], 4), bound=(2,)),
        "device in a cone in the sky": Row(axis=tuple(sky[-1, 0]), side=-1, bound=(0,)),
        "axis of the body out of a cone in the sky": Row(axis=beside(sky[:, 3], 4), bound=(3,)),
        "edge of a field off the sky": Row(axis=beside(sky[:, 5], -5), bound=(5,)),
        "device out of a cone in the body": Row(frame=BODY, axis=beside(body[:, 1], -3), bound=(1,)),
        "device in a cone in the body": Row(frame=BODY, axis=tuple(body[-1, 0]), side=-1, bound=(0,)),
        "device off the beam of another": Row(frame=SIGHT, partner=1, bound=(0,)),
        "device near the beam of another": Row(frame=SIGHT, partner=0, side=-1, bound=(1,)),
        "edge of a field off the beam of another": Row(frame=SIGHT, partner=0, bound=(6,)),
        "joints": Row(frame=JOINTS, axis=(np.cos(0.2), -np.sin(0.2), 0), bound=(0,)),
    }
    return {name: in_the_way(row) for name, row in rows.items()}


def field_of_view():
    """A star stays out of a rectangular field: beyond an edge, or farther off than the corners."""
    _, _, _, sky = alone()
    star, corner = beside(sky[:, 1], -2), np.arccos(np.cos(FIELD) ** 2)
    past = [[Row(axis=star, half_angle=np.pi / 2, bound=(edge,))] for edge in (4, 5, 6, 7)]
    return [*past, [Row(axis=star, half_angle=corner, bound=(1,))]]


def masked():
    """Terminal 1 stays out of a box of yaw and pitch: before, past or above it."""
    _, joints, _, _ = alone()
    middle = joints[len(joints) // 2]
    walls = ((-1, 0, -middle[0] + 0.1), (1, 0, middle[0] + 0.1), (0, 1, middle[2] + 0.03))
    return [[Row(frame=JOINTS, axis=(*f, 0), half_angle=d, bound=(0,))] for *f, d in walls]


def tables():
    """What stands in the way, by name: single rows, and mixtures of them in entries and groups."""
    rows = single_rows()
    never = Row(axis=(0, 0, 1), half_angle=3.0, bound=(0, 1, 2))
    sun, mask, beam = (
        rows[name]
        for name in (
            "device out of a cone in the sky",
            "device out of a cone in the body",
            "device off the beam of another",
        )
    )
    found = {name: [[[row]]] for name, row in rows.items()}
    found["field"] = [field_of_view()]
    found["box of joints"] = [masked()]
    found["entry of three, beside one that never holds"] = [[[never], [sun, mask, beam]]]
    found["any of two entries"] = [[[sun, rows["joints"]], [mask, rows["device in a cone in the sky"]]]]
    found["all"] = [
        *([[row]] for name, row in rows.items() if "edge" not in name and "near" not in name),
        masked(),
    ]
    return {name: table(own, 3, **EXTRA) for name, own in found.items()}


NAMES = [
    "device out of a cone in the sky",
    "device in a cone in the sky",
    "axis of the body out of a cone in the sky",
    "edge of a field off the sky",
    "device out of a cone in the body",
    "device in a cone in the body",
    "device off the beam of another",
    "device near the beam of another",
    "edge of a field off the beam of another",
    "joints",
    "field",
    "box of joints",
    "entry of three, beside one that never holds",
    "any of two entries",
    "all",
]


@cache
def fits():
    """Tables with their fits, made together."""
    rows = tables()
    made = fit_batch([query(own) for own in rows.values()])
    assert list(rows) == NAMES
    return {name: (rows[name], fit) for name, fit in zip(rows, made, strict=True)}


@pytest.mark.parametrize("name", NAMES)
def test_curves_keep_out_of_what_stands_in_the_way_at_all_times(name):
    rows, fit = fits()[name]
    assert fit.status is Status.OK, fit.message
    attitudes, joints = states(fit.trajectory)
    assert np.min(least_margins(CRAFT, rows, *alone()[:2])) < np.deg2rad(-0.5)
    assert np.min(least_margins(CRAFT, rows, attitudes, joints)) > np.deg2rad(0.2)
    np.testing.assert_allclose([attitudes[0], attitudes[-1]], PATH.attitudes[[0, -1]], atol=1e-12)
    np.testing.assert_allclose([joints[0], joints[-1]], ENDS, atol=1e-12)


def test_a_fit_among_rows_of_every_kind_agrees_with_itself_alone_and_its_margin_is_told():
    rows, fit = fits()["all"]
    assert set(rows.frame) == {INERTIAL, BODY, SIGHT, JOINTS}
    (other,) = fit_batch([query(rows)])
    for part in ("coefficients", "joint_coefficients"):
        np.testing.assert_allclose(
            getattr(fit.trajectory, part), getattr(other.trajectory, part), rtol=0, atol=1e-6
        )
    sampled = np.min(least_margins(CRAFT, rows, *states(fit.trajectory, 20001)))
    with jax.enable_x64(True):
        found = quick_jit(least_margin)(fit.trajectory, CRAFT, rows)
    assert sampled - 1e-5 < float(found) <= sampled + 1e-12


def test_the_shortest_motion_keeps_clear_of_every_kind():
    rows, timed = fits()["entry of three, beside one that never holds"]
    (fit,) = fit_batch([query(rows, settings=replace(SETTINGS, duration="minimum"))])
    assert fit.status is Status.OK, fit.message
    assert fit.trajectory.duration < 0.8 * timed.trajectory.duration
    assert np.min(least_margins(CRAFT, rows, *states(fit.trajectory))) >= 0


def optimum(rows, craft, held):
    """A number of the fit that is held, among rows and of a spacecraft."""
    path = Path(
        attitudes=padded(PATH.attitudes, FEWEST_NODES),
        joints=padded(PATH.joints, FEWEST_NODES),
        edge_costs=np.zeros(0),
    )
    rates = np.stack([np.concatenate(RATES), np.zeros(7)])
    return metric(refit(held, path, craft, SETTINGS, rows, rates))


@cache
def told():
    return quick_jit(jax.value_and_grad(optimum, (0, 1), allow_int=True))


def shifted(rows, share):
    """Rows and spacecraft, all of whose angles and directions are moved by a share of some step."""
    rng = np.random.default_rng(4)

    def turned(vectors):
        return Rotation.from_rotvec(share * 0.3 * rng.normal(size=3)).apply(vectors)

    own = replace(
        rows,
        half_angle=rows.half_angle + share * 0.1 * rng.normal(size=len(rows.axis)),
        axis=np.where((rows.frame == JOINTS)[:, None], rows.axis, turned(rows.axis)),
        body=turned(rows.body),
        carried=turned(rows.carried),
    )
    terminals = [replace(one, mount=one.mount + share * 0.1 * rng.normal()) for one in CRAFT.terminals]
    cameras = [replace(one, boresight=turned(one.boresight)) for one in CRAFT.instruments]
    return own, replace(CRAFT, terminals=tuple(terminals), instruments=tuple(cameras))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "axis of the body out of a cone in the sky",
        "device out of a cone in the body",
        "device in a cone in the body",
        "device off the beam of another",
        "edge of a field off the beam of another",
        "joints",
        "box of joints",
        "entry of three, beside one that never holds",
    ],
)
def test_derivatives_at_rows_that_bind_are_those_of_fits_that_are_made_anew(name):
    rows, fit = fits()[name]
    rows = replace(rows, inner=True, nested=True)  # all of them, so that they are compiled for but once
    held, step = fit.origin.hold(), 2e-5
    binding = {*held.zones.zone[held.zones.on].tolist()}
    expected_rows = {"box of joints": {1, 2}, "entry of three, beside one that never holds": {1, 2, 3}}
    assert binding == expected_rows.get(name, {0})

    def anew(share):
        own, craft = shifted(rows, share)
        (fit,) = fit_batch([query(own, craft)])
        return float(told()(own, craft, fit.origin.hold())[0])

    with jax.enable_x64(True):
        _, slopes = told()(rows, CRAFT, held)
        found = (anew(step) - anew(-step)) / (2 * step)
    expected = 0.0
    ahead, behind = (jax.tree.leaves(shifted(rows, sign * 1e-6)) for sign in (1, -1))
    for slope, more, less in zip(jax.tree.leaves(slopes), ahead, behind, strict=True):
        if np.asarray(more).dtype.kind == "f":
            expected += float(np.sum(slope * (np.asarray(more) - less))) / 2e-6
    assert expected == pytest.approx(found, rel=1e-5)


RNG = np.random.default_rng(12)
BASIS = Basis.even(6)
PLACES = np.linspace(0.02, 0.98, 13)
KINDS = [
    (INERTIAL, 0, 1.0),
    (INERTIAL, 0, -1.0),
    (BODY, 0, 1.0),
    (BODY, 0, -1.0),
    (SIGHT, 1, 1.0),
    (SIGHT, 2, -1.0),
    (SIGHT, 4, 1.0),
    (JOINTS, 0, 1.0),
]


def unit(*shape):
    vectors = RNG.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def with_every_kind(craft, rng):
    """Rows of all kinds that bind all sights they may, about a chart of its own; devices come first."""
    gimbals, devices = craft.gimbals.count, len(craft.device_names)
    rows = []
    for frame, partner, side in KINDS:
        normal = rng.normal(size=2)
        axis = (*normal / np.linalg.norm(normal), 0) if frame == JOINTS else tuple(unit())
        sights = {*range(devices + 3)} - {partner if frame == SIGHT else None}
        bound = tuple(range(len(craft.terminals))) if frame == JOINTS else tuple(sights)
        half_angle = rng.uniform(0.3, 1.2)
        row = Row(frame=frame, axis=axis, partner=partner, side=side, bound=bound, half_angle=half_angle)
        rows.append([[row]])
    carrier = rng.permutation(gimbals)[-2:]
    cones = table(rows, devices, body=unit(1), carrier=carrier, carried=unit(2))
    path = wandering(5, len(craft.terminals), seed=1, step=0.4)
    drives = np.zeros((6, len(craft.drives))) + 0.1 * np.arange(6)[:, None]
    path = replace(path, joints=np.concatenate([path.joints, drives], axis=1))
    return problem_of(path, craft, cones)


def random_problem(mount):
    craft = make_spacecraft(2, 1)
    craft = replace(craft, terminals=(craft.terminals[0], replace(craft.terminals[1], mount=mount)))
    return with_every_kind(craft, RNG)


PROBLEMS = [random_problem(0.5), random_problem(-2.0)]
STACK = stack_at(PROBLEMS, PLACES)
CURVES = RNG.normal(size=(2, 4, len(PLACES), 7))


def motion(curves, stack=STACK):
    return stack.iterates(curves.reshape(2, -1, 7), np.ones(2))


def test_margins_of_a_stack_are_those_of_rotations():
    own = motion(CURVES)
    for number, problem in enumerate(PROBLEMS):
        margins = pair_margins_of(
            problem.spacecraft, problem.cones, own.attitude[number], CURVES[number, 0, :, 3:]
        )
        np.testing.assert_allclose(own.margins[number], np.swapaxes(margins, 1, 2), atol=1e-12)


ODD = [with_every_kind(oblique_craft(2, 2, 1, seed=seed), RNG) for seed in (1, 2)]


def odd_motion(curves):
    return stack_at(ODD, PLACES).iterates(curves.reshape(2, -1, 9), np.ones(2))


def test_margins_and_slopes_with_odd_mounts_and_drives_are_those_of_rotations_and_differences():
    """Both terminals and both drives of two spacecraft of one kind, in one stack."""
    curves, step = RNG.normal(size=(2, 4, len(PLACES), 9)), 1e-6
    own = odd_motion(curves)
    for number, problem in enumerate(ODD):
        margins = pair_margins_of(
            problem.spacecraft, problem.cones, own.attitude[number], curves[number, 0, :, 3:]
        )
        np.testing.assert_allclose(own.margins[number], np.swapaxes(margins, 1, 2), atol=1e-12)
    index = np.nonzero(np.isfinite(own.margins))
    slopes = margin_slopes(own, *index)
    for axis in range(9):
        change = np.zeros_like(curves)
        change[:, 0, :, axis] = step
        ahead, behind = (odd_motion(curves + sign * change).margins[index] for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, axis], (ahead - behind) / (2 * step), atol=1e-7)
    every = np.zeros(index[0].shape)
    for _ in range(20):
        change = RNG.normal(size=(2, len(PLACES), 9)) * RNG.integers(0, 2, 9)
        reach = np.concatenate([margin_reach(own, np.array([n]), change[[n]]) for n in (0, 1)])
        moved = np.abs(np.einsum("ra,ra->r", slopes, change[index[0], index[1]]))
        within = np.broadcast_to(reach, own.margins.shape)[index]
        assert_each(moved, "<=", within * (1 + 1e-12))
        every = np.maximum(every, np.divide(moved, within, out=np.zeros_like(moved), where=within > 0))
    assert np.max(every) > 0.9


def test_ranges_about_anything_are_broken_by_what_is_out_of_them():
    curves = RNG.normal(size=(2, 4, len(PLACES), 9))
    for number, problem in enumerate(ODD):  # in the ranges but for one joint in one place
        low, high = problem.spacecraft.joint_ranges.T
        curves[number, 0, :, 3:] = low + RNG.uniform(0.1, 0.9, (len(PLACES), 6)) * (high - low)
    for joint, (side, off) in enumerate([(1, 0.3), (0, 0.2), (1, 0.1), (0, 0.4), (1, 0.5), (0, 0.25)]):
        broken = curves.copy()
        bound = ODD[1].spacecraft.joint_ranges[joint, side]
        broken[1, 0, 4, 3 + joint] = bound + off * (1 if side else -1)
        found = odd_motion(broken).violations[:, LIMIT]
        assert found[1] >= off - 1e-12
        beside = odd_motion(curves).violations[:, LIMIT]
        assert found[1] == pytest.approx(max(off, beside[1]), abs=1e-12)
        assert found[0] == pytest.approx(beside[0], abs=1e-12)


def test_fits_of_spacecraft_with_as_many_joints_of_other_kinds_are_as_alone():
    """One terminal with two drives, and two terminals, have four joints each."""
    queries = []
    for terminals, drives, cameras in ((1, 2, 1), (2, 0, 2)):
        scenario = oblique_scenario(terminals, drives, cameras, seed=5, kinds=("sun",), turn=0.4)
        start, goal = scenario.start, scenario.goal
        share = np.linspace(0, 1, 7)[:, None]
        first = Rotation.from_rotvec(start.rotation_vector)
        turn = (first.inv() * Rotation.from_rotvec(goal.rotation_vector)).as_rotvec()
        path = Path(
            attitudes=(first * Rotation.from_rotvec(share * turn)).as_matrix(),
            joints=start.joints + share * (goal.joints - start.joints),
            edge_costs=np.ones(6),
        )
        settings = TrajectorySettings(duration=60.0)
        queries.append(
            FitQuery(path=path, spacecraft=scenario.spacecraft, settings=settings, cones=scenario.constraints)
        )
    together, alone = fit_batch(queries), [fit_batch([one])[0] for one in queries]
    for query, one, other in zip(queries, together, alone, strict=True):
        assert one.status is other.status
        t = np.linspace(0, 60, 50)
        for own, by_itself in zip(
            (attitudes_of(one.trajectory, t), joints_of(one.trajectory, t)[0]),
            (attitudes_of(other.trajectory, t), joints_of(other.trajectory, t)[0]),
            strict=True,
        ):
            np.testing.assert_allclose(own, by_itself, atol=1e-6)
        low, high = query.spacecraft.joint_ranges.T
        assert_each(joints_of(one.trajectory, t)[0], ">=", low - 1e-9)
        assert_each(joints_of(one.trajectory, t)[0], "<=", high + 1e-9)


def test_of_a_constraint_only_the_rows_of_its_best_entries_to_both_places_beside_count():
    entry, group = np.array([0, 0, 2, 3, 4, 4, 6, 7]), np.array([0, 0, 0, 3, 4, 4, 4, 7])

    def looked_at(**changes):  # a terminal and an axis of the body
        bound = np.isin(np.arange(6), (0, 3))
        cones = [replace(one.cones, bound=one.cones.bound & bound, **changes) for one in PROBLEMS]
        own = [replace(one, cones=rows) for one, rows in zip(PROBLEMS, cones, strict=True)]
        return motion(CURVES, stack_at(own, PLACES)).margins

    every, found = looked_at(), looked_at(entry=entry, group=group, nested=True)
    of_rows = every.min(axis=2)
    last = len(PLACES) - 1
    for curve, place in np.ndindex(found.shape[:2]):
        kept = {3, 7}
        for other in (max(place - 1, 0), min(place + 1, last)):
            row = np.minimum(of_rows[curve, place], of_rows[curve, other])
            kept |= {0, 1} if min(row[0], row[1]) >= row[2] else {2}
            kept |= {4, 5} if min(row[4], row[5]) >= row[6] else {6}
        for number in range(8):
            expected = every[curve, place, :, number] if number in kept else np.inf
            np.testing.assert_array_equal(found[curve, place, :, number], expected)
    assert {*np.isfinite(found[:, :, 0, :3]).ravel().tolist()} == {True, False}


def test_slopes_of_margins_are_those_of_differences_for_every_kind_of_row():
    own, step = motion(CURVES), 1e-6
    index = np.nonzero(np.isfinite(own.margins))
    slopes = margin_slopes(own, *index)
    for axis in range(7):
        change = np.zeros_like(CURVES)
        change[:, 0, :, axis] = step
        ahead, behind = (motion(CURVES + sign * change).margins[index] for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, axis], (ahead - behind) / (2 * step), atol=1e-7)


def test_no_step_changes_a_margin_by_more_than_its_reach_and_what_cannot_move_has_none():
    own, which = motion(CURVES), np.array([1])
    index = np.nonzero(np.isfinite(own.margins[which]))
    slopes = margin_slopes(own, index[0] + 1, *index[1:])
    closest = np.zeros(len(KINDS))
    for _ in range(50):
        step = RNG.normal(size=(1, len(PLACES), 7)) * RNG.integers(0, 2, 7)
        reach = margin_reach(own, which, step)[index]
        change = np.abs(np.einsum("ra,ra->r", slopes, step[0, index[1]]))
        assert_each(change, "<=", reach * (1 + 1e-12))
        shares = np.divide(change, reach, out=np.zeros_like(change), where=reach > 0)
        np.maximum.at(closest, index[3], shares)
    assert_each(closest, ">", 0.8)
    step = np.zeros((1, len(PLACES), 7))
    step[..., :3] = 1.0
    frames = np.array([frame for frame, _, _ in KINDS])
    np.testing.assert_array_equal(
        np.any(margin_reach(own, which, step)[0] > 0, axis=(0, 1)), frames == INERTIAL
    )


def test_rows_that_a_step_may_reach_lose_what_their_slopes_say():
    rows = BASIS.rows(PLACES)
    coefficients, change = RNG.normal(size=(2, BASIS.size, 7))
    stack = stack_at(PROBLEMS, PLACES, rows)
    at = stack.iterates(np.stack([coefficients[::-1], coefficients]), np.ones(2))
    zones, change = MarginBlock(at=at, slack=at.margins - 0.01), 0.05 * change
    lessened = zones.change(np.array([1]), change[None], (rows @ change)[None])[0]
    index = np.nonzero(np.isfinite(at.margins[1]))
    axes, basis = zones.slopes((np.ones_like(index[0]), *index))
    by_slopes = np.einsum("rja,rjn,na->r", axes, basis, change)
    looked = lessened[index] != 0
    assert 0.1 < looked.mean() < 0.9
    np.testing.assert_allclose(lessened[index][looked], by_slopes[looked], rtol=1e-9)
    moved = ~looked & (by_slopes != 0)
    assert_each(zones.slack[1][index][moved], ">=", (by_slopes + zones.tolerance)[moved])


def test_what_breaks_a_row_goes_by_the_name_of_what_it_is_fixed_to():
    rows = fits()["all"][0]
    discrete = SimpleNamespace(problem=SimpleNamespace(spacecraft=CRAFT, cones=rows))

    def breach(margins):
        solution = SimpleNamespace(margins=margins)
        return Attempt(discrete=discrete, solution=solution, trajectory=None, peaks=None).breach

    called = []
    for sight in range(8):
        margins = np.full((5, 8, len(rows.axis)), 0.1)
        assert breach(margins) is None
        margins[3, sight, 1] = -0.2
        name, depth = breach(margins)
        called.append(name)
        assert depth == 0.2
    assert called == ["terminal-1", "terminal-2", "camera-1", "the body", *["terminal-2"] * 4]
