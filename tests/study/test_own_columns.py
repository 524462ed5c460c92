"""Columns of one's own: checked, written, read back, and never a reason for a study to end."""

import numpy as np
import pytest
from builders import make_plan

import jaxplan as jp
from jaxplan.study import StudyFolderError
from jaxplan.study.rows import answer_of
from jaxplan.study.run import run_task
from jaxplan.study.task import Task

MADE = make_plan(1)


def breaks(plan):
    return len(plan.trajectory.breaks)


def two_outcomes(chunk):
    return answer_of(chunk, [(MADE, "it broke")[number % 2] for number in chunk.numbers])


def run(folder, columns, scenes=20):
    task = Task(kind="keep_in", scenes=range(scenes), planner="mha", columns=columns)
    return run_task(task, None, folder, 1, False, two_outcomes)


def test_columns_are_in_the_table_the_summary_and_the_folder(tmp_path):
    study = run(tmp_path, {"breaks": breaks, "half": lambda plan: np.float64(0.5)})
    for each in (study, jp.load_study(tmp_path), run(None, {"breaks": breaks, "half": lambda plan: 0.5})):
        assert each.columns == ("breaks", "half")
        assert [row["breaks"] for row in each.table] == [2.0, None] * 10
        np.testing.assert_array_equal(each.values("half"), [0.5] * 10)
        assert each.summary().spreads["breaks"]["mean"] == 2
    frame = pytest.importorskip("pandas") and study.to_pandas()
    assert frame["breaks"].count() == 10


def test_a_study_with_columns_goes_on_and_others_are_refused(tmp_path):
    first = run(tmp_path, {"breaks": breaks})
    path = tmp_path / "table.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:5]))
    assert run(tmp_path, {"breaks": breaks}).table == first.table
    assert run(tmp_path, {"breaks": breaks}, scenes=40).table[:20] == first.table
    for other in ({}, {"pieces": breaks}):
        with pytest.raises(StudyFolderError, match="columns"):
            run(tmp_path, other, scenes=40)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda plan: 1 / 0, "column own: ZeroDivisionError: division by zero"),
        (lambda plan: float("nan"), "column own: ValueError: nan is no finite number"),
        (lambda plan: [1.0], "is no finite number"),
        (lambda plan: "7", "'7' is no finite number"),
        (lambda plan: None, "column own: TypeError"),
    ],
)
def test_a_function_that_makes_no_number_leaves_a_gap_and_the_message_says_why(function, words):
    row = run(None, {"own": function}, scenes=1).table[0]
    assert row["own"] is None
    assert words in row["message"]
    assert row["status"] == "OK"


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ([breaks], "columns must be a dict of functions by name, not list"),
        ({"duration_s": breaks}, "duration_s is a column that every study has"),
        ({"two words": breaks}, "'two words' must be a name without blanks"),
        ({"": breaks}, "'' must be a name"),
        ({"own": 3}, "own must be a function of a plan, not int"),
    ],
)
def test_wrong_columns_are_refused_before_anything_is_planned(columns, words):
    with pytest.raises((TypeError, ValueError), match=words):
        jp.run_study(range(2), columns=columns)


def test_functions_that_no_process_can_get_are_refused():
    with pytest.raises(ValueError, match="own cannot be sent to processes"):
        jp.run_study(range(2), columns={"own": lambda plan: 1.0}, workers=2)
