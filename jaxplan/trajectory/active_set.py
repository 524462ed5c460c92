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

from jaxplan.model.path import Path
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory import options, program, sqp
from jaxplan.trajectory.attempts import Attempt
from jaxplan.trajectory.chart import Chart
from jaxplan.trajectory.constraints import SIGNS, ConstraintBlock, Index, LoadBlock
from jaxplan.trajectory.derivative import gather_inputs
from jaxplan.trajectory.motion import Iterates
from jaxplan.trajectory.optimality import (
    ActiveSet,
    BindingLinear,
    BindingLoads,
    BindingMargins,
    curve_of,
    filled,
    flat,
    linearised,
)
from jaxplan.trajectory.problem import DiscreteProblem, FitProblem, Mesh
from jaxplan.trajectory.schedule import FEWEST_NODES, TrapezoidalProfile, node_fractions, padded
from jaxplan.trajectory.splines import Basis

Masks = dict[str, np.ndarray]  # by block of constraints, of every row
Blocks = dict[str, ConstraintBlock]  # by name

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
            ValueError: if it is not an optimum in a given time, without limits, or of a shortest motion from
                rest to rest, or if no set of rows is found that binds there, as where one is about to.
        """
        discrete, solution = self.attempt.discrete, self.attempt.solution
        asked = self.problem.settings.duration
        if not isinstance(asked, str) and (discrete.free_time or not discrete.limited):
            raise ValueError(
                f"for a duration of {asked:g} s a quicker motion was slowed, which has no derivatives: try "
                "another trajectory.duration_s, above all a longer one"
            )
        if isinstance(asked, str) and not self.stretched:
            raise ValueError(
                "a shortest motion with rates at its ends has no derivatives: set trajectory.duration_s to a "
                "number"
            )
        first = sqp.InitialGuess(
            discrete=discrete,
            coefficients=solution.coefficients,
            duration=solution.duration,
            ftol=options.ACTIVE_SET.ftol,
        )
        (solution,) = sqp.improve([first])
        first = replace(first, coefficients=solution.coefficients, duration=solution.duration)
        state = sqp.SQPState.of([first])  # of one
        stack, at = state.stack, state.at
        quadratic = state.program(at, np.zeros(1))
        rows = {block.name: block for block in quadratic.blocks}
        proposal = program.solve(quadratic, {})
        multipliers = proposal.multipliers
        if discrete.free_time:  # limits by coefficients ask for more time than those at the places
            at = stack.iterates(at.coefficients, at.duration * (1 + proposal.stretch), as_given=True)
        binding = {name: own > 0 for name, own in multipliers.items()}
        crowded, share = False, float(state.share[0])
        for _ in range(options.ACTIVE_SET.looks):
            held = self._held(at, rows, binding, multipliers, share)
            root = self._root(held)
            if root is not None:
                coefficients, found, duration = root
                at = stack.iterates(coefficients[None], np.array([duration]), as_given=True)
                quadratic = state.program(at, np.zeros(1))
                rows = {block.name: block for block in quadratic.blocks}
                multipliers = _named(rows, binding, held, found)
                least = -options.ACTIVE_SET.wrong_sign * np.max(found, initial=1.0)
                after = {
                    name: next_rows(rows[name], own, multipliers[name], least)
                    for name, own in binding.items()
                }
                if all(np.array_equal(after[name], own) for name, own in binding.items()):
                    held = replace(held, x=self._free(at), multipliers=found, duration=at.duration[0])
                    by_flank = self._by_flank(rows, binding)
                    by_flank |= {name: by_flank[name] / share for name in by_flank if name == "energies"}
                    return replace(held, by_flank=by_flank)
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

    def _root(self, held: ActiveSet) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Coefficients, multipliers and duration where ``F`` is zero, by Newton's method, or None."""
        problem = self.problem
        path = Path(
            attitudes=padded(problem.attitudes, FEWEST_NODES),
            joints=padded(problem.joints, FEWEST_NODES),
            edge_costs=np.zeros(0),
        )
        asked = problem.settings.duration
        settings = replace(problem.settings, duration=0.0 if isinstance(asked, str) else asked)
        z = flat(held)
        with jax.enable_x64(True):
            held, inputs = _inputs(held, path, problem.spacecraft, settings, problem.cones, problem.rates)
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
            coefficients, duration = (np.asarray(part) for part in curve_of(held, inputs, best))
        return coefficients, best[held.x.size :][: len(held.multipliers)], float(duration)

    @property
    def _flank(self) -> float:
        """Share of the duration that a flank of the pace along the path takes."""
        profile, asked = self.problem.quickest, self.problem.settings.duration
        if not isinstance(asked, str):
            profile = TrapezoidalProfile.within(asked, profile.length, self.problem.rise)
        return float(profile.flank_share)

    @property
    def _exact(self) -> bool:
        """Whether nodes are passed exactly."""
        return self.attempt.radius == 0

    def _by_flank(self, rows: Blocks, binding: Masks) -> dict[str, np.ndarray]:
        """Derivatives by the flank's share of the duration of all that lies on breaks which follow it."""
        exact = self._exact and self._pace == "paced"
        if np.isnan(self.attempt.discrete.mesh.flank) and not exact:
            return {}
        here = self._flank
        step = options.ACTIVE_SET.flank_step * here
        after, before = (
            self._on_mesh(self._at_flank(flank), rows, binding) for flank in (here + step, here - step)
        )
        return {name: (after[name] - before[name]) / (2 * step) for name in after}

    def _at_flank(self, flank: float) -> DiscreteProblem:
        """The problem on the breaks of another pace, at whose places nodes are that are passed exactly."""
        problem, discrete, mesh = self.problem, self.attempt.discrete, self.attempt.discrete.mesh
        profile = TrapezoidalProfile(length=0.0, duration=1.0, flank=flank)
        intervals, nodes = len(mesh.basis.breaks) - 1, len(mesh.places)
        places = mesh.places
        if self._exact:
            places = profile.places(node_fractions(problem.times))
            breaks = np.interp(np.linspace(0, nodes - 1, intervals + 1), np.arange(nodes), places)
        else:
            breaks = profile.breaks(intervals)
        return discrete.on_mesh(replace(mesh, basis=Basis.on(breaks), places=places))

    @property
    def _pace(self) -> str:
        """What says when nodes are passed, as `ActiveSet` has it."""
        if self.problem.fractions is not None:
            return "given"
        return "steady" if self.problem.at_speed else "paced"

    def _on_mesh(self, discrete: DiscreteProblem, rows: Blocks, binding: Masks) -> dict[str, np.ndarray]:
        """What lies on the breaks, by the names of the attributes of what is held."""
        space = discrete.space
        none = {name: np.zeros(block.slack.shape) for name, block in rows.items()}
        linear, loads, zones, _ = _gathered(discrete, self.attempt.discrete.mesh, rows, binding, none)
        return {
            "free": space.free,
            "of_values": space.of_values,
            "of_rates": space.of_rates,
            "energies": space.energies[1:],
            "pieces": space.basis.pieces(np.eye(space.basis.size)),
            "breaks": space.basis.breaks,
            "linear.rows": linear.rows,
            "loads.place": loads.place,
            "loads.rows": loads.rows,
            "zones.place": zones.place,
            "zones.row": zones.row,
        }

    def _widened(self) -> float:
        """Ratio of the tube radius that was used to the one asked for; 1 without a tube, or a width."""
        asked, kept = self.problem.width, self.attempt.radius
        return kept / asked if np.isfinite(kept) and asked > 0 else 1.0

    def _free(self, at: Iterates) -> np.ndarray:
        """Free coefficients ``x`` (k, A) of a curve."""
        space = self.attempt.discrete.space
        start = space.fixed + at.duration[0] * space.by_time
        return np.linalg.lstsq(space.free, at.coefficients[0] - start, rcond=None)[0]

    def _held(
        self,
        at: Iterates,
        rows: Blocks,
        binding: Masks,
        multipliers: Masks,
        share: float,
    ) -> ActiveSet:
        """All that is held with some rows that bind; their multipliers, and the curve, are to begin with."""
        problem, discrete = self.problem, self.attempt.discrete
        space, chart = discrete.space, discrete.chart
        inner = np.arange(1, len(problem.attitudes) - 1) if self._exact else np.zeros(0, int)
        mesh = self.attempt.discrete.mesh
        linear, loads, zones, multipliers_of = _gathered(discrete, mesh, rows, binding, multipliers)
        return ActiveSet(
            free=space.free,
            of_values=space.of_values,
            of_rates=space.of_rates,
            energies=space.energies[1:] / share,
            pieces=space.basis.pieces(np.eye(space.basis.size)),
            breaks=space.basis.breaks,
            places=padded(mesh.places, FEWEST_NODES),
            flank=np.array(self._flank),
            least_length=np.array(problem.least_length),
            by_flank={},
            given=np.concatenate([[0, len(problem.attitudes) - 1], inner]),
            windings=padded(_windings(chart, problem, mesh.places), FEWEST_NODES),
            long_way=np.array(float(np.linalg.norm(chart.turn) > np.pi)),
            share=np.array(discrete.share),
            widened=np.array(self._widened()),
            counted=np.isfinite(problem.end_margins),
            duration=np.array(at.duration[0]),
            linear=linear,
            loads=loads,
            zones=zones,
            x=self._free(at),
            multipliers=multipliers_of,
            pace=self._pace,
            stretched=self.stretched and not discrete.free_time,
            free_time=discrete.free_time,
        )


def _order(blocks: Blocks, binding: Masks) -> list[tuple[str, Index]]:
    """The rows that bind, in the order of `Held`: of joints and nodes, of loads, of zones."""
    joints = [name for name, block in blocks.items() if block.linear and block.power]
    loads = [name for name, block in blocks.items() if isinstance(block, LoadBlock)]
    names = (*joints, "range", "tube", *loads, "zone")
    found = {name: np.nonzero(binding[name]) for name in names if name in blocks}
    return [(name, index[1:]) for name, index in found.items()]  # of the one curve


def _named(blocks: Blocks, binding: Masks, held: ActiveSet, multipliers: np.ndarray) -> Masks:
    """Multipliers of all rows by block."""
    on = np.concatenate([held.linear.on, held.loads.on, held.zones.on])
    flat = multipliers[on]
    found = {name: np.zeros(block.slack.shape) for name, block in blocks.items()}
    for name, index in _order(blocks, binding):
        count = len(index[0])
        found[name][0][index], flat = flat[:count], flat[count:]
    return found


def _gathered(
    discrete: DiscreteProblem, mesh: Mesh, blocks: Blocks, binding: Masks, given: Masks
) -> tuple[BindingLinear, BindingLoads, BindingMargins, np.ndarray]:
    """The rows that bind, padded, with their multipliers in the same order."""
    problem, basis = discrete.problem, discrete.space.basis
    joints = discrete.space.fixed.shape[1] - 3
    quantities = [limit.quantity for limit in problem.joint_limits]
    matrices = {quantity.name: basis.differences[quantity.power] for quantity in quantities}
    matrices["range"] = np.eye(basis.size)
    steady = {name: np.pad(own[:, None], ((0, 0), (0, 3), (0, 0))) for name, own in matrices.items()}
    if len(discrete.tube_rows):
        steady["tube"] = np.swapaxes(basis.rows(mesh.places[1:-1]), 0, 1)
    none = np.zeros(0, int)
    linear = [(np.zeros((0, 4, basis.size)), np.zeros(0), none, none, none)]
    loads = [(none, np.zeros(0), none, none)]
    zones: Index = (none, none, none)
    multipliers: list[list[np.ndarray]] = [[np.zeros(0)] for _ in range(3)]
    for name, index in _order(blocks, binding):
        if name in steady:
            sign, row, axis = index
            of_nodes = name == "tube"
            first = 0 if of_nodes else 3
            node = row + 1 if of_nodes else np.full(len(row), -1)
            scale = list(steady).index(name) * joints + axis
            linear.append((steady[name][row], SIGNS[sign], axis + first, node, scale))
            multipliers[0].append(given[name][0][index])
        elif name == "zone":
            zones = index
            multipliers[2].append(given[name][0][index])
        else:
            place, sign, axis = index
            loads.append((place, SIGNS[sign], np.full(len(place), problem.names.index(name)), axis))
            multipliers[1].append(given[name][0][index])
    flat = [np.concatenate(own) for own in multipliers]
    # Where none binds there is padding, too, so that what is held of several plans can be stacked.
    least = options.ACTIVE_SET.padding
    counts = [padded_count(max(len(own), 1), size) for own, size in zip(flat, least, strict=True)]
    if not len(flat[1]):
        counts[1] = 0  # loads are seldom near, and their slopes are dear
    if not len(problem.cones.axis):
        counts[2] = 0
    row, sign, axis, node, scale = (np.concatenate(parts) for parts in zip(*linear, strict=True))
    of_linear = BindingLinear(
        on=np.arange(counts[0]) < len(sign),
        rows=filled(row, counts[0]),
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


def _windings(chart: Chart, problem: FitProblem, places: np.ndarray) -> np.ndarray:
    """Whole turns added to the logarithm at each node."""
    nodes = problem.attitudes, problem.turns, places
    eta = chart.coordinates(*nodes) - places[:, None] * chart.turn
    short = chart.departures(*nodes)[0]
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
    slopes = []
    for name, index in touching.items():
        axes, basis = blocks[name].slopes(index)
        slopes.append(np.swapaxes(axes, 1, 2) @ basis @ free)
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
