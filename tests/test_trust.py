"""A small share of every count that `python -m trust` makes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trust import any_spacecraft, arrays, dips, golden, graphs, lanes, long_run, programs, symmetry, verdicts
from trust.mixed import mixed_scenario
from trust.tally import Tally, table, tally

import jaxplan as jp

seeds = given(st.integers(0, 2**31 - 1))


def few(examples: int):
    return settings(max_examples=examples, deadline=None, derandomize=True)


@few(16)
@seeds
def test_the_certificate_never_says_yes_where_samples_say_no(seed):
    verdicts.attempt(seed)


def test_the_certificate_says_yes_to_margins_from_a_twentieth_of_a_degree_on():
    words = [verdicts.attempt(seed) for seed in range(24)]
    assert words.count("broken") == 8
    assert words.count("clear, yes") >= 8
    assert words.count("clear, no") == 0


@few(3)
@seeds
def test_a_dip_of_a_microsecond_is_refused_and_its_twin_certified(seed):
    dips.attempt(seed)


@pytest.mark.slow
def test_wheels_keep_their_limits_and_not_tighter_ones():
    words = [arrays.attempt(seed) for seed in (3, 4)]
    assert [word.split()[0] for word in words] == ["pseudo_inverse", "minimax"]


@few(4)
@seeds
def test_margins_depend_on_neither_frame_nor_hand_nor_names_nor_order_nor_pace(seed):
    symmetry.attempt(seed)


@few(10)
@seeds
def test_programs_are_solved_as_by_other_engines(seed):
    programs.box(seed)
    programs.limited(seed)


def test_small_programs_are_solved_as_by_another_engine():
    words = programs.three(0)
    assert {"solved", "without solution"} == set(words)


def test_a_way_costs_at_most_the_product_of_the_weights_times_the_cheapest():
    words = {graphs.attempt(seed) for seed in range(3)}
    assert {"the cheapest", "within the bound", "without a way"} & words


def test_smaller_cones_stay_solvable():
    graphs.shrinking(0)


@pytest.mark.slow
def test_a_nan_in_one_of_a_thousand_lanes_is_lost_in_none():
    for seed in range(4):
        lanes.attempt(seed)


def test_the_golden_set_has_every_kind_and_what_differs_is_said():
    kept = golden.stored()
    assert tuple(kept) == golden.NAMES
    row = kept["case 1"]
    assert golden.differences(row, {**row, "status": "NODE_LIMIT"}, 0.01) == [
        "status: OK is kept, NODE_LIMIT is found"
    ]
    assert len(golden.differences(row, {**row, "duration_s": 1.02 * row["duration_s"]}, 0.01)) == 1
    assert len(golden.differences(row, {**row, "length_steps": None}, 0.01)) == 1


def test_a_scene_of_any_sort_is_certified_or_answered_with_a_status():
    plan = jp.plan(mixed_scenario(1, (3, 0), 8), throw=False, progress=False)
    long_run.examine(plan)


def test_a_random_spacecraft_is_certified_and_kept_in_files():
    assert any_spacecraft.attempt(52) == "OK"


def test_attempts_that_fail_or_hang_are_counted_with_their_seeds(capsys):
    def attempt(seed: int) -> str:
        if seed == 3:
            raise ValueError("odd")
        while seed == 5:
            np.zeros(1)
        return "even" if seed % 2 == 0 else "odd"

    found = tally("numbers", range(7), attempt, limit_s=0.2)
    assert (found.count, list(found.failures), found.note) == (7, [3, 5], "4 even, 1 odd")
    assert "seed 5: TimeoutError" in capsys.readouterr().err
    text = table([found, Tally(what="nothing", count=1_000_000)])
    assert [len(line.split("  ")[0]) for line in text.splitlines()[2:]] == [7, 7]
    assert "1,000,000" in text
    assert "3, 5" in text
