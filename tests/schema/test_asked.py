"""What Python asks for is checked as a file is, before anything is planned."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import Targets
from jaxplan.model.zones import KeepOut
from jaxplan.schema import ScenarioError

SCENE = make_scenario(2)
SUN = KeepOut(name="Sun", direction=np.array([0.0, 0.0, 1.0]), half_angle=0.1, devices=("terminal-1",))


def with_parts(**parts):
    """The scene with some numbers of its tables changed."""
    return replace(SCENE, **{name: replace(getattr(SCENE, name), **own) for name, own in parts.items()})


def renamed(*names):
    terminals = tuple(
        replace(terminal, name=name) for terminal, name in zip(SCENE.spacecraft.terminals, names, strict=True)
    )
    return with_parts(spacecraft={"terminals": terminals})


BAD = {
    "unknown device": (replace(SCENE, keep_out=(replace(SUN, devices=("nope",)),)), "nope"),
    "no duration": (with_parts(trajectory={"duration": 0.0}), r"trajectory\.duration = 0"),
    "too many joints": (
        with_parts(start={"joints": np.zeros(6)}),
        r"start\.joints = .*: must be an array of 4 numbers, one a joint",
    ),
    "too few joints": (
        with_parts(goal={"joints": np.zeros(2)}),
        r"goal\.joints = \[0\.0, 0\.0\]: must be an array of 4 numbers",
    ),
    "too few targets": (
        replace(SCENE, goal=Targets(directions=np.eye(3)[:1])),
        r"goal\.directions = .*: must be an array of 2 directions",
    ),
    "devices of one name": (
        renamed("a", "a"),
        r"terminals\[1\]\.name.*the same as spacecraft\.terminals\[0\]",
    ),
    "zones of one name": (replace(SCENE, keep_out=(SUN, SUN)), r"keep_out\[1\]\.name"),
    "a name of two lines": (replace(SCENE, name="a\nb"), "name.*a line of text"),
    "an epoch before leap seconds": (
        replace(SCENE, epoch=np.datetime64("1960-01-01", "ns")),
        "epoch.*1972",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_no_file_may_hold_is_refused_by_its_key_and_number(what):
    bad, said = BAD[what]
    with pytest.raises(ScenarioError, match=said) as caught:
        jp.plan_batch([SCENE, bad])
    assert str(caught.value).startswith("scenarios[1]")
    with pytest.raises(ScenarioError, match=said):
        jp.plan(bad)


def test_lists_are_taken_for_arrays():
    given = with_parts(start={"joints": list(map(float, SCENE.start.joints)), "joint_rates": [0.0] * 4})
    first, second = jp.plan(given), jp.plan(SCENE)
    np.testing.assert_array_equal(first.trajectory.coefficients, second.trajectory.coefficients)


def test_targets_of_which_none_moves_are_still(tmp_path):
    plan = jp.plan(SCENE)
    seen = plan.scenario.spacecraft.boresights(plan.goal.attitude, plan.goal.joints)
    moving = jp.plan(replace(SCENE, goal=jp.Targets(directions=tuple(np.asarray(seen)))))
    moving.save(tmp_path / "plan.json")
    assert jp.load_plan(tmp_path / "plan.json").ok


def test_directions_that_are_rounded_are_kept_as_a_file_holds_them(tmp_path):
    times = np.linspace(0, 120, 5)
    angles = 0.2 + 8e-3 * times
    rounded = np.round(np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), 6)
    path = DirectionPath.through(times, rounded)
    np.testing.assert_allclose(np.linalg.norm(path.samples, axis=1), 1, rtol=0, atol=1e-15)
    still = np.array([0.0, 1.0, 0.0])
    settings = replace(SCENE.trajectory, duration=60.0)
    scenario = replace(SCENE, goal=jp.Targets(directions=(path, still)), trajectory=settings)
    plan = jp.plan(scenario, throw=False)
    plan.save(tmp_path / "plan.json")
    assert jp.load_plan(tmp_path / "plan.json").scenario == plan.scenario


def test_a_plan_that_fails_may_come_back_from_another_process():
    with pytest.raises(jp.PlanningError) as caught:
        jp.plan(with_parts(start={"joints": np.full(4, 3.0)}))
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value)
    assert copy.status is caught.value.status
