import json
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario, scene_of
from reference import edge_states, sampled_margin

import jaxplan as jp
from jaxplan.model.path import Path
from jaxplan.model.zones import KeepOut
from jaxplan.search.paths import make_path
from jaxplan.study import printed_planners


def straight_path(scene, edges: int) -> Path:
    attitudes, joints = edge_states(
        scene.start_attitude, scene.start_joints, scene.goal_attitude, scene.goal_joints, edges + 1
    )
    return make_path(scene, attitudes, joints)


@pytest.mark.parametrize("edges", [1, 3, 20])
def test_a_path_is_clear_when_the_sampled_margin_is_everywhere_positive(edges):
    rng = np.random.default_rng(edges)
    verdicts = set()
    for _ in range(20):
        direction = rng.standard_normal(3)
        zone = KeepOut(name="Z", direction=direction / np.linalg.norm(direction), half_angle=0.5, devices=())
        scene = scene_of(make_scenario(2, 1, keep_out=(zone,)))
        states = edge_states(
            scene.start_attitude, scene.start_joints, scene.goal_attitude, scene.goal_joints, 2001
        )
        margin = sampled_margin(scene, *states).min()
        if abs(margin) > 1e-3:
            verdict = np.all(
                printed_planners.least_margins(scene, straight_path(scene, edges))
                >= -printed_planners.TOLERANCE
            )
            assert verdict == (margin > 0)
            verdicts.add(verdict)
    assert verdicts == {True, False}


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(19, 20, 0.7639, 0.9911), (20, 20, 0.8389, 1.0), (0, 5, 0.0, 0.4345), (0, 0, 0.0, 1.0)],
)
def test_intervals_are_wilsons(successes, trials, low, high):
    np.testing.assert_allclose(printed_planners.success_interval(successes, trials), (low, high), atol=1e-4)


@pytest.mark.slow
def test_all_planners_get_the_same_scenes_and_every_kind_its_rows():
    rows = printed_planners.compare(("keep_out", "hard_keep_in"), ("mha", "mha-paper"), count=2)
    assert [(row.kind, row.planner) for row in rows] == [
        ("keep_out", "mha"),
        ("keep_out", "mha-paper"),
        ("hard_keep_in", "mha"),
        ("hard_keep_in", "mha-paper"),
    ]
    for row in rows:
        assert row.scenes == len(row.seconds) == 2
        assert len(row.nodes) == len(row.steps) == row.clear <= row.found <= 2
    again = printed_planners.compare(("keep_out",), ("mha",), count=2)
    np.testing.assert_array_equal(again[0].steps, rows[0].steps)


@pytest.mark.slow
def test_rows_are_studies_whose_tables_are_the_same_again_and_compare():
    first, again = (printed_planners.search_study(range(3), "hard_keep_in", "wastar") for _ in range(2))
    assert json.dumps(first.table) == json.dumps(again.table)
    row = printed_planners.row_of_study(first)
    assert (row.found, row.clear) == (first.planned, sum(one["certified"] for one in first.table))
    for one in first.table:
        assert one["certified"] == (one["min_margin_deg"] is not None and one["min_margin_deg"] >= -1e-6)
    compared = jp.compare_studies(first, printed_planners.search_study(range(3), "hard_keep_in", "mha"))
    assert (compared.scenes, compared.both + compared.only_first) == (3, row.found)


def test_scenes_proved_infeasible_are_left_out(monkeypatch):
    monkeypatch.setattr(printed_planners, "find_barrier", lambda scene: object())
    (row,) = printed_planners.compare(("keep_out",), ("mha",), count=1)
    assert row.scenes == row.found == 0
    assert "0/0" in printed_planners.format_table([row])


def test_the_table_lines_up_and_shows_the_papers_rows_beside():
    rows = printed_planners.compare(("keep_out",), ("mha",), count=1)
    lines = printed_planners.format_table(
        [*rows, replace(rows[0], planner="other", kind="held_links")]
    ).splitlines()
    assert sum("paper's" in line for line in lines) == 3
    assert len({line.index("/") for line in lines if "/" in line}) == 1
    assert len({len(line) for line in lines if "mha" in line or "MinT" in line}) == 1
