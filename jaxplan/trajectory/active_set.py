"""The active set of a spline fit that was made: which rows bind at its optimum.

The fit is improved beyond what a plan needs; its program's multipliers tell which rows bind. That set is
tried by looking for a root of the optimality conditions (`derivative`): rows whose multipliers have the wrong
sign are dropped and broken ones added, until the set stays as it is. Where rows depend on each other,
nonnegative least squares finds those that suffice.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import jax
import numpy as np

from jaxplan.display import shown
from jaxplan.model.path import Path
from jaxplan.model.scenario import MINIMUM
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.quick_jit import quick_jit
from jaxplan.trajectory import options, program, sqp
from jaxplan.trajectory.attempts import Attempt
from jaxplan.trajectory.chart import Chart
from jaxplan.trajectory.constraints import (
    SIGNS,
    ConstraintBlock,
    Index,
    JointDerivativeBlock,
    LoadBlock,
)
from jaxplan.trajectory.derivative import (
    ActiveSet,
    BindingLinear,
    BindingLoads,
    BindingMargins,
    filled,
    gather_inputs,
    linearised,
)
from jaxplan.trajectory.discretisation import DiscreteProblem, end_margins
from jaxplan.trajectory.iterates import Iterates, Stack
from jaxplan.trajectory.problem import FitProblem
from jaxplan.trajectory.schedule import FEWEST_NODES, padded

Masks = dict[str, np.ndarray]  # by block of constraints, of every row

_inputs = quick_jit(gather_inputs)


@shown()
@dataclass(frozen=True, kw_only=True, eq=False)
class FitRecord:
    """How a fit came about.

    Attributes:
        problem: what was fitted.
        attempt: how it ended.
        stretched: whether its time was stretched to the limits.
    """

    problem: FitProblem
    attempt: Attempt
    stretched: bool

    def hold(self) -> ActiveSet:
        """The active set, with all else that derivatives hold fixed.

        Raises:
            ValueError: if it is not an optimum in a given time or without limits, or if no set of rows is
                found that binds there, as where one is about to.
        """
        discrete, solution = self.attempt.discrete, self.attempt.solution
        asked = self.problem.settings.duration
        if asked == MINIMUM or (isinstance(asked, str) and not self.stretched):
            raise ValueError("a shortest motion has no derivatives: set trajectory.duration_s to a number")
        if not self.stretched and (discrete.free_time or not discrete.limited):
            raise ValueError(
                f"for a duration of {asked:g} s a quicker motion was slowed, which has no derivatives: try "
                "another trajectory.duration_s, above all a longer one"
            )
        first = sqp.InitialGuess(
            discrete=discrete,
            coefficients=solution.coefficients,
            duration=solution.duration,
            ftol=options.ACTIVE_SET.ftol,
        )
        (solution,) = sqp.improve([first])
        stack = Stack.of([discrete])  # of one
        at = stack.iterates(solution.coefficients[None], np.array([solution.duration]))
        objective = sqp.Objective(stack, at)
        penalty = sqp.penalties(False)[None]
        quadratic = objective.program(at, np.zeros(1), penalty)
        rows = {block.name: block for block in quadratic.blocks}
        multipliers = program.solve(quadratic, {}).multipliers
        binding = {name: own > 0 for name, own in multipliers.items()}
        crowded = False
        for _ in range(options.ACTIVE_SET.looks):
            held = self._held(at, rows, binding, multipliers, float(objective.share[0]))
            root = self._root(held)
            if root is not None:
                coefficients, found = root
                at = stack.iterates(coefficients[None], at.duration)
                quadratic = objective.program(at, np.zeros(1), penalty)
                rows = {block.name: block for block in quadratic.blocks}
                multipliers = _named(rows, binding, held, found)
                least = -options.ACTIVE_SET.wrong_sign * np.max(found, initial=1.0)
                after = {
                    name: next_rows(rows[name], own, multipliers[name], least)
                    for name, own in binding.items()
                }
                if all(np.array_equal(after[name], own) for name, own in binding.items()):
                    return replace(held, x=self._free(at), multipliers=found)
                binding = after
            elif crowded:
                break
            # Where a rate stays at its limit, rows beside each other follow from each other.
            crowded = crowded or root is None
            if crowded:
                multipliers = independent(quadratic, binding)
                binding = {name: own > 0 for name, own in multipliers.items()}
        raise ValueError(
            "which limits, zones and nodes bind cannot be told, as where one of them is about to: change "
            "trajectory.duration_s a little"
        )

    def _root(self, held: ActiveSet) -> tuple[np.ndarray, np.ndarray] | None:
        """Coefficients and multipliers where ``F`` is zero, by Newton's method; None if it does not end."""
        problem, solution = self.problem, self.attempt.solution
        path = Path(
            attitudes=padded(problem.attitudes, FEWEST_NODES),
            joints=padded(problem.joints, FEWEST_NODES),
            edge_costs=np.zeros(0),
        )
        settings = replace(problem.settings, duration=0.0)  # given beside
        z = np.concatenate([held.x.ravel(), held.multipliers])
        with jax.enable_x64(True):
            inputs = _inputs(
                held, path, problem.spacecraft, settings, problem.cones, problem.rates, solution.duration
            )
            best, least = z, np.inf
            for _ in range(options.ACTIVE_SET.steps):
                left, matrix = (np.asarray(array) for array in linearised(held, inputs, z))
                if not (np.all(np.isfinite(left)) and np.all(np.isfinite(matrix))):
                    break
                most = float(np.max(np.abs(left)))
                if most < least:
                    best, least = z, most
                if least <= options.ACTIVE_SET.residual:
                    break
                z = z - np.linalg.solve(matrix, left)
        if not least <= options.ACTIVE_SET.rounded:
            return None
        x = best[: held.x.size].reshape(held.x.shape)
        return held.free @ x + np.asarray(inputs.offset), best[held.x.size :]

    def _widened(self) -> float:
        """Ratio of the tube radius that was used to the one asked for; 1 without a tube, or a width."""
        asked, kept = self.problem.radius(free_time=False), self.attempt.radius
        return kept / asked if np.isfinite(kept) and asked > 0 else 1.0

    def _free(self, at: Iterates) -> np.ndarray:
        """Free coefficients ``x`` (k, A) of a curve."""
        space = self.attempt.discrete.space
        start = space.fixed + at.duration[0] * space.by_time
        return np.linalg.lstsq(space.free, at.coefficients[0] - start, rcond=None)[0]

    def _held(
        self,
        at: Iterates,
        rows: dict[str, ConstraintBlock],
        binding: Masks,
        multipliers: Masks,
        share: float,
    ) -> ActiveSet:
        problem, discrete = self.problem, self.attempt.discrete
        space, system = discrete.space, discrete.system
        inner = np.arange(1, len(problem.attitudes) - 1) if self.attempt.radius == 0 else np.zeros(0, int)
        linear, loads, zones, flat = _gathered(discrete, rows, binding, multipliers)
        places = self.attempt.request.mesh.places
        return ActiveSet(
            free=space.free,
            of_values=space.of_values,
            of_rates=space.of_rates,
            energies=space.energies[1:] / share,
            pieces=space.basis.pieces(np.eye(space.basis.size)),
            breaks=space.basis.breaks,
            places=padded(places, FEWEST_NODES),
            given=np.concatenate([[0, len(problem.attitudes) - 1], inner]),
            windings=padded(_windings(system.chart, problem.attitudes, places), FEWEST_NODES),
            long_way=np.array(float(np.linalg.norm(system.chart.turn) > np.pi)),
            share=np.array(system.share),
            widened=np.array(self._widened()),
            counted=np.isfinite(end_margins(system, problem.attitudes, problem.joints)),
            duration=np.array(at.duration[0] if self.stretched else np.nan),
            linear=linear,
            loads=loads,
            zones=zones,
            x=self._free(at),
            multipliers=flat,
            stretched=self.stretched,
        )


def _order(blocks: dict[str, ConstraintBlock], binding: Masks) -> list[tuple[str, Index]]:
    """The rows that bind, in the order of `Held`: of joints and nodes, of loads, of zones."""
    joints = [name for name, block in blocks.items() if isinstance(block, JointDerivativeBlock)]
    loads = [name for name, block in blocks.items() if isinstance(block, LoadBlock)]
    names = (*joints, "range", "tube", *loads, "zone")
    found = {name: np.nonzero(binding[name]) for name in names if name in blocks}
    return [(name, index[1:]) for name, index in found.items()]  # of the one curve


def _named(
    blocks: dict[str, ConstraintBlock], binding: Masks, held: ActiveSet, multipliers: np.ndarray
) -> Masks:
    """Multipliers of all rows by block."""
    on = np.concatenate([held.linear.on, held.loads.on, held.zones.on])
    flat = multipliers[on]
    found = {name: np.zeros(block.slack.shape) for name, block in blocks.items()}
    for name, index in _order(blocks, binding):
        count = len(index[0])
        found[name][0][index], flat = flat[:count], flat[count:]
    return found


def _gathered(
    discrete: DiscreteProblem, blocks: dict[str, ConstraintBlock], binding: Masks, given: Masks
) -> tuple[BindingLinear, BindingLoads, BindingMargins, np.ndarray]:
    """The rows that bind, padded, with their multipliers in the same order."""
    system, basis = discrete.system, discrete.space.basis
    joints = discrete.space.fixed.shape[1] - 3
    quantities = [limit.quantity for limit in system.joint_limits]
    matrices = {quantity.name: basis.differences[quantity.power] for quantity in quantities}
    matrices["range"] = np.eye(basis.size)
    if discrete.tube is not None:
        matrices["tube"] = discrete.tube.rows
    none = np.zeros(0, int)
    linear = [(np.zeros((0, basis.size)), np.zeros(0), none, none, none)]
    loads = [(none, np.zeros(0), none, none)]
    zones: Index = (none, none, none)
    multipliers: list[list[np.ndarray]] = [[np.zeros(0)] for _ in range(3)]
    for name, index in _order(blocks, binding):
        if name in matrices:
            sign, row, axis = index
            of_nodes = name == "tube"
            first = 0 if of_nodes else 3
            node = row + 1 if of_nodes else np.full(len(row), -1)
            scale = list(matrices).index(name) * joints + axis
            linear.append((matrices[name][row], SIGNS[sign], axis + first, node, scale))
            multipliers[0].append(given[name][0][index])
        elif name == "zone":
            zones = index
            multipliers[2].append(given[name][0][index])
        else:
            place, sign, axis = index
            loads.append((place, SIGNS[sign], np.full(len(place), system.names.index(name)), axis))
            multipliers[1].append(given[name][0][index])
    flat = [np.concatenate(own) for own in multipliers]
    # Where none binds there is padding, too, so that what is held of several plans can be stacked.
    least = options.ACTIVE_SET.padding
    counts = [padded_count(max(len(own), 1), size) for own, size in zip(flat, least, strict=True)]
    if not len(flat[1]):
        counts[1] = 0  # loads are seldom near, and their slopes are dear
    if not len(system.cones.axis):
        counts[2] = 0
    row, sign, axis, node, scale = (np.concatenate(parts) for parts in zip(*linear, strict=True))
    of_linear = BindingLinear(
        on=np.arange(counts[0]) < len(sign),
        row=filled(row, counts[0]),
        sign=filled(sign, counts[0]),
        axis=filled(axis, counts[0]),
        node=filled(node, counts[0]),
        scale=filled(scale, counts[0]),
    )
    place, sign, load, axis = (np.concatenate(parts) for parts in zip(*loads, strict=True))
    of_loads = BindingLoads(
        on=np.arange(counts[1]) < len(sign),
        place=filled(discrete.places[place], counts[1]),
        rows=filled(np.swapaxes(discrete.rows[:, place], 0, 1), counts[1]),
        sign=filled(sign, counts[1]),
        load=filled(load, counts[1]),
        axis=filled(axis, counts[1]),
    )
    place, device, zone = zones
    of_zones = BindingMargins(
        on=np.arange(counts[2]) < len(place),
        place=filled(discrete.places[place], counts[2]),
        row=filled(discrete.rows[0, place], counts[2]),
        device=filled(device, counts[2]),
        zone=filled(zone, counts[2]),
    )
    return (
        of_linear,
        of_loads,
        of_zones,
        np.concatenate([filled(*pair) for pair in zip(flat, counts, strict=True)]),
    )


def _windings(chart: Chart, attitudes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Whole turns added to the logarithm at each node."""
    eta = chart.coordinates(attitudes, places) - places[:, None] * chart.turn
    short = chart.departures(attitudes, places)[0]
    angles = np.linalg.norm(short, axis=1)
    along = np.sum(eta * short, axis=1) / np.where(angles > 0, angles, 1)
    return np.round((along - angles) / (2 * np.pi))


def next_rows(
    block: ConstraintBlock, binding: np.ndarray, multipliers: np.ndarray, least: float
) -> np.ndarray:
    """The next active set of a block: rows with multipliers of the wrong sign dropped, broken ones added.

    Of rows at places only the worst of each zone or load, since those beside it mean the same.
    """
    pulling = binding & (multipliers < least)
    slack = block.slack
    broken = ~binding & block.chosen(
        slack < -options.PROGRAM.broken * block.tolerance, slack, np.zeros(1, int)
    )
    if not block.linear:
        worst = np.arange(slack.shape[1]).reshape(-1, *[1] * (slack.ndim - 2))
        if np.any(pulling):
            return binding & ~(pulling & (worst == np.argmin(np.where(pulling, multipliers, 0), axis=1)))
        broken &= worst == np.argmin(np.where(broken, slack, np.inf), axis=1)
    return (binding & ~pulling) | broken


def independent(quadratic: program.QuadraticProgram, binding: Masks) -> Masks:
    """Multipliers of few of the rows that bind or touch, none of which follows from the others.

    They are those that push and hold the objective's gradient best.
    """
    from scipy.optimize import nnls

    blocks = {block.name: block for block in quadratic.blocks}
    touching = {
        name: np.nonzero(binding[name] | (f.slack < options.ACTIVE_SET.touching))
        for name, f in blocks.items()
    }
    free = quadratic.free[0]
    slopes = [blocks[name].slopes(index).full @ free for name, index in touching.items()]
    gradient = (free.T @ quadratic.gradient[0]).T
    every = np.concatenate([own.reshape(-1, gradient.size) for own in slopes])
    flat = np.zeros(len(every))
    if len(every):  # on none it crashes
        with suppress(RuntimeError):  # of too many iterations: then no row is taken to bind
            flat = nnls(every.T, -gradient.ravel())[0]
    found = {}
    for name, index in touching.items():
        found[name] = np.zeros(blocks[name].slack.shape)
        found[name][index], flat = flat[: len(index[0])], flat[len(index[0]) :]
    return found
