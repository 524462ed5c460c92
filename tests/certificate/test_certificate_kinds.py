"""Margins of every kind of row, as the certificate proves them, against dense sampling by scipy."""

import re
from dataclasses import replace

import kinds
import numpy as np
import pytest
from builders import turning_direction
from manoeuvres import claimed, craft, ends, grid, least, manoeuvre
from oblique import oblique_craft
from reference import assert_each, attitudes_of, joints_of, random_units

from jaxplan.certificate import Claim, bounds, certify, certify_batch, form, prove_margins
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Motion
from jaxplan.certificate.proof import negligible
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT

MIXED = (INERTIAL, BODY, SIGHT, JOINTS)
DENSE = 12_001


def table_of(craft, rows, body=(), carried=()):
    """Constraints from rows given as mappings; what is carried are pairs of a terminal and a vector."""
    carrier, vectors = zip(*carried, strict=True) if carried else ((), ())
    return kinds.table_of(rows, len(craft.device_names), body=body, carrier=carrier, carried=vectors)


def pair_margins(trajectory, craft, table, time):
    """Margins (k, Z, S), +inf where a row binds nothing."""
    attitudes, joints = attitudes_of(trajectory, time), joints_of(trajectory, time, orders=1)[0]
    return kinds.pair_margins_of(craft, table, attitudes, joints, time)


def margins_by_constraint(margin, table):
    """Margins (k,) of what must hold by itself, by the rows and sights that it is made of."""
    found = {}
    for group in np.unique(table.group):
        rows = np.flatnonzero(table.group == group)
        rows = rows[table.bound[rows].any(axis=1)]
        entries = np.unique(table.entry[rows])
        if len(entries) == 1:
            for sight in np.flatnonzero(table.bound[rows].any(axis=0)):
                own = rows[table.bound[rows, sight]]
                found[tuple(own), (sight,)] = margin[:, own, sight].min(axis=1)
        elif len(entries):
            worst = [margin[:, rows[table.entry[rows] == entry]].min(axis=(1, 2)) for entry in entries]
            found[tuple(rows), ()] = np.max(worst, axis=0)
    return found


def random_table(rng, trajectory, craft, frames, *, nested=True, moving=False, count=7):
    """Random rows of some kinds about margins that are partly kept, in random entries and groups."""
    terminals = len(craft.terminals)
    body = random_units(rng, 2)
    gimbals = craft.gimbals.count  # the later ones are drives
    carried = [(int(rng.integers(gimbals)), vector) for vector in random_units(rng, 2)] if gimbals else []
    sights = len(craft.device_names) + len(body) + len(carried)
    rows = []
    entry = group = 0
    for row in range(count):
        if not nested or rng.random() < 0.6:
            entry = row
            group = row if not nested or rng.random() < 0.5 else group
        frame = int(rng.choice([f for f in frames if terminals or f != JOINTS]))
        one = {"frame": frame, "side": rng.choice([-1.0, 1.0]), "entry": entry, "group": group}
        one |= {"axis": random_units(rng), "half_angle": 1.0}
        one["bound"] = rng.permutation(sights)[: rng.integers(1, 4)]
        if frame == INERTIAL and moving and rng.random() < 0.7:
            one["path"] = turning_direction(
                rng, rng.uniform(0, 0.05), np.linspace(-1, trajectory.duration + 1, 30)
            )
        if frame == SIGHT:
            one["partner"], one["bound"] = int(one["bound"][0]), rng.permutation(sights)[:1]
            if one["bound"][0] == one["partner"]:
                one["bound"] = [(one["partner"] + 1) % sights]
        if frame == JOINTS:
            angle = rng.uniform(0, 2 * np.pi)
            one |= {"side": 1.0, "axis": np.array([np.cos(angle), np.sin(angle), 0])}
            one["bound"] = rng.permutation(terminals)[: rng.integers(1, terminals + 1)]
        rows.append(one)
    first = table_of(craft, rows, body, carried)
    lowest = pair_margins(trajectory, craft, first, grid(trajectory, 401)).min(axis=(0, 2))
    for one, worst in zip(rows, lowest, strict=True):
        by = worst - rng.uniform(-0.1, 0.5)  # how much harder it may be
        if one["frame"] == JOINTS:
            one["half_angle"] += by
        else:
            one["half_angle"] = float(np.clip(one["half_angle"] + one["side"] * by, 0.02, 3.12))
    return table_of(craft, rows, body, carried)


def names_of(table):
    return [f"z{row}" for row in range(len(table.frame))]


def judge(trajectory, craft, table, **changes):
    return certify(
        claimed(
            trajectory, craft, table, **({"zone_names": names_of(table)} | ends(trajectory, craft) | changes)
        )
    )


KINDS = {
    "inertial": (INERTIAL,),
    "body": (BODY,),
    "sight": (SIGHT,),
    "joints": (JOINTS,),
    "mixed": MIXED,
    "no terminals": (INERTIAL, BODY, SIGHT),
    "mounted in any way, with drives": MIXED,
}


def loose(spacecraft):
    """The spacecraft with limits and ranges so wide that a manoeuvre keeps them."""
    wide = {"range": np.array([-9.0, 9.5]), "rate_limit": 9.0, "acceleration_limit": 9.0}
    own = {"yaw_range": np.array([-9.5, 9.0]), "pitch_range": np.array([-1.57, 1.57])}
    own |= {f"{axis}_{what}_limit": 9.0 for axis in ("yaw", "pitch") for what in ("rate", "acceleration")}
    return replace(
        spacecraft,
        terminals=tuple(replace(terminal, **own) for terminal in spacecraft.terminals),
        drives=tuple(replace(drive, **wide) for drive in spacecraft.drives),
        rate_limit=9.0,
        acceleration_limit=9.0,
    )


def scene(name, seed, **changes):
    rng = np.random.default_rng([seed, len(name)])
    terminals = 0 if name == "no terminals" else (1, 2, 4)[seed % 3]
    drives = 1 + seed % 2 if name.endswith("drives") else 0
    spacecraft = craft(terminals, instruments=1 + seed % 2)
    if drives:
        spacecraft = loose(oblique_craft(terminals, drives, instruments=1, seed=seed))
    trajectory = manoeuvre(
        seed,
        terminals=terminals,
        drives=drives,
        pieces=1 + seed % 3,
        joint_pieces=1 + seed % 2,
        wiggle=0.5,
    )
    return trajectory, spacecraft, random_table(rng, trajectory, spacecraft, KINDS[name], **changes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "moving"), [*((name, False) for name in KINDS), ("inertial", True), ("mixed", True)]
)
def test_margin_bound_is_below_every_sample_and_near_the_least(name, moving):
    verdicts = set()
    for seed in range(9):
        trajectory, spacecraft, table = scene(name, seed, moving=moving)
        time = grid(trajectory, DENSE)
        margin = pair_margins(trajectory, spacecraft, table, time)
        every = margins_by_constraint(margin, table)
        lowest = min(one.min() for one in every.values())
        report = judge(trajectory, spacecraft, table)
        near = max(0.01 * abs(lowest), 1e-6) + 1e-5
        assert lowest - near <= report.min_margin <= lowest + 1e-12
        assert report.certified == (lowest > 0)
        verdicts.add(report.certified)
        row = int(report.worst_zone[1:])
        there = pair_margins(trajectory, spacecraft, table, np.array([report.worst_time]))
        assert np.abs(there[0, row] - lowest).min() <= near
        found = prove_margins(claimed(trajectory, spacecraft, table, zone_names=names_of(table)))
        assert len(found) == len(every)
        expected = {tuple(f"z{row}" for row in rows): [] for rows, _ in every}
        for (rows, _), own in every.items():
            expected[tuple(f"z{row}" for row in rows)].append(own.min())
        for zones, wanted in expected.items():
            proved = np.sort([one.bound for one in found if one.zones == zones])
            wanted = np.sort(wanted)
            assert_each(proved, "<=", wanted + 1e-12)
            assert_each(proved, ">=", wanted - np.maximum(0.01 * np.abs(wanted), 1e-6) - 1e-5)
    assert verdicts == {False, True}


def just_kept(trajectory, craft, table, row, sight, excess):
    """A table of one row for one sight, whose least margin over all time is the given one."""
    parts = ("axis", "frame", "partner", "half_angle", "side", "bound")
    lone = replace(
        table,
        **{name: getattr(table, name)[[row]] for name in parts},
        entry=np.zeros(1, int),
        group=np.zeros(1, int),
        zone=np.zeros(1, int),
        paths=table.paths[row : row + 1],
        nested=False,
    )
    lone.bound[0] = np.arange(lone.bound.shape[1]) == sight

    worst, _ = least(trajectory, lambda t: pair_margins(trajectory, craft, lone, t)[:, 0, sight])
    harder = (worst - excess) * (1.0 if lone.frame[0] == JOINTS else lone.side[0])
    return replace(lone, half_angle=lone.half_angle + harder)


def swinging(name, seeds):
    """Scenes, and of each the first row and sight whose margin changes by much."""
    for seed in seeds:
        trajectory, spacecraft, table = scene(name, 100 + seed, nested=False)
        margin = pair_margins(trajectory, spacecraft, table, np.linspace(0, trajectory.duration, 200))
        swing = np.ptp(np.where(table.bound, margin, 0), axis=0)
        for row, sight in np.argwhere(swing > 0.1)[:1]:
            yield trajectory, spacecraft, table, row, sight


@pytest.mark.slow
@pytest.mark.parametrize("name", ["body", "sight", "joints"])
def test_a_row_that_is_broken_for_a_moment_between_samples_is_never_certified(name):
    between = 0
    for trajectory, spacecraft, table, row, sight in swinging(name, range(12)):
        for excess in (1e-10, -3e-9):
            tuned = just_kept(trajectory, spacecraft, table, row, sight, excess)
            if name != "joints" and not 0.02 < tuned.half_angle[0] < 3.1:
                continue
            report = judge(trajectory, spacecraft, tuned)
            assert report.min_margin == pytest.approx(excess, abs=3e-10)
            assert report.certified == (excess > 0), report.faults
            if excess < 0:  # mostly nobody who looks now and then would have seen it
                seldom = np.linspace(0, trajectory.duration, 200)
                between += pair_margins(trajectory, spacecraft, tuned, seldom).min() > 0
    assert between > 3


@pytest.mark.parametrize("name", ["body", "sight", "joints"])
def test_stated_errors_are_counted_into_margins_of_every_kind(name):
    size, seen = 1e-6, 0
    for trajectory, spacecraft, table, row, sight in swinging(name, range(8)):
        tuned = just_kept(trajectory, spacecraft, table, row, sight, 0.0)
        angle = tuned.half_angle[0]
        if name != "joints" and not 0.2 < angle < 2.9:
            continue
        seen += 1
        bindings = Bindings.of(form.plain(tuned), len(spacecraft.terminals))
        motion = Motion.of(spacecraft, bindings.views, trajectory)
        evidence = bounds.gather(motion, negligible(spacecraft, [bindings]))
        weight = np.abs(tuned.axis[0, :2]).sum() if name == "joints" else 1 / np.sin(angle)
        chord = 1.0 if name == "joints" else 2 * min(np.sin(angle / 2), np.cos(angle / 2))
        for part, lost in (("left_out", weight), ("rounding", bounds.LEBESGUE * chord * weight)):
            off = getattr(evidence, part)
            worse = {"direction": off.direction + 0, "joints": off.joints + 0}
            if name == "joints":
                worse["joints"][0] += size
            else:
                worse["direction"][bindings.view[0]] += size
            found = bindings.prove(replace(evidence, **{part: replace(off, **worse)}))
            assert found.bound[0] == pytest.approx(-size * lost, rel=0.02, abs=1e-9)
    assert seen > 2


def test_margins_within_the_body_are_exact_while_the_platform_tumbles_and_joints_rest():
    spacecraft = craft(2, instruments=1)
    trajectory = manoeuvre(3, terminals=2, step=2.0, wiggle=1.0)
    still = np.zeros_like(trajectory.joint_coefficients)
    still[:, 0] = [0.3, -0.8, 0.5, 0.2]
    trajectory = replace(trajectory, joint_coefficients=still)
    rng = np.random.default_rng(4)
    rows = [
        {"frame": BODY, "axis": random_units(rng), "half_angle": 0.4, "bound": range(5)},
        {"frame": SIGHT, "partner": 0, "half_angle": 0.1, "bound": [1]},
        {"frame": SIGHT, "partner": 4, "half_angle": 3.0, "side": -1.0, "bound": [0]},
        {"frame": JOINTS, "axis": [0.6, 0.8, 0.0], "half_angle": -2.0, "bound": [0, 1]},
    ]
    table = table_of(spacecraft, rows, body=random_units(rng, 1), carried=[(1, random_units(rng))])
    exact = pair_margins(trajectory, spacecraft, table, np.array([1.0]))[0]
    found = prove_margins(claimed(trajectory, spacecraft, table, zone_names=names_of(table)))
    np.testing.assert_allclose([one.bound for one in found], exact[exact < np.inf], rtol=0, atol=1e-11)
    calm = replace(trajectory, coefficients=0 * trajectory.coefficients, chart_rate=0 * trajectory.chart_rate)
    reports = [judge(motion, spacecraft, table) for motion in (trajectory, calm)]
    assert reports[0].min_margin == pytest.approx(reports[1].min_margin, abs=1e-12)


def test_a_beam_that_sweeps_across_what_stands_still_is_seen():
    """Of a sight that does not move the motion of its axis counts, alone."""
    spacecraft = craft(1, instruments=1)
    trajectory = manoeuvre(13, terminals=1, joint_pieces=1, wiggle=0.5)
    trajectory = replace(
        trajectory, coefficients=0 * trajectory.coefficients, chart_rate=0 * trajectory.chart_rate
    )
    trajectory = replace(trajectory, chart_attitude=trajectory.chart_attitude[[0] * 3])
    rows = [{"frame": SIGHT, "partner": 0, "half_angle": 0.3, "bound": [1]}]
    table = table_of(spacecraft, rows)
    for side in (1.0, -1.0):
        own = replace(table, side=np.array([side]))
        tuned = just_kept(trajectory, spacecraft, own, 0, 1, -1e-3)
        report = judge(trajectory, spacecraft, tuned)
        assert not report.certified
        assert report.min_margin == pytest.approx(-1e-3, abs=2e-5)
        assert report.min_margin <= -1e-3 + 1e-12


def test_a_terminal_may_pass_a_mask_on_one_side_after_the_other():
    spacecraft = craft(1, instruments=0)
    trajectory = manoeuvre(11, terminals=1)
    way = joints_of(trajectory, grid(trajectory), orders=1)[0]
    along = (way[-1] - way[0]) / np.linalg.norm(way[-1] - way[0])
    # a right angle whose corner is ahead of the middle: the way leaves by the one side, then by the other
    by, middle = 0.002, (way[0] + way[-1]) / 2
    sides = [np.array([-along[1], along[0]]) * sign for sign in (1, -1)]
    both = [np.stack([across + along, across - along]) / np.sqrt(2) for across in sides]
    normals = max(both, key=lambda two: np.max((way - middle) @ two.T, axis=1).min())
    best = np.max((way - middle) @ normals.T, axis=1).min() - by
    rows = [
        {
            "frame": JOINTS,
            "axis": [*normal, 0],
            "half_angle": best + normal @ middle,
            "bound": [0],
            "group": 0,
        }
        for normal in normals
    ]
    report = judge(trajectory, spacecraft, table_of(spacecraft, rows))
    assert report.certified
    assert 0.9 * by < report.min_margin <= by
    sides = [one | {"side": -1.0} for one in rows]  # which mean nothing for rows of joints
    assert judge(trajectory, spacecraft, table_of(spacecraft, sides)).min_margin == report.min_margin
    apart = [one | {"group": row} for row, one in enumerate(rows)]
    assert not judge(trajectory, spacecraft, table_of(spacecraft, apart)).certified
    wider = [one | {"half_angle": one["half_angle"] + 2 * by} for one in rows]
    report = judge(trajectory, spacecraft, table_of(spacecraft, wider))
    (fault,) = report.faults
    assert re.match(
        r"terminal-0 is 0\.11\d? deg inside the mask z[01], the nearest to hold of its group,", fault
    )


def test_faults_name_what_is_bound_and_the_kind_of_row():
    spacecraft = craft(2, instruments=1)
    trajectory = manoeuvre(5, terminals=2)
    rng = np.random.default_rng(6)
    rows = [
        {"frame": BODY, "axis": random_units(rng), "half_angle": 3.1, "bound": [3]},
        {"frame": SIGHT, "partner": 0, "half_angle": 3.1, "bound": [1]},
        {"frame": INERTIAL, "axis": random_units(rng), "half_angle": 0.01, "side": -1.0, "bound": [4]},
        {"frame": JOINTS, "axis": [1.0, 0, 0], "half_angle": 50.0, "bound": [1]},
        {"frame": BODY, "axis": random_units(rng), "half_angle": 3.1, "bound": [2], "entry": 4},
        {"frame": BODY, "axis": random_units(rng), "half_angle": 3.1, "bound": [2], "entry": 4},
    ]
    table = table_of(spacecraft, rows, body=random_units(rng, 1), carried=[(1, random_units(rng))])
    pattern = re.compile(r"(.+) is \S+ deg (inside|outside) the (.+ z\d) at t = ")
    report = judge(trajectory, spacecraft, table)
    said = [pattern.match(fault).groups() for fault in report.faults]
    assert said[:4] == [
        ("an axis of the body", "inside", "keep-out zone z0"),
        ("terminal-1", "inside", "keep-out zone z1"),
        ("a vector of terminal-1", "outside", "keep-in zone z2"),
        ("terminal-1", "inside", "mask z3"),
    ]
    # of an entry that must hold by itself there is one sentence for each sight: its worst row
    worst = pair_margins(trajectory, spacecraft, table, grid(trajectory))[:, 4:, 2].min(axis=0).argmin() + 4
    assert said[4:] == [("instrument-0", "inside", f"keep-out zone z{worst}")]
    names = ["a", "b", "c", "panel", "edge"]
    named = judge(trajectory, spacecraft, table, sight_names=names)
    assert [pattern.match(fault)[1] for fault in named.faults] == ["panel", "b", "edge", "b", "c"]
    assert named.worst_device == "b"
    proved = prove_margins(
        claimed(trajectory, spacecraft, table, zone_names=names_of(table), sight_names=names)
    )
    assert [one.device for one in proved] == ["panel", "b", "edge", "b", "c"]
    assert [
        one.device
        for one in prove_margins(claimed(trajectory, spacecraft, table, zone_names=names_of(table)))
    ] == [words for words, *_ in said]
    (fault,) = judge(trajectory, spacecraft, table, sight_names=names[:3]).faults
    assert fault == "sight_names has 3 names for 5 sights"


@pytest.fixture(scope="module")
def claims():
    """Of all kinds of rows, by several and by the same spacecraft, and of plain zones."""
    found = []
    for seed in range(24):
        name = list(KINDS)[seed % len(KINDS)] if seed < 18 else "inertial"
        trajectory, spacecraft, table = scene(name, seed, moving=seed % 6 == 5)
        found.append((trajectory, spacecraft, table))
        other = manoeuvre(1000 + seed, terminals=len(spacecraft.terminals), pieces=2 + seed % 2)
        found.append((other, spacecraft, table))
    return [
        Claim(
            trajectory=trajectory,
            spacecraft=spacecraft,
            cones=table,
            zone_names=names_of(table),
            **ends(trajectory, spacecraft),
        )
        for trajectory, spacecraft, table in found
    ]


def test_reports_made_together_are_those_made_alone(claims):
    alone = [repr(vars(certify_batch([one])[0])) for one in claims]
    for order in (np.arange(len(claims)), np.random.default_rng(0).permutation(len(claims))):
        together = certify_batch([claims[number] for number in order])
        assert [repr(vars(report)) for report in together] == [alone[number] for number in order]


def good():
    """A manoeuvre and a table of every kind, all of whose rows hold."""
    spacecraft = craft(2, instruments=1)
    trajectory = manoeuvre(8, terminals=2)
    rng = np.random.default_rng(9)
    rows = [
        {"frame": INERTIAL, "axis": random_units(rng), "half_angle": 1e-3, "bound": range(6), "group": 0},
        {
            "frame": BODY,
            "axis": random_units(rng),
            "half_angle": 1e-3,
            "bound": range(6),
            "entry": 1,
            "group": 0,
        },
        {"frame": JOINTS, "axis": [0.6, 0.8, 0], "half_angle": -9.0, "bound": [0, 1], "entry": 1, "group": 0},
        {"frame": SIGHT, "partner": 0, "half_angle": 1e-3, "bound": [1]},
        {"frame": SIGHT, "partner": 3, "half_angle": 1e-3, "bound": [4]},
        {"frame": JOINTS, "axis": [0, 1.0, 0], "half_angle": -9.0, "bound": [1]},
    ]
    return (
        trajectory,
        spacecraft,
        table_of(spacecraft, rows, random_units(rng, 1), zip((1, 0), random_units(rng, 2), strict=True)),
    )


SCENE = good()


def changed(name, index, value):
    array = np.array(getattr(SCENE[2], name), np.float64)
    array[index] = value
    return {name: array}


def test_a_table_of_every_kind_is_certified():
    assert judge(*SCENE).certified


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_wherever_it_stands_in_a_table(value):
    trajectory, spacecraft, table = SCENE
    names = [
        *("axis", "frame", "partner", "half_angle", "side", "bound", "entry", "group"),
        *("body", "carrier", "carried"),
    ]
    for name in names:
        for index in np.ndindex(getattr(table, name).shape):
            report = judge(trajectory, spacecraft, replace(table, **changed(name, index, value)))
            assert not report.certified, (name, index)
            assert report.faults[0] == f"cones.{name} is not finite"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (changed("frame", 1, 4), "frame is none of the four"),
        (changed("frame", 1, -1), "frame is none of the four"),
        (changed("frame", 1, 0.5), "frame is none of the four"),
        (changed("partner", 3, 6), "partner is none of the 6 sights"),
        (changed("partner", 3, -1), "partner is none of the 6 sights"),
        (changed("partner", 3, 1), "does not bind exactly one other"),
        (changed("bound", (3, 2), 1), "does not bind exactly one other"),
        (changed("bound", 3, 0), "does not bind exactly one other"),
        (changed("bound", (5, 2), 1), "binds more than terminals"),
        (changed("bound", (5, 5), 1), "binds more than terminals"),
        (changed("carrier", 0, 2), "carrier is none of the 2 devices with joints"),
        (changed("carrier", 0, -1), "carrier is none of the 2 devices with joints"),
        (changed("body", (0, 0), 3.0), "body is no unit vector"),
        (changed("carried", (1, 0), 3.0), "carried is no unit vector"),
        (changed("axis", 1, 0.0), "axis is no unit vector"),
        (changed("axis", (2, 0), 0.5), "axis is no unit vector"),
        (changed("axis", 2, [0.6, 0, 0.8]), "not of yaw and pitch alone"),
        (changed("half_angle", 1, 0.0), "not between 0 and 180 deg"),
        (changed("half_angle", 3, -1.0), "not between 0 and 180 deg"),
        (changed("side", 3, 0.0), "neither +1 nor -1"),
        (changed("entry", 2, 0), None),  # another table, of as good a form
        (changed("entry", 2, 2), None),
        (changed("entry", 1, 2), "entry is not the first row"),
        (changed("entry", 3, 2), "entry is not the first row"),
        (changed("entry", 3, -1), "entry is not the first row"),
        (changed("entry", 3, 1), "entry has rows of several groups"),
        (changed("group", 2, 2), "entry has rows of several groups"),
        (changed("group", 3, 2), "group is not the first row"),
        (changed("group", 0, 0.5), "group is not the first row"),
        (changed("group", 5, 9), "group is not the first row"),
        ({"body": np.zeros((1, 2))}, "cones.body has the shape (1, 2) and not (1, 3)"),
        ({"body": np.array(1.0)}, "cones.body has the shape"),
        ({"carrier": np.zeros(3)}, "cones.carrier has the shape (3,) and not (2,)"),
        ({"carried": np.zeros((0, 3))}, "cones.bound has the shape (6, 6) and not (6, 4)"),
        ({"body": np.zeros((0, 3))}, "cones.bound has the shape (6, 6) and not (6, 5)"),
        ({"partner": np.zeros(5)}, "cones.partner has the shape"),
        ({"entry": np.zeros(5)}, "cones.entry has the shape"),
        ({"paths": (None,) * 7}, "cones.paths has 7 axes for 6 rows"),
        (
            {"paths": (None, turning_direction(np.random.default_rng(0), 0.01, np.linspace(0, 90, 9)))},
            "an axis that moves and is not inertial",
        ),
    ],
)
def test_tables_of_a_wrong_form_are_refused(changes, words):
    trajectory, spacecraft, table = SCENE
    report = judge(trajectory, spacecraft, replace(table, **changes))
    assert report.certified == (words is None), report.faults
    assert words is None or any(words in fault for fault in report.faults), report.faults


def test_what_a_table_says_of_itself_is_not_trusted():
    trajectory, spacecraft, table = SCENE
    rows = replace(table, half_angle=np.where(table.frame == SIGHT, 3.1, table.half_angle))
    assert len(judge(trajectory, spacecraft, replace(rows, inner=False, nested=False)).faults) == 2
