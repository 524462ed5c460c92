"""Scenarios and arguments made in Python: what may be given, and how everything else is refused by name."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from datetime import datetime
from functools import partial
from inspect import signature
from pathlib import Path

import jax
import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan import so3
from jaxplan.planner.entry_points import as_filed
from jaxplan.schema import load_scenario, with_settings

PACKAGE = Path(jp.__file__).parent
EVERY_KEY = load_scenario(Path(__file__).parents[1] / "scenarios" / "every_key.toml")
SCENE = make_scenario(3, 1)
SUN = jp.KeepOut(name="sun", direction=[0, 0, 1], half_angle=0.1)
ANGLES = np.linspace(0, 0.4, 5)
ARC = jp.DirectionPath.through(
    np.linspace(0, 100, 5), np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1)
)
MOVING = replace(
    EVERY_KEY,
    goal=jp.Targets(directions=(ARC, np.array([0.0, 0.6, 0.8])), yaw_limit=1.0, pitch_limit=0.1),
    keep_out=(replace(EVERY_KEY.keep_out[0], direction=ARC),),
    keep_in=(replace(EVERY_KEY.keep_in[0], direction=ARC),),
)


def changes(value, to) -> Iterator[tuple[str, object]]:
    """Copies of a value in which one number is another one, each with the number's place."""
    if is_dataclass(value):
        for field in fields(value):
            for place, changed in changes(getattr(value, field.name), to):
                yield f".{field.name}{place}", replace(value, **{field.name: changed})
    elif isinstance(value, tuple):
        for i, entry in enumerate(value):
            for place, changed in changes(entry, to):
                yield f"[{i}]{place}", (*value[:i], changed, *value[i + 1 :])
    elif isinstance(value, Mapping):
        for key in value:
            yield f".{key}", {**value, key: to}
    elif isinstance(value, np.ndarray):
        for index in np.ndindex(value.shape):
            changed = value.astype(float)
            changed[index] = to
            yield "".join(f"[{i}]" for i in index), changed
    elif isinstance(value, int | float):
        yield "", to


def named(place: str) -> str:
    """How a fault spells a place: as Python does."""
    return place.removeprefix(".")


@pytest.mark.parametrize("scenario", [EVERY_KEY, MOVING], ids=["still", "moving"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf], ids=str)
def test_no_number_of_a_scenario_may_be_other_than_finite(scenario, value):
    count = 0
    for place, bad in changes(scenario, value):
        for_good = place.endswith((".search.time_limit", ".trajectory.node_tube", ".lasts"))
        if value == np.inf and for_good:
            continue
        count += 1
        with pytest.raises(jp.ScenarioError) as caught:
            as_filed("scenario", bad)
        wanted = rf"{re.escape(named(place))} = \[?[^=]*{value}.*: must be"
        assert any(re.match(wanted, fault) for fault in caught.value.faults), (place, caught.value.faults)
    assert count > 80


LOST = replace(SCENE, goal=replace(SCENE.goal, rotation_vector=np.array([0.0, np.nan, 0.0])))


@pytest.fixture(scope="module")
def plan():
    return jp.plan(SCENE, progress=False)


@pytest.fixture(scope="module")
def switch():
    return jp.link_switch(jp.walker("30:36/6/3", 2000.0))


@pytest.mark.parametrize(
    ("name", "call"),
    {
        "scenario": lambda plan: jp.plan(LOST),
        "scenarios[1]": lambda plan: jp.plan_batch([SCENE, LOST]),
        "scenarios_or_seeds[1]": lambda plan: jp.run_study([SCENE, LOST]),
        "scenarios[0]": lambda plan: jp.tune(LOST, "effort", over=["trajectory.rate_weight"]),
        "scenarios_or_seeds[0]": lambda plan: jp.tune_search([LOST]),
        "scenario ": lambda plan: jp.follow(plan, LOST),
        "the scenario": lambda plan: jp.save_scenario(LOST, "never.toml"),
    }.items(),
    ids=["plan", "plan_batch", "run_study", "tune", "tune_search", "follow", "save_scenario"],
)
def test_every_door_refuses_a_goal_that_is_no_number(name, call, plan, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(jp.ScenarioError) as caught:
        call(plan)
    assert (
        str(caught.value)
        == f"{name.strip()}: goal.rotation_vector[1] = nan: must be finite and lie in [-1e3, 1e3]"
    )
    assert not list(tmp_path.iterdir())


def test_a_constellation_of_which_one_satellite_is_lost_is_refused_by_its_number(switch):
    directions = switch.directions.copy()
    directions[1, 17, 0, 2] = np.nan
    with pytest.raises(jp.ScenarioError, match=r"scenarios_or_seeds\[2\]: goal\.directions\[0\]\[2\] = nan"):
        jp.plan_constellation(replace(switch, directions=directions), satellites=[3, 5, 17])


# What newcomers write instead, and words of what they are told.


def scene(**parts):
    return replace(SCENE, **parts)


def craft(**parts):
    return replace(SCENE, spacecraft=replace(SCENE.spacecraft, **parts))


def terminal(**parts):
    first, *others = SCENE.spacecraft.terminals
    return craft(terminals=(replace(first, **parts), *others))


def start(**parts):
    return replace(SCENE, start=replace(SCENE.start, **parts))


def targets(directions):
    return replace(SCENE, goal=jp.Targets(directions=directions))


def zone(**parts):
    return replace(SCENE, keep_out=(replace(SUN, **parts),))


def search(**parts):
    return replace(SCENE, search=replace(SCENE.search, **parts))


def trajectory(**parts):
    return replace(SCENE, trajectory=replace(SCENE.trajectory, **parts))


SCENARIOS = {
    "a number with a unit": (
        terminal(mount="10 deg"),
        "spacecraft.terminals[0].mount = '10 deg': must be a number",
    ),
    "degrees": (
        terminal(yaw_limit=90),
        "scenario: spacecraft.terminals[0].yaw_limit = 90.0 rad: must lie in (0, 3.14159]",
    ),
    "degrees of a zone": (
        zone(half_angle=7.0),
        "scenario: keep_out[0].half_angle = 7.0 rad: must lie in (0, 3.14159)",
    ),
    "joints in degrees": (
        start(joints=[0, 0, 0, 0, 2e3, 0]),
        "scenario: start.joints[4] = 2000.0 rad: must lie in [-1e3, 1e3]",
    ),
    "a duration of none": (trajectory(duration=0), "scenario: trajectory.duration = 0.0 s: must lie in [1e"),
    "a path that ends early": (
        replace(zone(direction=ARC), trajectory=replace(SCENE.trajectory, duration=500)),
        "keep_out[0].direction.times: must reach trajectory.duration = 500, ends at 100",
    ),
    "a path that jumps": (
        targets(
            [
                replace(ARC, samples=ARC.samples[[0, 1, 0, 1, 3]] * [[1], [1], [2], [1], [1]]),
                [0, 1, 0],
                [0, 0, 1],
            ]
        ),
        "goal.directions[0].samples[2] = [2.0, 0.0, 0.0]: must be a unit vector",
    ),
    "limits of the goal beyond the joints'": (
        replace(targets(np.eye(3)), goal=jp.Targets(directions=np.eye(3), pitch_limit=1.5)),
        "goal.pitch_limit = 1.5 rad: must not exceed spacecraft.terminals[0].pitch_limit = ",
    ),
    "rates of a motion that is stretched": (
        replace(start(angular_velocity=[0, 0, 0.1]), trajectory=jp.TrajectorySettings(method="paper")),
        "stretching the time would change start.angular_velocity",
    ),
    "a zone without an axis": (
        zone(direction=None),
        "keep_out[0].direction: missing (or axis_body, axis_device), must be a unit vector of 3 numbers",
    ),
    "a joint bound in degrees": (
        scene(joint_bounds=[jp.JointBound(name="edge", device="terminal-1", normal=[0, 1], least=-20)]),
        "scenario: joint_bounds[0].least = -20.0 rad: must lie in [-17.4533, 17.4533]",
    ),
    "a further vector that is long": (
        zone(vectors=[jp.FixedVector(along=[0, 0, 2])]),
        "keep_out[0].vectors[0].along = [0.0, 0.0, 2.0]: must be a unit vector",
    ),
    "two of a name": (
        craft(terminals=SCENE.spacecraft.terminals[:1] * 3),
        "spacecraft.terminals[2].name = 'terminal-1': the same as spacecraft.terminals[0].name",
    ),
    "a device twice": (
        zone(devices=("camera-1", "camera-1")),
        "keep_out[0].devices[1] = 'camera-1': is named twice",
    ),
    "too many zones": (scene(keep_out=[SUN] * 1001), "scenario: the scenario: 1001 zones, more than"),
    "no number": (zone(half_angle=None), "keep_out[0].half_angle = None: must be a number, in radians"),
    "three for one": (terminal(rate_limit=[0.1] * 3), "rate_limit = [0.1, 0.1, 0.1]: must be a number"),
    "two rates for three": (
        craft(rate_limit=[0.1, 0.2]),
        "rate_limit = [0.1, 0.2]: must be a number, in rad/s, or 3, one a body axis, not 2",
    ),
    "a rate of one axis below zero": (
        craft(rate_limit=[0.1, -0.2, 0.1]),
        "spacecraft.rate_limit[1] = -0.2 rad/s: must lie in [1.74533e-08, 17453.3]",
    ),
    "a rate of one axis that is no number": (
        craft(rate_limit=np.array([0.1, 0.2, np.nan])),
        "spacecraft.rate_limit[2] = nan rad/s: must be finite and lie in [1.74533e-08, 17453.3]",
    ),
    "a length of none": (
        craft(rate_norm_limit=0.0),
        "spacecraft.rate_norm_limit = 0.0 rad/s: must lie in [1.74533e-08, 17453.3]",
    ),
    "three lengths": (
        craft(acceleration_norm_limit=[0.1] * 3),
        "acceleration_norm_limit = [0.1, 0.1, 0.1]: must be a number, in rad/s²",
    ),
    "a matrix of accelerations": (
        craft(acceleration_limit=np.eye(3)),
        "spacecraft.acceleration_limit[0] = [1.0, 0.0, 0.0]: must be a number, in rad/s²",
    ),
    "two for three": (
        craft(torque_limit=[1, 2]),
        "torque_limit = [1, 2]: must be a number, or 3, one a body axis, not 2",
    ),
    "a limit in words": (craft(torque_limit="much"), "spacecraft.torque_limit = 'much': must be a number"),
    "torque alone": (craft(torque_limit=1.0), "torque_limit = 1.0 N m: needs spacecraft.inertia"),
    "two moments": (
        craft(inertia=[1, 2]),
        "inertia = [1, 2]: must be an array of 3 moments, or 3 rows of 3 numbers, not of 2",
    ),
    "moments that no body has": (
        craft(inertia=[1, 2, 3.5]),
        "inertia = [1.0, 2.0, 3.5]: must have no principal moment above the sum",
    ),
    "a negative limit": (
        craft(rate_limit=-0.1),
        "rate_limit = -0.1 rad/s: must lie in [1.74533e-08, 17453.3]",
    ),
    "a single terminal": (
        craft(terminals=SUN),
        "spacecraft.terminals = a KeepOut ('sun'): must be a tuple of Termin",
    ),
    "an instrument that is a terminal": (
        craft(instruments=SCENE.spacecraft.terminals[:1]),
        "spacecraft.instruments[0] = a Terminal ('terminal-1'): must be an Instrument",
    ),
    "an unknown word": (
        trajectory(duration="min"),
        "trajectory.duration = 'min': must be a number, \"stretched\" or",
    ),
    "no time limit": (search(time_limit=None), 'search.time_limit = None: must be a number or "off"'),
    "half a segment": (
        trajectory(segments=2.5),
        "trajectory.segments = 2.5: must be an integer in [1, 1000]",
    ),
    "a float for a count": (
        search(max_expansions=1e4),
        "search.max_expansions = 10000.0: must be an integer",
    ),
    "a truth value": (search(seed=True), "search.seed = True: must be an integer"),
    "an axis of the body that moves": (
        scene(keep_out=[jp.KeepOut(name="z", half_angle=0.3, axis_body=ARC, devices=["terminal-1"])]),
        "keep_out[0].axis_body = a DirectionPath: must be a unit vector of 3 numbers",
    ),
    "a boresight that moves": (
        craft(instruments=[jp.Instrument(name="camera", boresight=ARC)]),
        "must be a unit vector of 3 numbers, not a direction that moves",
    ),
    "settings as a dict": (scene(search={"seed": 1}), "search = a dict: must be a SearchSettings"),
    "no method": (search(method=None), 'search.method = None: must be "mha"'),
    "an unknown method": (search(method="a*"), "scenario: search.method = 'a*': must be \"mha\""),
    "a method with a letter too few": (
        search(method="astar"),
        'search.method = \'astar\': must be "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect"; '
        'perhaps "wastar" is meant',
    ),
    "a rate in words": (craft(rate_limit="fast"), "rate_limit = 'fast': must be a number, in rad/s"),
    "an acceleration in words": (
        craft(acceleration_limit="fast"),
        "acceleration_limit = 'fast': must be a number, in rad/s²",
    ),
    "factors in a list": (search(terminal_step_scale=[1]), "terminal_step_scale = [1]: must be a dict"),
    "a factor in words": (
        search(terminal_step_scale={"terminal-1": "x"}),
        "terminal-1 = 'x': must be a number",
    ),
    "a matrix": (
        start(rotation_vector=np.eye(3)),
        "start.rotation_vector = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0,",
    ),
    "a quaternion": (
        start(rotation_vector=[1, 0, 0, 0]),
        "a rotation vector of 3 numbers, as scipy's Rotation",
    ),
    "too few joints": (
        start(joints=np.zeros(5)),
        "start.joints = [0.0, 0.0, 0.0, 0.0, 0.0]: must be an array of 6",
    ),
    "joints in rows": (
        start(joints=np.zeros((2, 3))),
        "all yaws, all pitches, all drives, not of shape (2, 3)",
    ),
    "joints of two lengths": (
        start(joints=[[0, 0], [0]]),
        "start.joints = [[0, 0], [0]]: must be an array of 6 numbers",
    ),
    "complex joints": (start(joints=np.zeros(6) + 0j), "start.joints[0] = 0j: must be a real number"),
    "texts": (start(joints=["0"] * 6), "start.joints[0] = '0': must be a number"),
    "an array of objects": (
        start(joints=np.array([0, None] * 3)),
        "start.joints[1] = None: must be a number",
    ),
    "a masked number": (
        start(joints=np.ma.masked_invalid([0, 0, np.nan, 0, 0, 0])),
        "start.joints[2] = a masked value: must be a number",
    ),
    "one rate for all": (start(joint_rates=0.0), "start.joint_rates = 0.0: must be an array of 6 numbers"),
    "no start": (scene(start=None), "start = None: must be a GivenState"),
    "a start as an array": (scene(start=np.zeros(3)), "start = [0.0, 0.0, 0.0]: must be a GivenState"),
    "a goal as an array": (scene(goal=np.eye(3)), "must be Targets or a GivenState"),
    "too few targets": (
        targets(np.eye(3)[:2]),
        "goal.directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]: must be an array of 3",
    ),
    "one target for all": (
        targets([1, 0, 0]),
        "goal.directions = [1, 0, 0]: must be an array of 3 directions, one a terminal",
    ),
    "too few that move": (
        targets([ARC]),
        "goal.directions = a list of 1: must be an array of 3 directions, one a terminal, not of 1",
    ),
    "names of bodies": (
        targets(["sun", "moon", "earth"]),
        "goal.directions[0] = 'sun': must be a unit vector of 3 numbers",
    ),
    "targets that are long": (
        targets(2 * np.eye(3)),
        "goal.directions[0] = [2.0, 0.0, 0.0]: must be a unit vector, its norm is 2",
    ),
    "a zone by itself": (
        scene(keep_out=SUN),
        "keep_out = a KeepOut ('sun'): must be a tuple of KeepOut, or a list",
    ),
    "zones to be made": (
        scene(keep_out=(z for z in [SUN])),
        "keep_out = a generator: must be a tuple of KeepOut",
    ),
    "a zone of the other kind": (scene(keep_in=[SUN]), "keep_in[0] = a KeepOut ('sun'): must be a KeepIn"),
    "an unknown device": (
        zone(devices="tracker"),
        "keep_out[0].devices[0] = 'tracker': no such device, the devices are",
    ),
    "devices by number": (
        zone(devices=[0]),
        "keep_out[0].devices = [0]: must be a tuple of names of devices",
    ),
    "a plane direction": (
        zone(direction=[1, 0]),
        "keep_out[0].direction = [1, 0]: must be a unit vector of 3 numbers",
    ),
    "no direction": (
        zone(direction=[0, 0, 0]),
        "keep_out[0].direction = [0.0, 0.0, 0.0]: must be a unit vector, not zero",
    ),
    "a path without samples": (
        zone(direction=replace(ARC, times=ARC.times[:2])),
        "keep_out[0].direction.times = [0.0, 25.0]: must be an array of 5 rising numbers",
    ),
    "slopes of another path": (
        zone(direction=replace(ARC, slopes=2 * ARC.slopes)),
        "must be that of the spline; DirectionPath.through finds it",
    ),
    "a name that is none": (scene(name=None), "name = None: must be a line of text"),
    "an epoch in words": (scene(epoch="yesterday"), "epoch = 'yesterday': must be a time in UTC"),
    "a file": ("case-2.toml", "scenario must be a Scenario, not str; jp.load_scenario reads one from a file"),
    "several scenarios": ([SCENE], "scenario must be a Scenario, not list; jp.plan_batch plans several"),
    "the class": (jp.Scenario, "scenario must be a Scenario, not type"),
}

HERE = jp.sky.CircularOrbit(altitude=500, inclination=1, node=0, latitude=0)
SHELL = jp.walker("30:36/6/3", 2000.0)
UNUSED = Path("never")


def sun(**arguments):
    return jp.sky.keep_out(
        "sun", **{"epoch": "2026-01-01", "observer": HERE, "half_angle_deg": 9} | arguments
    )


# Of a plan; those that need none leave it out.
CALLS = {
    "plan_batch of a number": (lambda: jp.plan_batch(5), "scenarios must be several scenarios, not int"),
    "plan_batch of a file": (lambda: jp.plan_batch("case-2.toml"), "must be several scenarios, not str"),
    "paper_case that there is not": (lambda: jp.paper_case(7), "number = 7: must be 1, 2, 3 or 4"),
    "paper_case by name": (lambda: jp.paper_case("case-2"), "number = 'case-2': must be 1, 2, 3 or 4"),
    "random_scenario of a word": (lambda: jp.random_scenario("x"), "seed = 'x': must be an integer"),
    "random_scenario of a kind": (lambda: jp.random_scenario(1, "x"), "kind = 'x': must be one of keep_out"),
    "load_scenario of none": (
        lambda: jp.load_scenario(None),
        "path must be a path, as text or a pathlib.Path",
    ),
    "load_scenario of a scenario": (
        lambda: jp.load_scenario(SCENE),
        "path must be a path, as text or a pathlib.Path",
    ),
    "load_scenario of a folder": (lambda: jp.load_scenario(PACKAGE), "cannot be read: Is a directory"),
    "save_scenario the other way": (
        lambda: jp.save_scenario(UNUSED, SCENE),
        "scenario must be a Scenario, not",
    ),
    "save_scenario nowhere": (lambda: jp.save_scenario(SCENE, None), "path must be a path"),
    "load_plan of none": (lambda: jp.load_plan(None), "path must be a path"),
    "load_plan of a folder": (lambda: jp.load_plan(PACKAGE), "cannot be read: Is a directory"),
    "save nowhere": (lambda plan: plan.save(None), "path must be a path"),
    "sample in words": (lambda plan: plan.trajectory.sample("end"), "t = 'end': must be a number of seconds"),
    "sample at no time": (lambda plan: plan.trajectory.sample(None), "t = None: must be a number of seconds"),
    "sample at NaN": (lambda plan: plan.trajectory.sample([0, np.nan]), "t = nan: must lie in [0, "),
    "sample beyond the end": (
        lambda plan: plan.trajectory.sample([0, 1e9]),
        "t = 1000000000.0: must lie in [0, ",
    ),
    "export in another format": (
        lambda plan: jp.export(plan, UNUSED, format="mat"),
        "format = 'mat': the formats are",
    ),
    "export of a scenario": (
        lambda: jp.export(SCENE, UNUSED, format="csv"),
        "plan must be a Plan, not Scenario",
    ),
    "export nowhere": (lambda plan: jp.export(plan, None, format="csv"), "path must be a path"),
    "report_html of a scenario": (lambda: jp.report_html(SCENE, UNUSED), "plan must be a Plan, not Scenario"),
    "report_html nowhere": (lambda plan: jp.report_html(plan, 3), "path must be a path"),
    "certify of a zone in words": (
        lambda plan: jp.certify(replace(plan, scenario=zone(half_angle="9 deg"))),
        "keep_out[0].half_angle = '9 deg': must be a number, in radians",
    ),
    "a zone about the sun for a device twice": (
        lambda: sun(devices=("a", "b", "a")),
        "devices[2] = 'a': is named twice",
    ),
    "certify of a zone for a device twice": (
        lambda plan: jp.certify(replace(plan, scenario=zone(devices=("camera-1", "camera-1")))),
        "zone sun: devices: 'camera-1' is named twice",
    ),
    **{
        f"{draw.__name__} of a scenario": (
            partial(lambda draw: list(draw(SCENE)), draw),
            "plan must be a Plan, not Scenario; jp.plan makes one, jp.load_plan reads one",
        )
        for draw in (
            jp.plot.sphere,
            jp.plot.globe,
            jp.plot.angles,
            jp.plot.rates,
            jp.plot.accelerations,
            jp.plot.torque,
            jp.plot.margins,
            jp.plot.overview,
            jp.plot.figures,
            jp.plot.animate,
        )
    },
    "a figure on a file": (
        lambda plan: jp.plot.sphere(plan, ax="out.png"),
        "ax must be an Axes, not str; give axes, as many as panels, or a figure",
    ),
    "a view in words": (
        lambda plan: jp.plot.globe(plan, view="above"),
        "view = 'above': must be azimuth and elevation of the eye, deg, or None",
    ),
    "a view of three angles": (
        lambda plan: jp.plot.globe(plan, view=(1, 2, 3)),
        "view = (1, 2, 3): must be azimuth and elevation",
    ),
    "compare of a scenario": (
        lambda plan: jp.plot.compare({"mine": SCENE}, SCENE.spacecraft),
        "trajectories['mine'] must be a trajectory, a plan or a table of attitudes, not Scenario",
    ),
    "segments of a plan": (
        lambda plan: jp.plot.segments({"mine": plan}, SCENE.spacecraft),
        "trajectories['mine'] must be a Trajectory, not Plan; a plan has one as plan.trajectory",
    ),
    "compare of a list": (
        lambda plan: jp.plot.compare([plan.trajectory], SCENE.spacecraft),
        "trajectories must be a dict by names, not list",
    ),
    "segments of a scenario": (
        lambda plan: jp.plot.segments({"mine": plan.trajectory}, SCENE),
        "spacecraft must be a Spacecraft, not Scenario",
    ),
    "durations of a number": (
        lambda: jp.plot.durations({"minimum": 20.9}, {"case 1": 20.6}),
        "seconds['minimum'] must be a dict by names, not float",
    ),
    "durations with a bound": (
        lambda: jp.plot.durations({"minimum": {"case 1": 20.9}}, 20.6),
        "bounds must be a dict by names, not float",
    ),
    "table4 of a plan": (
        lambda plan: jp.plot.table4(plan),
        "rows must be several rows, as jaxplan.study.printed_planners",
    ),
    "table4 of plans": (
        lambda plan: jp.plot.table4([plan]),
        "rows[0] must be a row of jaxplan.study.printed_planners.comp",
    ),
    "study of a plan": (lambda plan: jp.plot.study(plan), "studies must be several studies, as jp.run_stu"),
    "study of plans": (lambda plan: jp.plot.study([plan]), "studies[0] must be a Study, as jp.run_study ret"),
    "outcomes by names": (
        lambda: jp.plot.outcomes({"mha": 1}),
        "studies['mha'] must be a Study, as jp.run_study returns, not int",
    ),
    "tuning of a plan": (
        lambda plan: jp.plot.tuning(plan),
        "result must be a Tuning or SearchTuning, as jp.tune returns, not Plan",
    ),
    "constellation of a shell": (
        lambda: jp.plot.constellation(SHELL),
        "result must be a Constellation, as jp.plan_constellation returns, not Shell",
    ),
    "boresights in words": (
        lambda: SCENE.spacecraft.boresights("level", np.zeros(6)),
        "attitude = 'level': must be real numbers of shape (..., 3, 3)",
    ),
    "boresights of too few joints": (
        lambda: SCENE.spacecraft.boresights(np.eye(3), np.zeros(3)),
        "joints = [0.0, 0.0, 0.0]: must be real numbers of shape (..., 6)",
    ),
    "joints_toward of a rotation vector": (
        lambda: SCENE.spacecraft.joints_toward([0, 0, 0], np.eye(3)),
        "attitude = [0, 0, 0]: must be real numbers of shape (..., 3, 3)",
    ),
    "joints_toward one target": (
        lambda: SCENE.spacecraft.joints_toward(np.eye(3), [0, 0, 1]),
        "directions = [0, 0, 1]: must be real numbers of shape (..., 3, 3)",
    ),
    "exp of a matrix": (
        lambda: so3.exp(None),
        "rotation_vector = None: must be real numbers of shape (..., 3)",
    ),
    "exp of complex numbers": (lambda: so3.exp(jax.numpy.zeros(3, complex)), "rotation_vector = "),
    "log of a vector": (
        lambda: so3.log(jax.numpy.zeros(3)),
        "attitude = [0.0, 0.0, 0.0]: must be real numbers of shape (..., 3, 3)",
    ),
    "log of what is traced": (
        lambda: jax.jit(so3.log)(np.zeros(3)),
        "attitude = a value that JAX traces: must be real numbers of shape (..., 3, 3)",
    ),
    "angle of a number": (lambda: so3.angle(1.0), "attitude = 1.0: must be real numbers of shape"),
    "distance to none": (
        lambda: so3.distance(np.eye(3), None),
        "second = None: must be real numbers of shape",
    ),
    "geodesic in words": (
        lambda: so3.geodesic(np.eye(3), np.eye(3), "half"),
        "fraction = 'half': must be real numbers of any shape",
    ),
    "hat of two": (lambda: so3.hat([1, 2]), "vector = [1, 2]: must be real numbers of shape (..., 3)"),
    "vee of a vector": (lambda: so3.vee([1, 2, 3]), "matrix = [1, 2, 3]: must be real numbers of shape"),
    "right_jacobian of words": (lambda: so3.right_jacobian("abc"), "rotation_vector = 'abc': must be real"),
    "right_jacobian_rate of a number": (
        lambda: so3.right_jacobian_rate(np.zeros(3), 1.0),
        "rate = 1.0: must be real numbers of shape (..., 3)",
    ),
    "right_jacobian_acceleration of two": (
        lambda: so3.right_jacobian_acceleration(np.zeros(3), np.zeros(3), [1.0, 2.0]),
        "acceleration = [1.0, 2.0]: must be real numbers of shape (..., 3)",
    ),
    "hold of a scenario": (lambda: jp.hold(SCENE), "plan must be a Plan, not Scenario; jp.plan makes one"),
    "hold with no nodes": (
        lambda plan: jp.hold(plan, nodes=0),
        "nodes = 0: must be a whole number of at least 1",
    ),
    "replan of a plan": (
        lambda plan: jp.replan(plan, SCENE),
        "held must be a Held, not Plan; jp.hold makes one",
    ),
    "follow the other way": (lambda plan: jp.follow(SCENE, plan), "plan must be a Plan, not Scenario"),
    "follow with other devices": (
        lambda plan: jp.follow(plan, make_scenario(2)),
        "has the devices terminal-1, terminal-2: must have those of the plan, terminal-1, terminal-2, te",
    ),
    "with_settings in a list": (lambda: with_settings(SCENE, ["search.seed"]), "settings must be a dict"),
    "run_study of none": (
        lambda: jp.run_study(None),
        "scenarios_or_seeds must be several scenarios or seeds",
    ),
    "run_study by two planners": (
        lambda: jp.run_study([1], planner=["mha"]),
        "planner = ['mha']: must be one of",
    ),
    "run_study to nowhere": (lambda: jp.run_study([1], out=3), "out must be a path"),
    "load_study of none": (lambda: jp.load_study(None), "folder must be a path"),
    "compare_studies of folders": (lambda: jp.compare_studies("a", "b"), "first must be a Study, not str"),
    "tune of none": (
        lambda: jp.tune(None, "effort", over=["x"]),
        "scenarios must be several scenarios, or one",
    ),
    "tune by a name": (
        lambda: jp.tune(SCENE, "effort", over=["trajectory.rate_weight"], optimizer="adam"),
        "optimizer must be a GradientTransformation, not str; such as optax.adam(0.1)",
    ),
    "walker of a word": (lambda: jp.walker("x", 550.0), "notation = 'x': must be \"i:T/P/F\""),
    "walker at no height": (lambda: jp.walker("30:36/6/3", np.nan), "altitude = nan: must be a number of km"),
    "positions in words": (lambda: SHELL.positions("now"), "time = 'now': must be a number of s"),
    "positions at NaN": (lambda: SHELL.positions(np.nan), "time = nan: must be finite"),
    "link_switch by notation": (
        lambda: jp.link_switch("30:36/6/3"),
        "shell must be a Shell, not str; jp.walker",
    ),
    "link_switch of no craft": (
        lambda: jp.link_switch(SHELL, spacecraft=3),
        "spacecraft must be a Spacecraft, not int",
    ),
    "link_switch of a lost craft": (
        lambda: jp.link_switch(SHELL, spacecraft=terminal(mount=np.nan).spacecraft),
        "spacecraft.terminals[0].mount = nan rad: must be finite and lie in",
    ),
    "link_switch of a craft in words": (
        lambda: jp.link_switch(SHELL, spacecraft=terminal(mount="aft").spacecraft),
        "spacecraft.terminals[0].mount = 'aft': must be a number",
    ),
    "link_switch to the sun": (lambda: jp.link_switch(SHELL, sun_direction="sun"), "sun_direction"),
    "plan_constellation of a shell": (
        lambda: jp.plan_constellation(SHELL),
        "switch must be a LinkSwitch, not Shell",
    ),
    "keep_out about a planet": (
        lambda: jp.sky.keep_out("mars", epoch="2026-01-01", observer=HERE, half_angle_deg=9),
        "body = 'mars': must be",
    ),
    "keep_out in words": (lambda: sun(half_angle_deg="30"), "half_angle_deg = '30': must be a number"),
    "keep_out for a while": (
        lambda: sun(for_duration_s="a while"),
        "duration = 'a while': must be a number of s",
    ),
    "keep_out some day": (lambda: sun(epoch="soon"), "epoch = 'soon': must be a time in UTC such as"),
    "keep_out of numbers": (lambda: sun(devices=3), "devices must be several names, or one, not int"),
    "keep_out from nowhere": (lambda: sun(observer=None), "position = None: must be 3 numbers of km"),
    "directions at no time": (
        lambda: jp.sky.directions("sun", epoch="2026-01-01", observer=HERE, times="now"),
        "times = 'now': must be a number",
    ),
    "path for a while": (
        lambda: jp.sky.path("sun", epoch="2026-01-01", observer=HERE, duration_s="x"),
        "duration_s = 'x': must be a number",
    ),
    "through words": (
        lambda: jp.DirectionPath.through("x", [[1, 0, 0]]),
        "times = 'x': must be an array of numbers",
    ),
    "through times that fall": (
        lambda: jp.DirectionPath.through([0, 2, 1], [[1, 0, 0]] * 3),
        "times[2] = 1.0: must rise, and be later than 2.0",
    ),
    "through a long sample": (
        lambda: jp.DirectionPath.through([0, 1], [[1, 0, 0], [2, 0, 0]]),
        "samples[1] = [2.0, 0.0, 0.0]: must be a unit vector",
    ),
    "a path in words": (lambda: ARC.at("now"), "time = 'now': must be a number of seconds"),
}


def check_refusal(call, words):
    """What is raised says the words, and comes from the package's own code."""
    with pytest.raises((TypeError, ValueError)) as caught:
        call()
    assert words in str(caught.value)
    assert Path(caught.traceback[-1].path).is_relative_to(PACKAGE)


@pytest.mark.parametrize("what", SCENARIOS)
def test_what_a_scenario_may_not_hold_is_named_with_what_it_must_be(what):
    given, words = SCENARIOS[what]
    check_refusal(lambda: jp.plan(given), words)


@pytest.mark.parametrize("what", CALLS)
def test_what_a_function_may_not_be_given_is_named_with_what_it_must_be(what, plan):
    call, words = CALLS[what]
    check_refusal((lambda: call(plan)) if signature(call).parameters else call, words)


def test_all_faults_of_type_are_told_at_once():
    given = replace(start(joints=None), keep_out=SUN, name=3)
    with pytest.raises(jp.ScenarioError) as caught:
        jp.plan(given)
    assert [fault.partition(" = ")[0] for fault in caught.value.faults] == [
        "name",
        "start.joints",
        "keep_out",
    ]


BOUND = replace(
    SCENE,
    keep_out=[replace(SUN, devices=("terminal-1", "camera-1"))],
    search=replace(SCENE.search, terminal_step_scale={"terminal-1": 2.0}),
)


@pytest.mark.parametrize(
    ("parts", "fault"),
    {
        "a torque": (
            {"torque_limit": np.nan, "inertia": np.eye(3)},
            "spacecraft.torque_limit = nan N m: must be finite and lie in [1e-12, 1e12]",
        ),
        "no terminals": (
            {"terminals": []},
            "spacecraft.terminals: must be as many as start and goal are for, 3, not 0",
        ),
        "one terminal": (
            {"terminals": SCENE.spacecraft.terminals[:1]},
            "spacecraft.terminals: must be as many as start and goal are for, 3, not 1",
        ),
        "a zone for a terminal": (
            {"terminals": [SUN]},
            "spacecraft.terminals[0] = a KeepOut ('sun'): must be a Terminal",
        ),
        "nothing for a terminal": (
            {"terminals": (*SCENE.spacecraft.terminals, None)},
            "spacecraft.terminals[3] = None: must be a Terminal",
        ),
    }.values(),
)
@pytest.mark.parametrize("goal", [BOUND.goal, jp.Targets(directions=np.eye(3))], ids=["state", "targets"])
def test_what_follows_from_a_fault_is_no_fault_of_its_own(parts, fault, goal):
    wrong = replace(BOUND, spacecraft=replace(BOUND.spacecraft, **parts), goal=goal)
    with pytest.raises(jp.ScenarioError) as caught:
        jp.plan(wrong)
    assert caught.value.faults == (fault,)


@pytest.mark.parametrize(
    ("parts", "words"),
    {
        "a lost edge": (
            {"half_angle": np.nan},
            "keep_out[0].half_angle = nan rad: must be finite and lie in",
        ),
        "degrees": ({"half_angle": 7.0}, "keep_out[0].half_angle = 7.0 rad: must lie in (0, 3.14159)"),
        "a long axis": ({"direction": [0, 0, 2]}, "keep_out[0].direction = [0.0, 0.0, 2.0]: must be a unit"),
    }.values(),
)
def test_a_certificate_names_what_is_wrong_with_a_zone(parts, words, plan):
    report = jp.certify(replace(plan, scenario=zone(**parts)))
    assert not report.certified
    (fault,) = report.faults
    assert fault.startswith(words)


def test_a_traced_number_is_told_as_such():
    with pytest.raises(jp.ScenarioError, match=r"start\.joints = a value that JAX traces: must be"):
        jax.grad(lambda joints: jp.plan(start(joints=joints)).trajectory.duration)(np.zeros(6))


class Numbers:
    """What another library's array looks like to numpy."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype)


# What stands for the same, by what it should be taken for.
SAME = {
    "an integer": (terminal(mount=0), terminal(mount=0.0)),
    "a number of numpy": (zone(half_angle=np.float32(0.25)), zone(half_angle=0.25)),
    "a number of JAX": (zone(half_angle=jax.numpy.float32(0.25)), zone(half_angle=0.25)),
    "an array of none": (terminal(rate_limit=np.array(0.25)), terminal(rate_limit=0.25)),
    "a mask that hides nothing": (start(joints=np.ma.array(SCENE.start.joints, mask=False)), SCENE),
    "a count of numpy": (search(seed=np.int64(3)), search(seed=3)),
    "a list": (zone(direction=[0, 0, 1]), zone(direction=np.array([0.0, 0.0, 1.0]))),
    "float32": (start(joints=np.full(6, 0.25, np.float32)), start(joints=np.full(6, 0.25))),
    "another library's": (start(joints=Numbers([0.25] * 6)), start(joints=np.full(6, 0.25))),
    "a list of zones": (scene(keep_out=[SUN]), scene(keep_out=(SUN,))),
    "a list of terminals": (craft(terminals=list(SCENE.spacecraft.terminals)), SCENE),
    "a list of names": (zone(devices=["camera-1"]), zone(devices=("camera-1",))),
    "a name": (zone(devices="camera-1"), zone(devices=("camera-1",))),
    "one torque": (
        craft(torque_limit=np.float32(0.5), inertia=np.eye(3)),
        craft(torque_limit=0.5, inertia=np.eye(3)),
    ),
    "a torque of each axis": (
        craft(torque_limit=[0.5] * 3, inertia=np.eye(3)),
        craft(torque_limit=np.full(3, 0.5), inertia=np.eye(3)),
    ),
    "a rate of each axis": (
        craft(rate_limit=(0.25, np.float32(0.5), 0.125)),
        craft(rate_limit=np.array([0.25, 0.5, 0.125])),
    ),
    "a word for a time": (search(time_limit="off"), search(time_limit=np.inf)),
    "an epoch as text": (scene(epoch="2026-01-01"), scene(epoch=np.datetime64("2026-01-01", "ns"))),
    "an epoch of Python": (scene(epoch=datetime(2026, 1, 1)), scene(epoch=np.datetime64("2026-01-01", "ns"))),
    "no rates": (start(angular_velocity=None, joint_rates=None), SCENE),
    "targets that move among others": (
        targets([ARC, [0, 1, 0], [0, 0, 1]]),
        scene(goal=jp.Targets(directions=(ARC, np.eye(3)[1], np.eye(3)[2]))),
    ),
}


@pytest.mark.parametrize("what", SAME)
def test_what_stands_for_the_same_is_taken_for_it(what):
    given, meant = SAME[what]
    filed = as_filed("scenario", given)
    assert given == meant
    assert filed == given
    assert hash(filed) == hash(given)
    bits, wanted = (jax.tree.leaves(one) for one in (filed, as_filed("scenario", meant)))
    for one, other in zip(bits, wanted, strict=True):
        assert np.asarray(one).dtype == np.asarray(other).dtype
        np.testing.assert_array_equal(one, other)


def test_numbers_that_differ_are_not_the_same():
    assert zone(half_angle=np.float32(0.25)) != zone(half_angle=0.26)
    assert start(joint_rates=None) != start(joint_rates=[0, 0, 0, 0, 0, 1e-3])


# The first thing that somebody reads, in the README.


deg = np.deg2rad
HAND_OVER = jp.Scenario(
    name="hand-over",
    spacecraft=jp.Spacecraft(
        terminals=[
            jp.Terminal(
                name=f"laser-{i}",
                mount=deg(120 * i),
                yaw_limit=deg(90),
                pitch_limit=deg(60),
                rate_limit=deg(5),
                acceleration_limit=deg(2),
            )
            for i in range(3)
        ],
        instruments=[jp.Instrument(name="star tracker", boresight=[0, 0, -1])],
        rate_limit=deg(3),
        acceleration_limit=deg(2),
    ),
    start=jp.GivenState(rotation_vector=[0, 0, 0], joints=np.zeros(6)),
    goal=jp.Targets(  # tilted, or any axis across z would be as good
        directions=[[1, 0, 0], [0, np.sin(deg(5)), np.cos(deg(5))], [0, -np.sin(deg(5)), -np.cos(deg(5))]]
    ),
    keep_out=[jp.KeepOut(name="sun", direction=[0, 0.6, -0.8], half_angle=deg(30), devices=["star tracker"])],
)


@pytest.fixture(scope="module")
def handed_over():
    return jp.plan(HAND_OVER, progress=False)


def depth(plan):
    """How deep the star tracker looks into the Sun's cone, deg."""
    attitude = plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 500)).attitude
    return 30 - np.rad2deg(np.arccos(attitude @ [0, 0, -1] @ [0, 0.6, -0.8]).min())


def test_a_scenario_of_plain_lists_is_planned_around_its_zone(handed_over):
    assert handed_over.ok
    assert handed_over.certificate.certified
    assert depth(handed_over) < 0
    assert depth(jp.plan(replace(HAND_OVER, keep_out=()), progress=False)) > 10


def test_what_a_plan_holds_has_the_types_that_the_model_documents(handed_over):
    held = handed_over.scenario
    craft = held.spacecraft
    for several in (
        craft.terminals,
        craft.instruments,
        held.keep_out,
        held.keep_in,
        held.keep_out[0].devices,
    ):
        assert type(several) is tuple
    vectors = [craft.instruments[0].boresight, held.keep_out[0].direction, held.goal.directions]
    for state in (held.start, held.goal):
        np.testing.assert_array_equal(state.angular_velocity, np.zeros(3))
        np.testing.assert_array_equal(state.joint_rates, np.zeros(6))
        vectors += [state.angular_velocity, state.joint_rates]
    assert {(type(vector), vector.dtype) for vector in vectors} == {(np.ndarray, np.dtype(float))}
    assert {type(getattr(craft.terminals[0], name)) for name in ("mount", "yaw_limit")} == {float}
    assert held == HAND_OVER


def test_a_scenario_of_plain_lists_is_saved_and_followed(handed_over, tmp_path):
    jp.save_scenario(HAND_OVER, tmp_path / "hand-over.toml")
    assert jp.load_scenario(tmp_path / "hand-over.toml") == HAND_OVER
    handed_over.save(tmp_path / "plan.json")
    assert jp.load_plan(tmp_path / "plan.json").scenario == HAND_OVER
    nearer = replace(HAND_OVER, keep_out=[replace(HAND_OVER.keep_out[0], half_angle=deg(29.9))])
    assert jp.follow(handed_over, nearer).ok


def test_a_scenario_of_plain_lists_is_replanned(handed_over):
    held = jp.hold(handed_over)
    with jax.enable_x64(True):
        again = jax.eval_shape(lambda: jp.replan(held, HAND_OVER))
    assert again.coefficients.shape == handed_over.trajectory.coefficients.shape


@pytest.mark.parametrize("directions", [[], np.zeros((0, 3))], ids=["list", "array"])
def test_targets_of_no_terminals_are_planned_beside_others(directions):
    craft = jp.Spacecraft(
        instruments=[jp.Instrument(name="camera", boresight=[0, 0, 1])],
        rate_limit=0.05,
        acceleration_limit=0.02,
    )
    scenario = jp.Scenario(
        name="alone", spacecraft=craft, goal=jp.Targets(directions=directions),
        start=jp.GivenState(rotation_vector=[0.1, 0.2, 0.3], joints=[]),
    )  # fmt: skip
    none, other = jp.plan_batch([scenario, jp.paper_case(2)], progress=False)
    assert none.ok
    assert none.goal.slew_angle == pytest.approx(0, abs=1e-9)
    assert other.ok


def test_rotation_vectors_that_would_be_of_degrees_are_refused():
    turned = replace(SCENE.start, rotation_vector=np.array([0.0, 90.0, 0.0]))
    with pytest.raises(
        jp.ScenarioError, match=r"start\.rotation_vector .*is 90 rad long, must be at most a turn"
    ):
        jp.plan(replace(SCENE, start=turned), progress=False)
