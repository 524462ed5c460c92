import json
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from builders import make_scenario
from tables import ABSENT, put

import jaxplan as jp
from jaxplan.planner.proving import certify


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return jp.plan(jp.paper_case(1))


def assert_same(first: object, second: object, where: str = "plan") -> None:
    """Equal to the last bit, dataclasses and arrays included."""
    if is_dataclass(first):
        assert type(first) is type(second), where
        for entry in fields(first):
            assert_same(getattr(first, entry.name), getattr(second, entry.name), f"{where}.{entry.name}")
    elif isinstance(first, np.ndarray):
        assert first.shape == second.shape, where
        np.testing.assert_array_equal(first, second, err_msg=where)
    elif isinstance(first, tuple):
        assert len(first) == len(second), where
        for k, (one, other) in enumerate(zip(first, second, strict=True)):
            assert_same(one, other, f"{where}[{k}]")
    else:
        assert first == second, where


def test_a_plan_that_is_loaded_again_is_the_same_to_the_last_bit(plan, tmp_path):
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    assert_same(plan, again)
    assert certify(again).min_margin == plan.certificate.min_margin


def test_plan_files_are_the_same_byte_for_byte_and_times_are_apart(plan, tmp_path):
    plan.save(tmp_path / "first.json")
    jp.plan(jp.paper_case(1)).save(tmp_path / "second.json")
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "second.json").read_bytes()
    times = json.loads((tmp_path / "first.timings.json").read_text())
    assert set(times) == set(plan.timings)
    (tmp_path / "first.timings.json").unlink()
    assert jp.load_plan(tmp_path / "first.json").timings == {}


@pytest.mark.parametrize("terminals", [0, 1])
def test_plans_with_few_devices_and_failed_plans_can_be_kept(terminals, tmp_path):
    scenario = make_scenario(terminals, 1)
    for name, kept in {
        "ok": jp.plan(scenario),
        "failed": jp.plan(_invalid(scenario), throw=False),
    }.items():
        kept.save(tmp_path / f"{name}.json")
        assert_same(kept, jp.load_plan(tmp_path / f"{name}.json"))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "duration"), [("paper", 60.0), ("global", 60.0), ("global", "minimum")])
def test_plans_that_come_back_to_where_they_start_at_speed_can_be_kept(method, duration, tmp_path):
    scenario = make_scenario(1)
    start = replace(scenario.start, angular_velocity=np.array([0.004, -0.003, 0.002]))
    settings = replace(scenario.trajectory, method=method, duration=duration)
    kept = jp.plan(replace(scenario, start=start, goal=scenario.start, trajectory=settings))
    assert kept.trajectory.duration > 0
    kept.save(tmp_path / "plan.json")
    assert_same(kept, jp.load_plan(tmp_path / "plan.json"))


def _invalid(scenario: jp.Scenario) -> jp.Scenario:
    fast = replace(scenario.start, angular_velocity=np.array([1.0, 0.0, 0.0]))
    return replace(scenario, start=fast, trajectory=replace(scenario.trajectory, duration=80.0))


def test_an_old_file_is_replaced_in_one_step(plan, tmp_path):
    target = tmp_path / "plan.json"
    target.write_text("old")
    plan.save(target)
    assert jp.load_plan(target).ok
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.json", "plan.timings.json"]


# What stands at a place of the file of case 1, and the complaint about it. With "" a place stands here twice.
WRONG_VALUES = {
    ("search", "status"): ([], 'must be "OK"'),
    ("search", "expansions"): (-3, "must be at least 0"),
    ("search", "queue_expansions", 0): (0.5, "must be an integer"),
    ("search", "path"): (None, 'must be a table, since search.status = "OK"'),
    ("message",): ([], "must be a line of text"),
    ("goal", "slew_angle"): (-1, "must lie in [0, 3.1416]"),
    ("goal",): (None, 'must be a table, since status = "OK"'),
    ("report",): (None, 'must be a table, since status = "OK"'),
    ("path", "attitudes", 0, 0, 0): (1e300, "must lie in"),
    ("path", "attitudes", 2): ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], "must be a rotation matrix"),
    ("search", "status", ""): ("NO_PATH", 'must be "OK", since status = "OK"'),
    ("path", "attitudes", 0): ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], "must be that of the start"),
    ("path", "joints", 14): ([0.0] * 6, "must be that of the goal"),
    ("trajectory", "method"): ({}, 'must be "global" or "paper"'),
    ("trajectory", "method", ""): ("global", 'must be "paper", as scenario.trajectory.method is'),
    ("trajectory", "smoothness"): (9, "must lie in [0, 4]"),
    ("trajectory", "node_times", 0): (0.5, "must be 0"),
    ("trajectory", "node_times", 14, ""): (79.0, "must be the end of the trajectory, 80 s"),
    ("trajectory", "breaks"): ([0.0], "must be an array of 2 numbers, not of 1"),
    ("trajectory", "breaks", 1): (90.0, ""),
    ("trajectory", "node_times"): ([], "must be an array of 15 numbers, not of 0"),
    ("trajectory", "node_times", 3): (1e300, "must lie in"),
    ("trajectory", "node_times", 14): (80.001, "must lie within the trajectory, which ends at 80 s"),
    ("trajectory", "chart_rate", 0, 1): ("1", "must be a number"),
    ("report", "certified"): (1, "must be true or false"),
    ("report", "min_margin"): ("x", "must be a number"),
    ("report", "worst_time"): (1e300, "must lie within the trajectory"),
    ("report", "worst_device"): ("nobody", "the devices are terminal-1, terminal-2, terminal-3"),
    ("report", "worst_zone"): (None, "must not be null"),
    ("report", "peaks"): ("x", "must be a table of numbers"),
    ("report", "peaks", "yaw"): (-0.1, "must be at least 0"),
    ("report", "peak_times", "yaw"): (81, "must lie within the trajectory"),
    ("report", "jumps", "joints"): (None, "must be a number"),
    ("report", "faults"): ([1], "must be a line of text"),
    ("comment",): ("mine", "unknown key"),
    ("scenario",): (ABSENT, "must be a table"),
    ("goal", "attitude"): ([[1.0, 0.0], [0.0, 1.0]], "must be "),
    ("goal", "joints"): ("many", "must be an array of 6 numbers"),
    ("trajectory", "coefficients"): ([], "must be "),
    ("trajectory", "breaks", 0): ([1], "must be a number"),
    ("report", "certified_by"): ("me", "unknown key"),
}


def spelled(keys: tuple[object, ...]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")


def refusal_of(content: dict[str, object], path) -> str:
    path.write_text(json.dumps(content))
    with pytest.raises(jp.PlanFileError) as caught:
        jp.load_plan(path)
    return str(caught.value)


def written(plan: jp.Plan, path) -> dict[str, object]:
    plan.save(path)
    return json.loads(path.read_text())


def test_a_wrong_value_is_refused_with_its_file_key_and_range(plan, tmp_path):
    content = written(plan, tmp_path / "plan.json")
    for place, (value, complaint) in WRONG_VALUES.items():
        keys = tuple(key for key in place if key != "")
        message = refusal_of(put(content, keys, value), tmp_path / "bad.json")
        assert str(tmp_path / "bad.json") in message
        assert spelled(keys).partition("[")[0] in message
        assert complaint in message, message


@pytest.mark.parametrize("drives", [{}, [1]], ids=str)
def test_wrong_drives_of_the_scenario_are_refused(plan, tmp_path, drives):
    content = put(written(plan, tmp_path / "plan.json"), ("scenario", "spacecraft", "drive"), drives)
    assert "scenario: spacecraft.drive" in refusal_of(content, tmp_path / "bad.json")


def places(content: object, keys: tuple[object, ...] = ()):
    """Every place of a plan file, of long arrays only the first entry."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content[:1])
    for key, value in pairs:
        if key != "scenario":
            yield (*keys, key)
            if isinstance(value, dict | list):
                yield from places(value, (*keys, key))


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, True, "x", -1e300, 1e300, [], {}], ids=str)
def test_no_value_anywhere_gives_a_plan_that_cannot_be_shown(plan, tmp_path, value):
    content = written(plan, tmp_path / "plan.json")
    for keys in places(content):
        (tmp_path / "odd.json").write_text(json.dumps(put(content, keys, value)))
        try:
            odd = jp.load_plan(tmp_path / "odd.json")
        except jp.PlanFileError:
            continue
        assert str(odd)
        assert json.dumps(odd.summary())


def test_a_plan_file_that_contradicts_itself_says_how(plan, tmp_path):
    content = written(plan, tmp_path / "plan.json")
    found = refusal_of(content | {"status": "INVALID_START"}, tmp_path / "bad.json")
    assert 'goal: must be null, since status = "INVALID_START"' in found
    found = refusal_of(content | {"status": "UNCERTIFIED"}, tmp_path / "bad.json")
    assert 'report.certified = true: must be false, since status = "UNCERTIFIED"' in found
    found = refusal_of(content | {"status": "INFEASIBLE", "trajectory": None}, tmp_path / "bad.json")
    assert "trajectory = null: must be a table, since report is one" in found


def test_an_empty_table_is_told_what_it_lacks_in_the_words_of_its_file(tmp_path):
    found = refusal_of({}, tmp_path / "bad.json")
    assert "bad.json" in found
    assert "schema_version: missing, must be 1" in found
    assert "None" not in found


def test_a_damaged_timings_file_is_refused_by_name(plan, tmp_path):
    plan.save(tmp_path / "plan.json")
    for text, word in (('{"total": "long"}', "total"), ("[", "not a timings file")):
        (tmp_path / "plan.timings.json").write_text(text)
        with pytest.raises(jp.PlanFileError, match=rf"plan\.timings\.json: .*{word}"):
            jp.load_plan(tmp_path / "plan.json")


def test_a_plan_that_takes_no_time_can_be_kept(tmp_path):
    scenario = make_scenario(2)
    still = jp.plan(replace(scenario, goal=scenario.start))
    still.save(tmp_path / "plan.json")
    assert_same(still, jp.load_plan(tmp_path / "plan.json"))


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(jp.PlanFileError, match=r"nowhere\.json"):
        jp.load_plan(tmp_path / "nowhere.json")


def test_a_forged_goal_is_found_by_the_check(plan, tmp_path):
    plan.save(tmp_path / "plan.json")
    content = json.loads((tmp_path / "plan.json").read_text())
    content["scenario"]["goal"]["targets"][0] = [0.0, 0.0, 1.0]
    (tmp_path / "forged.json").write_text(json.dumps(content))
    report = certify(jp.load_plan(tmp_path / "forged.json"))
    assert not report.certified
    assert any("goal" in fault for fault in report.faults)


def test_files_of_timings_are_told_apart(plan, tmp_path):
    other = replace(plan, timings={**plan.timings, "total": 99.0})
    plan.save(tmp_path / "slew.v1")
    other.save(tmp_path / "slew.v2")
    assert jp.load_plan(tmp_path / "slew.v1").timings == plan.timings
    assert jp.load_plan(tmp_path / "slew.v2").timings == other.timings
    with pytest.raises(ValueError, match=r"hold the timings of plans: take another name"):
        plan.save(tmp_path / "slew.timings.json")
