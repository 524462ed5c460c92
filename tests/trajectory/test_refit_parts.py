"""What a plan that is followed depends on, part by part: against the fit's own, and differences."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from held_plans import (
    at_speed,
    metric,
    near_a_zone_at_the_goal,
    one_of_two_links,
    plan_of,
    there_and_back,
    valued,
    widened_tube,
)
from node_paths import load
from quick import quick_jit

import jaxplan as jp
from jaxplan import so3
from jaxplan.cases import paper_case
from jaxplan.model.path import Path
from jaxplan.paper.derivative import held_of, nominal_duration, refit
from jaxplan.paper.segments import ChainRequest, PathNodes, plan_chains
from jaxplan.planner.steps import fit
from jaxplan.trajectory.derivative import gather_inputs
from jaxplan.trajectory.node_times import FEWEST_NODES, padded
from jaxplan.trajectory.optimality import energy_of, offset_of
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.splines import end_derivatives, weighted

FITS = {
    "the long way round": lambda: plan_of("limits of the platform, the long way round"),
    "a link that is not held": lambda: jp.plan(one_of_two_links()),
    "near a zone at the goal": lambda: jp.plan(near_a_zone_at_the_goal()),
    "there and back": there_and_back,
    "at speed": lambda: jp.plan(at_speed()),
    "a wider tube": widened_tube,
}


@quick_jit
def parts_of(held, path, craft, settings, cones, rates, duration):
    on_breaks, inputs = gather_inputs(held, path, craft, settings, cones, rates)
    return on_breaks, inputs, offset_of(held, inputs, duration), energy_of(held, inputs, duration)


@pytest.mark.slow
@pytest.mark.parametrize("name", FITS)
def test_what_the_optimum_depends_on_is_what_the_fit_had(name):
    plan = FITS[name]()
    craft, settings = plan.scenario.spacecraft, plan.scenario.trajectory
    origin = fit(plan.scenario, plan.path, plan.goal).origin
    held, problem, discrete = origin.hold(), origin.problem, origin.attempt.discrete
    duration = origin.attempt.solution.duration
    path = Path(
        attitudes=padded(problem.attitudes, FEWEST_NODES),
        joints=padded(problem.joints, FEWEST_NODES),
        edge_costs=np.zeros(0),
    )
    with jax.enable_x64(True):
        given = (held, path, craft, settings, problem.cones, problem.rates, duration)
        on_breaks, inputs, offset, energy_form = jax.tree.map(np.asarray, parts_of(*given))
    for own, other in zip(jax.tree.leaves(on_breaks), jax.tree.leaves(held), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-12)  # the pace is that of the fit
    np.testing.assert_allclose(inputs.moved, 0, atol=1e-12)
    np.testing.assert_allclose(inputs.duration, duration, rtol=1e-12)
    space, places = discrete.space, discrete.mesh.places
    chart, count = discrete.chart, len(places)
    expected = {
        "attitude": chart.attitude,
        "turn": chart.turn,
        "limits": discrete.share * np.concatenate([limit.bound for limit in problem.limits]),
        "wanted": problem.wanted,
    }
    np.testing.assert_allclose(inputs.body.inertia, problem.body.inertia, rtol=1e-11)
    for part, own in expected.items():
        np.testing.assert_allclose(getattr(inputs, part), own, rtol=1e-11, atol=1e-13, err_msg=part)
    powers = [(limit.quantity.power, len(limit.bound)) for limit in problem.limits]
    assert inputs.load_powers == tuple(power for power, count in powers for _ in range(count))
    np.testing.assert_allclose(offset, space.fixed + duration * space.by_time, rtol=1e-11, atol=1e-13)
    nodes = np.concatenate(
        [chart.coordinates(problem.attitudes, problem.turns, places), problem.joints], axis=1
    )
    np.testing.assert_allclose(inputs.nodes[:count], nodes, atol=1e-12)
    energy = weighted(space.energies[None], np.array([duration]), np.array([problem.weights]))[0]
    np.testing.assert_allclose(energy_form / energy_form.max(), energy / energy.max(), atol=1e-13)
    rates = craft.joint_rate_limits * duration, craft.joint_acceleration_limits * duration**2
    # There is no tube where nodes are passed exactly.
    radius = discrete.tube_radius if len(discrete.tube_rows) else []
    scales = np.concatenate([*rates, craft.joint_ranges[:, 1], radius])
    found = inputs.scales * duration**inputs.powers
    np.testing.assert_allclose(found[: len(scales)], scales, rtol=1e-12)


@pytest.mark.parametrize("deciding", [0, 1])
def test_the_time_before_it_is_stretched_is_that_of_the_fit(deciding):
    path = load("astar_c3")
    turns = so3.log(np.swapaxes(path.attitudes[:-1], 1, 2) @ path.attitudes[1:])
    moves = np.concatenate([turns, np.diff(path.joints, axis=0)], axis=1)
    rng, found = np.random.default_rng(0), quick_jit(nominal_duration)
    even = np.linspace(0, 1, len(moves) + 1)
    shares = rng.dirichlet(np.full(len(moves), 5.0), 8)
    cases = [even**1.5, 1 - (1 - even) ** 1.5]  # in duration_hessian at the start, and at the end
    cases += [np.concatenate([[0], np.cumsum(share)]) for share in shares]
    for fractions in cases:
        limits = rng.uniform(0.5, 2.0, (2, moves.shape[1]))
        limits[deciding] /= 100
        edges = np.diff(fractions)
        rates = np.pad(moves / edges[:, None], ((1, 1), (0, 0)))
        middles = np.concatenate([[-edges[0] / 2], fractions[:-1] + edges / 2, [1 + edges[-1] / 2]])
        accelerations = np.diff(rates, axis=0) / np.diff(middles)[:, None]
        ratios = np.max(np.abs(rates) / limits[0]), np.sqrt(np.max(np.abs(accelerations) / limits[1]))
        expected = max(ratios)
        assert ratios.index(expected) == deciding
        last = np.arange(len(fractions) + 3).clip(max=len(fractions) - 1)  # with nodes that are padding
        with jax.enable_x64(True):
            for own in (np.arange(len(fractions)), last):
                duration = found(path.attitudes[own], path.joints[own], fractions[own], limits)
                assert float(duration) == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [0, 1])
def test_gradients_of_the_papers_scheme_hold_where_limits_bind_at_joins(derivative):
    path, craft, count = load("astar_c3"), paper_case(3).spacecraft, 3
    settings = replace(paper_case(3).trajectory, duration=80.0)
    rng = np.random.default_rng(0)
    ends = rng.normal(size=(2, 9)) * np.array([0.002] * 3 + [0.001] * 6)
    nodes = PathNodes(
        attitudes=path.attitudes,
        joints=path.joints,
        fractions=np.linspace(0, 1, len(path.attitudes)),
        turns=np.asarray(so3.log(np.swapaxes(path.attitudes[:-1], 1, 2) @ path.attitudes[1:])),
        rates=ends,
    )

    def with_limits(limits):
        """Rate and acceleration of the platform, rates and then accelerations of the terminals' joints."""
        terminals = [
            replace(one, rate_limit=limits[2 + i], acceleration_limit=limits[5 + i])
            for i, one in enumerate(craft.terminals)
        ]
        return replace(craft, rate_limit=limits[0], acceleration_limit=limits[1], terminals=tuple(terminals))

    def planned(duration, at_joins):
        request = ChainRequest(
            nodes=nodes, duration=duration, segments=count, settings=settings, limits=at_joins
        )
        return plan_chains([request])[0]

    def anew(limits, duration):
        own = with_limits(limits)
        platform = np.repeat([[own.rate_limit], [own.acceleration_limit]], 3, axis=1) / SAFETY
        at_joins = platform, np.stack([own.joint_rate_limits, own.joint_acceleration_limits]) / SAFETY
        curve = planned(duration, at_joins)
        return curve, held_of(nodes, curve, at_joins)

    # Limits a little below what the largest would be at the joins without.
    free = planned(80.0, None)
    rows = end_derivatives(settings.order)
    platform = rows[0] @ free.coefficients[1:], np.diff(free.breaks)[1:, None] / 2
    joints = rows[1] @ free.joint_coefficients[:-1], np.diff(free.joint_breaks)[:-1, None] / 2
    largest = [
        np.max(np.abs(found[:, d]) / half ** (d + 1), axis=0)
        for found, half in (platform, joints)
        for d in range(2)
    ]
    of_terminals = [np.max(each.reshape(2, -1), axis=0) for each in largest[2:]]
    limits = np.concatenate([[each.max() for each in largest[:2]], *of_terminals])
    binding = np.array([0, 1, 0, 0, 0, 1, 1, 1]) == derivative  # rates, or accelerations
    limits *= np.where(binding, 0.9, 10.0)
    curve, held = anew(limits, 80.0)
    assert all(np.any(chain.sides[:, derivative] != 0) for chain in (held.platform, held.joints))

    def number_of(limits, duration):
        changed = replace(settings, duration=duration)
        return metric(refit(held, path, with_limits(limits), changed, None, ends))

    with jax.enable_x64(True):
        value, slopes = quick_jit(jax.value_and_grad(number_of, (0, 1)))(limits, 80.0)
        assert float(value) == pytest.approx(float(valued()(curve)), rel=1e-9)
        np.testing.assert_array_equal(slopes[0] != 0, binding)
        way, step = limits * rng.normal(size=len(limits)), 1e-5
        at = {
            share: float(valued()(anew(limits + share * step * way, 80.0 + share * step * 50)[0]))
            for share in (-2, -1, 1, 2)
        }
    found = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * step)
    assert float(slopes[0] @ way + slopes[1] * 50) == pytest.approx(found, rel=1e-6)
