"""What is told of a problem of slew times that has no states, or that no file could hold."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.slew_matrix.problem import make_problem

PLAIN = jp.Spacecraft(
    instruments=[jp.Instrument(name="telescope", boresight=[0, 0, 1])],
    rate_limit=np.deg2rad(1.5),
    acceleration_limit=np.deg2rad(0.3),
)
ANGLES = np.deg2rad([20.0, 25.0, 30.0, 35.0, 40.0])
STATION = jp.DirectionPath.through(
    [0.0, 100.0, 200.0, 300.0, 400.0], np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1)
)


@pytest.mark.parametrize(
    ("departures", "until", "words"),
    [
        (
            [0.0, 100.0],
            250.0,
            "at the departure, at 100 s; it is seen from 250 s on: take a departure at 250 s",
        ),
        (
            None,
            250.0,
            "at the departure, at 0 s; it is seen from 250 s on: take a departure at 250 s or later",
        ),
        (
            [100.0],
            1e4,
            "at the departure, at 100 s; it is not seen again in all the .* s that are known: let it",
        ),
    ],
)
def test_a_target_that_is_hidden_at_the_departure_names_the_departure_to_take(departures, until, words):
    hidden = (jp.Hidden(target="station", by="the Earth", start=-10.0, end=until),)
    goals = {"station": jp.Targets.of({"telescope": replace(STATION, hidden=hidden)})}
    problem = make_problem(
        PLAIN, goals, zones={"keep_out": (), "keep_in": (), "joint_bounds": ()},
        departures=departures, start=None, free=False, settings=None,
    )  # fmt: skip
    state = problem.states[-1][0]
    assert state.status == "INVALID_GOAL"
    assert re.search(words, state.message), state.message
    assert "duration" not in state.message.split("known: ")[0]


@pytest.mark.parametrize("problem", [PLAIN, "scenario"])
def test_a_wrong_start_is_told_once_and_no_goal_that_nobody_gave(problem):
    wrong = jp.GivenState(rotation_vector=[0, 0, 0], joints=[0, 0, 0])
    if problem == "scenario":
        right = jp.GivenState(rotation_vector=[0, 0, 0], joints=[])
        problem = jp.Scenario(name="scene", spacecraft=PLAIN, start=right, goal=right)
    with pytest.raises(jp.ScenarioError) as raised:
        jp.slew_times(problem, {"star": {"telescope": [0.6, 0.0, 0.8]}}, start=wrong)
    (fault,) = raised.value.faults
    assert fault.startswith("start.joints")
