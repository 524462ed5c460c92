"""How results show themselves: short, escaped, the same in every state that an object can be in."""

import importlib
import inspect
import re
import typing
import warnings
from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from pkgutil import iter_modules
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from builders import make_observer, make_scenario, scene_of
from fake_study import plan_nothing, task

import jaxplan as jp
from jaxplan import sky
from jaxplan.cases import case_path
from jaxplan.certificate import Claim, EndState, ProvedMargin
from jaxplan.constellation import Constellation
from jaxplan.constellation.shell import Shell
from jaxplan.goal import Decomposition
from jaxplan.model.constraints import Constraints
from jaxplan.model.devices import Instrument
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import Targets, Wish
from jaxplan.model.hidden_spans import Hidden
from jaxplan.model.scenario import SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut, Mask
from jaxplan.paper import derivative as paper
from jaxplan.planner.steps import fit
from jaxplan.runtime.display import UNKNOWN, as_table, shown
from jaxplan.schema.states import LocalState, Pointing
from jaxplan.search import Barrier, JointBarrier
from jaxplan.sky import spk
from jaxplan.study.printed_planners import PAPER_KINDS, Row, printed_rows
from jaxplan.study.run import run_task
from jaxplan.trajectory import FitQuery
from jaxplan.trajectory import derivative as global_spline
from jaxplan.tuning import SearchTuning, Sensitivities, Sensitivity, Tuning
from jaxplan.tuning.tuned import State

LINE, PAGE = 240, 6000
NAUGHTY = "<script>alert('&')</script> \"\u202e\ud800\x1b[31m\n" + 5000 * "<&"
ODD = [None, np.nan, np.inf, -0.0, True, 10**400, 1j, "", NAUGHTY, b"\xff", (), {}, set(), [[]], object()]
ODD += [np.zeros(0), np.array(NAUGHTY), np.full((3, 3), np.nan), np.arange(1e5), np.array([None]), object]
ODD += [np.datetime64("NaT"), jax.ShapeDtypeStruct((3,), float), (None, "a", 1), {NAUGHTY: NAUGHTY}]
ODD += [(NAUGHTY,) * 30, [np.zeros(3)] * 30, range(10**6), jax.random.key(0), Path(NAUGHTY)]
TLE = (
    "ISS (ZARYA)\n"
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n"
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n"
)


class WellFormed(HTMLParser):
    """Reads a page and raises unless every tag is closed in its turn."""

    def __init__(self, page):
        super().__init__()
        self.open, self.tags, self.text = [], set(), ""
        self.feed(page)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.tags.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def look(thing):
    """The line and the text of the page of an object, whose form is checked."""
    line, page = repr(thing), thing._repr_html_()
    assert isinstance(str(thing), str)
    assert len(line) <= LINE, line
    assert line.isprintable()
    assert line.startswith("<")
    assert line.endswith(">")
    assert len(page) < PAGE
    page.encode()
    read = WellFormed(page)
    assert read.tags <= {"table", "caption", "tr", "th", "td"}
    return line, read.text


def public():
    """What the packages name, and of modules without a list of names what they define."""
    modules = [
        found.name for found in iter_modules(jp.__path__, "jaxplan.") if found.name != "jaxplan.__main__"
    ]
    for module in [jp, *map(importlib.import_module, modules)]:
        if hasattr(module, "__all__"):
            yield from (getattr(module, name) for name in module.__all__)
        else:
            own = (thing for name, thing in vars(module).items() if not name.startswith("_"))
            yield from (thing for thing in own if getattr(thing, "__module__", None) == module.__name__)


def types_in(annotation):
    if isinstance(annotation, type):
        yield annotation
    for part in typing.get_args(annotation):
        for one in part if isinstance(part, list) else [part]:
            yield from types_in(one)


def annotated(thing):
    """The types that the annotations of a class or function name."""
    later = {
        cls.__name__: cls
        for cls in (
            *(jp.Plan, jp.Study, jp.Trajectory, Constraints, Decomposition, Spacecraft),
            *(Constellation, SearchTuning, Tuning, Row),  # of which figures are drawn
        )
    }
    later["pd"] = SimpleNamespace(DataFrame=object)  # which modules import for their annotations alone
    for annotation in typing.get_type_hints(thing, localns=later).values():
        yield from types_in(annotation)


def public_dataclasses():
    """The dataclasses among what is public, and those that these and public functions take, hold or give."""
    kept = [State, global_spline.ActiveSet, paper.PaperActiveSet]  # in fields that take anything
    found, waiting, seen = set(), [*public(), *kept], set()
    while waiting:
        thing = waiting.pop()
        ours = getattr(thing, "__module__", None) or ""
        if not ours.startswith("jaxplan") or id(thing) in seen:
            continue
        seen.add(id(thing))
        if is_dataclass(thing) and isinstance(thing, type):
            found.add(thing)
            waiting += [*annotated(thing), *thing.__subclasses__()]
        elif inspect.isfunction(thing):
            waiting += annotated(thing)
        if isinstance(thing, type):
            for name, member in vars(thing).items():
                member = getattr(member, "fget", None) or getattr(member, "func", None) or member
                member = getattr(member, "__func__", member)
                if not name.startswith("_") and inspect.isfunction(member):
                    waiting += annotated(member)
    return sorted(found, key=lambda cls: (cls.__module__, cls.__name__))


CLASSES = public_dataclasses()


def make(cls, *, without=(), **values):
    """An instance by hand, whatever its type says, perhaps without some of its fields."""
    thing = object.__new__(cls)
    for field in fields(cls):
        if field.name not in without:
            object.__setattr__(thing, field.name, values.get(field.name))
    return thing


def rows_of(thing):
    return dict(re.findall(r"<tr><th[^>]*>([^<]*)</th><td[^>]*>([^<]*)</td></tr>", thing._repr_html_()))


@pytest.fixture(scope="module")
def scenario():
    case = jp.paper_case(2)
    sun = KeepIn(name="link", direction=np.array([0.0, 0.6, 0.8]), half_angle=3.0, devices=("terminal-1",))
    craft = replace(
        case.spacecraft, instruments=(Instrument(name="tracker", boresight=np.array([0.0, 0.0, 1.0])),)
    )
    return replace(case, spacecraft=craft, keep_in=(sun,))


@pytest.fixture(scope="module")
def plan():
    return jp.plan(jp.paper_case(2), progress=False)


@pytest.fixture(scope="module")
def failed():
    case = jp.paper_case(2)
    zone = KeepOut(name="<wall>", direction=case.goal.directions[0], half_angle=0.3)
    return jp.plan(replace(case, keep_out=(zone,)), throw=False, progress=False)


@pytest.fixture(scope="module")
def results(plan, failed, scenario):
    """One of every kind that somebody gets, most of them from where one gets them."""
    study = run_task(task(36), None, None, None, False, plan_nothing)
    switch = jp.link_switch(jp.walker("30:36/6/3", 2000.0), sun_direction=np.array([0.0, 0.6, 0.8]))
    constellation = Constellation(switch=switch, satellites=range(36), study=study)
    around = 7e3 * np.stack([np.cos(angles := np.linspace(0, 1, 9)), np.sin(angles), 0 * angles], axis=-1)
    ephemeris = sky.Ephemeris.through(1e3 * angles, around)
    scene = scene_of(make_scenario(2, 1, keep_out=scenario.keep_out))
    turn = 0.1 * np.arange(9)
    turning = DirectionPath.through(10 * turn, np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1))
    state = EndState(attitude=plan.goal.attitude, joints=plan.goal.joints)
    craft, path, trajectory = plan.scenario.spacecraft, plan.path, plan.trajectory
    history = ({"step": 0, "objective": 2.0, "search.seed": 1.0}, {"step": 1, "objective": 1.0})
    still = {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(6)}
    rates = {"trial": 0, "objective": 1.0, "success_rate": 0.5, "search.heuristic_weight": np.nan}
    moving = KeepOut(name="Moon", direction=turning, half_angle=0.2)
    observer = make_observer()
    panel = FixedVector(along=np.eye(3)[0], to="terminal-1")
    corner = JointBound(name="corner", device="terminal-1", normal=np.array([0.6, 0.8]), least=-1.0)
    day = jp.load_sky(case_path("case-imaging"))
    table = jp.AttitudeTable(times=np.arange(2.0), quaternions=np.tile(np.eye(4)[0], (2, 1)))
    return [
        *(table, jp.certify_table(table, None, scenario)),
        *(day, *day.passes("oslo", duration_s=3600.0)),
        LocalState(rotation_vector=np.zeros(3), joints=np.zeros(0)),
        *(scenario, plan.scenario, scenario.start, scenario.goal, scenario.search, scenario.trajectory),
        jp.Robust(attitude_error=0.01, torque_reserve=10.0),
        *(scenario.spacecraft, *craft.terminals, *scenario.spacecraft.instruments, *scenario.keep_out),
        *(
            *scenario.keep_in,
            moving,
            panel,
            corner,
            Mask(name="mask 1", device="terminal-1", corners=np.eye(3)[:, :2], turns=(0,)),
            turning,
            Targets(directions=(np.eye(3)[0], turning)),
            *(observer.terminals[0].mounting, observer.drives[0], observer.gimbals),
            Wish(device="array", direction=np.eye(3)[0]),
            jp.Wheel(name="wheel-1", axis=np.eye(3)[0], torque=0.2, momentum=8.0, stored=0.5),
        ),
        *(
            plan,
            plan.goal,
            plan.search,
            path,
            trajectory,
            plan.certificate,
            failed,
            trajectory.platform_pieces,
        ),
        *(replace(plan.goal, time=40.0, **still), trajectory.sample(1.0)),
        *(trajectory.sample(np.linspace(0, trajectory.duration, 1000)), jp.hold(plan)),
        *(fit(plan.scenario, path, plan.goal), scene, scene.cones, Barrier(device=1, zones=(0, 2))),
        JointBarrier(device=0, zones=(1,)),
        Pointing(directions=np.eye(3)),
        FitQuery(path=path, spacecraft=craft, settings=plan.scenario.trajectory),
        *(state, ProvedMargin(zones=("a", "b"), bound=0.1, time=2.0, zone="a", device="terminal-1")),
        Claim(
            trajectory=trajectory,
            spacecraft=craft,
            cones=scene.cones,
            zone_names=["a", "b"],
            start=state,
            goal=state,
        ),
        Decomposition(
            goals=(plan.goal,),
            slew_angle=0.5,
            aim_excess=-0.1,
            worst_aim=(1, 0),
            zone_excess=-np.inf,
            worst_zone=None,
            worst_device=None,
        ),
        *(study, study.summary(), jp.compare_studies(study, study), switch, switch.shell),
        *(constellation, constellation.summary(), next(iter(printed_rows(PAPER_KINDS))), sky.parse_tle(TLE)),
        sky.CircularOrbit(altitude=500.0, inclination=0.9, node=0.2, latitude=1.0),
        sky.SpkBody(name="MARS", number=499, files=("de440s.bsp",), segments=()),
        spk.Segment(file=0, body=499, center=4, frame=1, first=0.0, last=1.0, summary=np.zeros(5)),
        *(ephemeris, ephemeris.pieces[0], sky.occulter("moon"), sky.GroundPoint(latitude=0.7, longitude=0.1)),
        sky.KeplerOrbit(
            semi_major_axis=7e3, eccentricity=0.01, inclination=0.9, node=0.2, perigee=0.1, anomaly=1.0
        ),
        Hidden(target="lisbon", by="its horizon", start=0.0, end=80.0),
        Sensitivity(name="a", value=1.0, unit="deg", slope=0.5),
        Sensitivities(
            measure="effort",
            value=1.0,
            unit="s",
            rows=(Sensitivity(name="a", value=1.0, unit="deg", slope=0.5),),
            without_effect=("b",),
        ),
        Tuning(
            scenarios=(plan.scenario,),
            plans=(plan,),
            numbers={"search.seed": 2.0},
            objective=1.0,
            history=history,
            message="gave up",
            state=State(
                asked={"objective": {"effort": 1.0}},
                free=jax.numpy.zeros(2),
                memory=None,
            ),
        ),
        SearchTuning(
            settings={"search.heuristic_weight": 2.0},
            objective="time (s)",
            own=rates,
            best={**rates, "trial": 3},
            history=(rates,) * 4,
            study=study,
            baseline=study,
            message="found by trials",
        ),
    ]


def test_what_is_public_is_found():
    names = {cls.__name__ for cls in CLASSES}
    assert {"Scenario", "Goal", "Certificate", "Samples", "Decomposition", "Tle", "Shell", "Held"} <= names
    assert len(CLASSES) > 40


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_every_public_dataclass_shows_itself_whatever_it_holds(cls):
    names = [field.name for field in fields(cls)]
    for value in ODD:
        look(make(cls, **dict.fromkeys(names, value)))
        look(make(cls, **dict.fromkeys(names, make(cls, **dict.fromkeys(names, value)))))
    for name in names:
        look(make(cls, without=[name]))
    look(object.__new__(cls))


def test_what_is_half_made_is_printed_as_its_line(plan):
    for cls in (jp.Plan, type(plan.certificate), Tuning, SearchTuning, jp.Study, Constellation):
        thing = make(cls, without=[fields(cls)[0].name])
        assert str(thing) == repr(thing)
    assert str(replace(plan.certificate, min_margin="wide")).startswith(
        "<Certificate: certified yes; min margin wide;"
    )
    assert "certified                  yes" in str(plan.certificate)


def test_an_object_is_shown_without_a_warning():
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        for value in ODD:
            look(make(Shell, **dict.fromkeys((field.name for field in fields(Shell)), value)))
    assert not heard


def test_a_film_says_of_what_it_is(plan):
    film = jp.plot.animate(plan, frames=3)
    assert repr(film) == f"<Film of case 2: pictures 3; duration {plan.trajectory.duration:.6g} s>"
    assert repr(object.__new__(type(film))) == "<Film: pictures ?; duration ?>"


def test_every_result_shows_itself_and_leaves_nothing_unknown(results):
    for thing in results:
        line, page = look(thing)
        assert UNKNOWN not in line, line
        assert UNKNOWN not in page, page
        assert len(page) > 10
        if "__str__" not in vars(type(thing)):
            assert str(thing) == line


def test_the_results_looked_at_are_of_every_kind(results):
    inner = {
        "Call",
        "Choice",
        "SlewTime",
        "Layout",
        "Leads",
        "MadeWay",
        "Held",
        "ActiveSet",
        "PaperActiveSet",
        "ActiveChain",
        "BindingLinear",
        "BindingLoads",
        "Sights",
        "Stages",
        "State",
        "Stop",
        "BindingMargins",
    }
    # whose results take a day, a fleet or a matrix to make: their own tests look at them
    inner |= {
        "Activity",
        "DayPlan",
        "ExportNames",
        "Fleet",
        "LinkSchedule",
        "Interruption",
        "PlannedActivity",
        "Segment",
        "SlewProblem",
        "SlewTimes",
        "Span",
        "Timeline",
        "TimelinePlan",
    }
    assert {cls.__name__ for cls in set(CLASSES) - {type(thing) for thing in results}} <= inner


def test_lines_say_what_a_thing_is(plan, scenario):
    observed = replace(scenario, spacecraft=make_observer())
    assert repr(observed).startswith(
        "<Scenario case 2: terminals 1: antenna; drives 1: array; instruments 3: "
    )
    assert repr(scenario.keep_in[0]) == (
        "<KeepIn link: half angle 171.887 deg; direction [0 0.6 0.8]; devices terminal-1>"
    )
    assert repr(scenario.spacecraft).startswith(
        "<Spacecraft: terminals 3: terminal-1, terminal-2, terminal-3; instruments 1: tracker; rate limit 3 "
    )
    assert repr(plan.path).startswith(f"<Path: edges {plan.path.edges}; length {plan.path.length:.6g} steps;")
    assert f"duration {plan.trajectory.duration:.6g} s" in repr(plan.trajectory)
    assert repr(plan).startswith("<Plan of case 2: status OK; slew angle 55.7")
    assert repr(plan.certificate).startswith("<Certificate: certified yes; min margin ")


def test_settings_tell_first_what_somebody_chose():
    assert repr(SearchSettings()) == "<SearchSettings: all by default>"
    chosen = SearchSettings(seed=7, clearance=np.deg2rad(1.0))
    assert repr(chosen) == "<SearchSettings: clearance 1 deg; seed 7>"
    rows = rows_of(chosen)
    assert list(rows)[:2] == ["clearance (deg)", "seed"]
    assert list(rows.values())[2:] == [text for text in rows.values() if text.endswith("(default)")]
    assert len(rows) == len(fields(SearchSettings)) - 1  # no terminal has a scale of its own
    assert rows_of(TrajectorySettings(duration=40.0))["duration (s)"] == "40"


def test_angles_are_in_degrees_and_say_so(scenario):
    rows = rows_of(scenario.spacecraft.terminals[1])
    assert rows["mount (deg)"] == "120"
    assert rows["rate limit (deg/s)"] == "4"
    assert (
        rows_of(scenario.keep_out[0])["half angle (deg)"]
        == f"{np.rad2deg(scenario.keep_out[0].half_angle):.6g}"
    )


def test_a_failed_plan_says_what_went_wrong(failed):
    assert not failed.ok
    line, page = look(failed)
    assert failed.status.name in line
    assert failed.message in page
    assert "&lt;wall&gt;" in failed._repr_html_() or "wall" not in failed.message


def test_lines_and_pages_of_what_is_traced_ask_for_no_value(results, scenario):
    def told(thing):
        lines.append(look(thing)[0])
        return 0

    lines = []
    for thing in results:
        if not jax.tree_util.all_leaves([thing]):
            jax.eval_shape(told, thing)
            jax.eval_shape(jax.vmap(told), jax.tree.map(lambda leaf: np.stack([leaf] * 2), thing))
    assert len(lines) > 30
    assert jax.jit(lambda s: (repr(s), s._repr_html_(), s.spacecraft.rate_limit)[2])(
        scenario
    ) == pytest.approx(scenario.spacecraft.rate_limit)
    craft = scenario.spacecraft
    slope = jax.grad(lambda c: (lines.append(repr(c)), c.rate_limit**2)[1])(craft)
    assert slope.rate_limit == pytest.approx(2 * craft.rate_limit)
    assert "rate limit traced float" in lines[-1]
    traced = jax.make_jaxpr(lambda s: (repr(s), s._repr_html_(), s.spacecraft.rate_limit)[2])(scenario)
    assert not traced.eqns


def test_names_are_text_and_on_one_line():
    zone = KeepOut(name=NAUGHTY, direction=np.eye(3)[0], half_angle=0.1, devices=(NAUGHTY, "a & b"))
    line, page = look(zone)
    assert "<script>alert('&')</script>" in page
    assert "\n" not in line
    assert rows_of(replace(zone, devices=("a & b",)))["devices"] == "a &amp; b"


def test_what_cannot_be_told_is_a_question_mark():
    @shown("half", "whole deg", "part.name")
    @dataclass(frozen=True)
    class Broken:
        whole: float
        part: object = None

        @property
        def half(self):
            raise RuntimeError

    assert repr(Broken(whole=np.pi)) == "<Broken: half ?; whole 180 deg>"
    assert repr(Broken(whole=np.pi, part=Broken)) == "<Broken: half ?; whole 180 deg; name ?>"


def test_a_table_that_is_cut_says_how_much_is_missing():
    page = as_table("long", [("row", "x" * 100)] * 500, [["", "a", "b"], ["c", "1", "2"]])
    told = WellFormed(page).text
    kept = page.count("<tr>") - 1
    assert 10 < kept < 500
    assert told.endswith(f"and {502 - kept} more rows")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.array([0.5, -0.0, 1e-7]), "[0.5 0 1e-07]"),
        (np.eye(2), "[1 0; 0 1]"),
        (np.zeros(0), "[]"),
        (np.zeros((0, 3)), "0 x 3"),
        (np.arange(20.0), "20, 0 to 19"),
        (np.array([np.nan] * 15), "15, 15 not finite"),
        (np.ones((4, 5), bool), "4 x 5, 20 true"),
        ((3, 4), "[3 4]"),
        (range(30), "30"),
        ((np.eye(3), None), "1 ndarray, 1 NoneType"),
        ({"a": 1.5, "b": True}, "a 1.5, b yes"),
        (np.datetime64("2026-01-01T00:00"), "2026-01-01T00:00"),
        (jp.Status.NO_PATH, "NO_PATH"),
        (np.float32(0.5), "0.5"),
    ],
)
def test_values_are_written_for_people(value, text):
    @shown()
    @dataclass(frozen=True, eq=False)
    class Holder:
        value: object

    assert repr(Holder(value)) == f"<Holder: value {text}>"
