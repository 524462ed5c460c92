"""Studies of scenes that are really planned."""

import json
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.runtime.workers import _openblas_libraries
from jaxplan.schema import with_settings
from jaxplan.study import rows
from jaxplan.study.rows import COLUMNS, TIMES

SEEDS = range(5)


def text(study: jp.Study) -> str:
    return json.dumps(study.table)


def in_other_company(row: dict) -> dict:
    """What a row says that was planned with other scenes: the same to 1e-6."""
    return {
        name: pytest.approx(value, rel=1e-6) if isinstance(value, float) else value
        for name, value in row.items()
    }


@pytest.fixture(scope="module")
def study() -> jp.Study:
    return jp.run_study(SEEDS, "keep_in", progress=False)


def test_a_row_says_what_the_plan_of_its_scene_says(study):
    for row, times, seed in zip(study.table, study.timings, SEEDS, strict=True):
        plan = jp.plan(jp.random_scenario(seed, "keep_in"), progress=False)
        assert tuple(row) == tuple(COLUMNS)
        assert tuple(times) == tuple(TIMES)
        assert (row["scene"], row["seed"], row["kind"], row["planner"]) == (seed, seed, "keep_in", "mha")
        assert (row["name"], row["status"], row["message"]) == (f"keep_in {seed}", "OK", "")
        assert row["certified"] is True
        assert row["expansions"] == plan.search.expansions
        assert row["interior_nodes"] == plan.path.edges - 1
        told = {
            "length_steps": plan.path.length,
            "duration_s": plan.trajectory.duration,
            "min_margin_deg": float(np.rad2deg(plan.certificate.min_margin)),
            "peak": max(plan.certificate.peaks.values()),
        }
        assert {name: row[name] for name in told} == in_other_company(told)
        assert row["duration_s"] > row["duration_bound_s"] > 0
        assert row["min_margin_deg"] > 0
        assert times["name"] == row["name"]
        assert times["total_s"] == pytest.approx(
            sum(times[f"{step}_s"] for step in plan.timings if step in STEPS)
        )


STEPS = ("decompose", "search", "trajectory", "certificate")


def test_the_same_study_has_the_same_table_and_scenarios_that_of_their_seeds(study):
    again = jp.run_study([np.int64(seed) for seed in SEEDS], "keep_in", chunk=2, progress=False)
    assert text(again) == text(study)
    given = jp.run_study([jp.random_scenario(seed, "keep_in") for seed in SEEDS], progress=False)
    assert given.kind is None
    for row, known in zip(given.table, study.table, strict=True):
        assert {**row, "seed": known["seed"], "kind": "keep_in"} == known


def test_settings_and_planner_replace_those_of_the_scenes():
    settings = {"search.max_expansions": np.int64(3), "trajectory.duration_s": 200, "search.max_goals": 1}
    found = jp.run_study([2, 10], "hard_keep_out", planner="wastar", settings=settings, progress=False)
    for row, seed in zip(found.table, (2, 10), strict=True):
        scenario = jp.random_scenario(seed, "hard_keep_out")
        search = replace(scenario.search, max_expansions=3, max_goals=1, method="wastar")
        trajectory = replace(scenario.trajectory, duration=200.0)
        plan = jp.plan(replace(scenario, search=search, trajectory=trajectory), throw=False, progress=False)
        assert (row["status"], row["message"]) == (plan.status.name, plan.message)
        assert row["expansions"] == plan.search.expansions <= 3
        assert row["length_steps"] is None
    assert found.settings == {"search.max_expansions": 3, "search.max_goals": 1, "trajectory.duration_s": 200}


def test_settings_leave_the_scene_as_it_is_to_the_last_bit():
    scenario = jp.random_scenario(7, "hard_keep_in")
    changed = with_settings(scenario, {"search.clearance_deg": 1.0, "trajectory.node_tube_deg": "inf"})
    assert changed.search.clearance == np.deg2rad(1.0)
    assert changed.trajectory.node_tube == np.inf
    assert changed.search.joint_step == scenario.search.joint_step
    assert changed.start is scenario.start
    assert changed.keep_out is scenario.keep_out
    assert with_settings(scenario, {}) is scenario


def test_all_faults_of_settings_are_named_before_anything_is_planned(monkeypatch):
    monkeypatch.setattr(rows, "plan_batch", lambda *_, **__: pytest.fail("planned"))
    with pytest.raises(jp.ScenarioError) as caught:
        jp.run_study(
            SEEDS,
            settings={
                "search.max_expansion": 5,
                "search.seed": -1,
                "spacecraft.rate_limit_deg_s": 1,
                "trajectory.duration_s": "short",
                "search": 3,
            },
        )
    message = str(caught.value)
    for words in (
        "settings has 5 faults",
        "search.max_expansion: unknown key, perhaps max_expansions is meant",
        "search.seed = -1: must be",
        "spacecraft.rate_limit_deg_s: no setting, those begin with search. or trajectory.",
        'trajectory.duration_s = "short"',
        "search: no setting",
    ):
        assert words in message
    with pytest.raises(jp.ScenarioError, match="time_limit_s: off in studies") as caught:
        jp.run_study(SEEDS, settings={"search.time_limit_s": 5, "search.method": "mha"})
    assert "search.method: given by planner" in str(caught.value)
    with pytest.raises(jp.ScenarioError, match="is nothing that a scenario file holds"):
        jp.run_study(SEEDS, settings={"search.seed": object()})
    with pytest.raises(TypeError, match="settings must be a dict"):
        jp.run_study(SEEDS, settings=["search.seed"])


@pytest.mark.parametrize(
    ("error", "words", "arguments"),
    [
        (TypeError, "must be several scenarios or seeds, such as range", {"scenarios_or_seeds": 20}),
        (TypeError, r"scenarios_or_seeds\[1\] = 1.5: must be a seed", {"scenarios_or_seeds": [1, 1.5]}),
        (TypeError, r"scenarios_or_seeds\[0\] = True: must be a seed", {"scenarios_or_seeds": [True]}),
        (
            ValueError,
            r"\[0\] = -1: must be at least 0\n.*\[2\] = 3: the same as",
            {"scenarios_or_seeds": [-1, 3, 3]},
        ),
        (ValueError, r"\[0\] = -1: must be at least 0", {"scenarios_or_seeds": range(-1, 3)}),
        (ValueError, "a study has less than", {"scenarios_or_seeds": range(10**20)}),
        (
            ValueError,
            r"\[1\] = 9223372036854775808: must be at most",
            {"scenarios_or_seeds": range(2**63 - 1, 2**63 + 1)},
        ),
        (ValueError, r"\[0\] = 9+.*: must be at most", {"scenarios_or_seeds": [99999999999999999999]}),
        (ValueError, "there is nothing to plan", {"scenarios_or_seeds": []}),
        (ValueError, "kind = 'easy': must be one of keep_out", {"kind": "easy"}),
        (ValueError, "planner = 'a-star': must be one of mha", {"planner": "a-star"}),
        (ValueError, "chunk = 0: must be a number of blocks of scenes", {"chunk": 0}),
    ],
)
def test_what_makes_no_study_is_refused_with_a_reason(error, words, arguments):
    with pytest.raises(error, match=words):
        jp.run_study(**{"scenarios_or_seeds": SEEDS, **arguments})


def test_scenarios_have_no_kind_and_are_not_mixed_with_others():
    case = jp.paper_case(1)
    with pytest.raises(ValueError, match="kind = 'keep_in': only seeds have one"):
        jp.run_study([case], "keep_in")
    with pytest.raises(TypeError, match=r"scenarios_or_seeds\[1\] must be a Scenario, not int"):
        jp.run_study([case, 3])


def test_a_scene_that_raises_is_a_row_and_the_others_are_planned(study, monkeypatch):
    def broken_batch(scenarios, **_):
        raise ZeroDivisionError

    def broken_plan(scenario, **options):
        if scenario.name == "keep_in 3":
            raise ZeroDivisionError("float division by zero")
        return jp.plan(scenario, **options)

    monkeypatch.setattr(rows, "plan_batch", broken_batch)
    monkeypatch.setattr(rows, "plan", broken_plan)
    found = jp.run_study(SEEDS, "keep_in", progress=False)
    crashed = found.table[3]
    assert crashed["status"] == "crashed"
    assert crashed["message"] == "ZeroDivisionError: float division by zero"
    assert crashed["certified"] is False
    assert crashed["duration_s"] is crashed["length_steps"] is None
    assert found.timings[3]["total_s"] is None
    others = [in_other_company(row) for row in study.table if row["scene"] != 3]
    assert [row for row in found.table if row["scene"] != 3] == others
    assert "4 OK, 1 crashed" in str(found.summary())


def test_the_threads_of_the_linear_algebra_do_not_change_the_table(study):
    before = [get() for get, _ in _openblas_libraries()]
    for _, set_number in _openblas_libraries():
        set_number(2)
    many = jp.run_study(SEEDS, "keep_in", progress=False)
    for (_, set_number), number in zip(_openblas_libraries(), before, strict=True):
        set_number(number)
    assert text(many) == text(study)


@pytest.mark.slow
def test_dask_workers_give_the_same_table(study):
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        spread = jp.run_study(SEEDS, "keep_in", workers=client.get_executor(), chunk=1, progress=False)
    assert text(spread) == text(study)
