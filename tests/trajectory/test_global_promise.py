"""What the method "global" knows of its next program without solving it, by weak duality."""

from dataclasses import replace

import numpy as np
import pytest
from reference import assert_each

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.planner.steps import wanted_fit
from jaxplan.trajectory import curve_attempts, fit_batch, sqp
from jaxplan.trajectory.step_programs import decrease_bound, solve


@pytest.fixture(scope="module")
def searches():
    """Of fits in 60 s and stretched ones on scenes of all kinds, after a first step."""
    scenes = [jp.random_scenario(seed, kind) for kind in SKY_KINDS for seed in range(4)]
    queries = []
    for plan in jp.plan_batch(scenes):
        for duration in (60.0, "stretched"):
            settings = TrajectorySettings(duration=duration)
            queries.append(wanted_fit(replace(plan.scenario, trajectory=settings), plan.path, plan.goal))
    begins, improve = [], sqp.improve
    with pytest.MonkeyPatch.context() as patch:
        noted = lambda several: begins.extend(several) or improve(several)  # noqa: E731
        patch.setattr(curve_attempts.sqp, "improve", noted)
        fit_batch(queries)
    given = [begin for begin in begins if not begin.discrete.free_time]
    alike = {}
    for begin in given:
        alike.setdefault(begin.discrete.kind, []).append(begin)
    found = [sqp.SQPState.of(several) for several in alike.values() if len(several) > 1]
    for search in found:
        search.step()
    return found


def program(search):
    """Objectives, rows and their program's answer at the curves of a search."""
    quadratic = search.program(search.at, np.zeros(len(search.value)))
    return quadratic, solve(quadratic, search.multipliers)


def lowered(quadratic, change):
    """By how much changes (G, n, A) lower the objectives."""
    cost = change * (quadratic.hessian @ change / 2 + quadratic.gradient)
    return -np.sum(cost.reshape(len(change), -1), axis=1)


def test_a_programs_own_multipliers_promise_what_it_does(searches):
    told = 0
    for search in searches:
        quadratic, proposal = program(search)
        every = np.arange(len(search.value))
        promise = decrease_bound(quadratic, proposal.multipliers, every)
        done = lowered(quadratic, proposal.coefficients)
        # Rows that are broken for their penalty, or by next to nothing, pay as well.
        sound = search.at.is_sound
        assert_each(promise, ">=", done - 1e-9 * search.value)
        np.testing.assert_allclose(promise[sound], done[sound], rtol=1e-4, atol=1e-6)
        told += np.sum(sound)
    assert told > 20


def test_no_multipliers_promise_less_than_a_program_does(searches):
    rng = np.random.default_rng(0)
    for search in searches:
        quadratic, proposal = program(search)
        done = lowered(quadratic, proposal.coefficients)
        which = np.flatnonzero(search.at.is_sound)
        for _ in range(4 if len(which) else 0):
            others = {name: own * rng.uniform(0, 2, own.shape) for name, own in proposal.multipliers.items()}
            bound = decrease_bound(quadratic, others, which)
            assert_each(bound, ">=", done[which] - 1e-6 * search.value[which])


def test_where_the_last_multipliers_promise_little_the_next_program_does_little(searches):
    stopped = 0
    for search in searches:
        _, proposal = program(search)
        quadratic = search.program(search.at, np.zeros(len(search.value)))
        before = decrease_bound(quadratic, search.multipliers, np.arange(len(search.value)))
        after = search.energy(search.at) - lowered(quadratic, proposal.coefficients)
        stops = search.at.is_sound & (before <= 1e-3 * search.value)
        stopped += np.sum(stops)
        assert_each(after[stops], ">=", (1 - 1e-3) * search.energy(search.at)[stops] - 1e-9)
    assert stopped > 10


def test_the_less_a_step_must_be_worth_the_nearer_a_fit_ends_to_its_optimum(searches):
    nearer = 0
    for search in searches:
        ends = {}
        for ftol in (1e-3, 1e-6):
            begins = [
                sqp.InitialGuess(discrete=discrete, coefficients=own, duration=duration, ftol=ftol)
                for discrete, own, duration in zip(
                    search.stack.members, search.at.coefficients, search.at.duration, strict=True
                )
            ]
            ends[ftol] = np.stack([solution.coefficients for solution in sqp.improve(begins)])
        rough, exact = (search.stack.iterates(ends[ftol], search.at.duration) for ftol in (1e-3, 1e-6))
        clean = rough.is_sound & exact.is_sound
        more = search.energy(rough) - search.energy(exact)
        assert_each(more[clean], ">=", -1e-6 * search.value[clean])
        nearer += np.sum(more[clean] > 1e-6 * search.value[clean])
    assert nearer > 5
