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
from jaxplan.trajectory.constraints import (
    SIGNS,
    ConstraintBlock,
    Index,
    JointDerivativeBlock,
    LoadBlock,
)
from jaxplan.trajectory.derivative import gather_inputs
from jaxplan.trajectory.iterates import Iterates, Stack
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
from jaxplan.trajectory.problem import DiscreteProblem, FitProblem, Mesh, end_margins, on_mesh
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
        stack = Stack.of([discrete])  # of one
        at = stack.iterates(solution.coefficients[None], np.array([solution.duration]))
        objective = sqp.Objective(stack, at)
        penalty = sqp.penalties(discrete.free_time)[None]
        quadratic = objective.program(at, np.zeros(1), penalty)
        rows = {block.name: block for block in quadratic.blocks}
        proposal = program.solve(quadratic, {})
        multipliers = proposal.multipliers
        if discrete.free_time:  # limits by coefficients ask for more time than those at the places
            at = stack.iterates(at.coefficients, at.duration * (1 + proposal.stretch), as_given=True)
        share = float(objective.share[0])
        near = {name: (own > 0) | _broken(rows[name]) for name, own in multipliers.items()}
        for _ in range(options.ACTIVE_SET.looks):
            held = self._held(at, rows, near, multipliers, share)
            ahead, pushes = self._step(held)
            pushing = _named(rows, near, held, pushes)
            binding = {name: own > 0 for name, own in pushing.items()}
            root = self._root(self._held(at, rows, binding, pushing, share))
            if root is not None:
                coefficients, found, duration = root
                there = stack.iterates(coefficients[None], np.array([duration]), as_given=True)
                blocks = {block.name: block for block in objective.program(there, np.zeros(1), penalty).blocks}
                broken = {name: _broken(block) & ~binding[name] for name, block in blocks.items()}
                wrong = np.min(found, initial=0.0) < -options.ACTIVE_SET.wrong_sign * np.max(found, initial=1.0)
                if not wrong and not any(map(np.any, broken.values())):
                    held = self._held(there, blocks, binding, pushing, share)
                    held = replace(held, multipliers=found)
                    by_flank = self._by_flank(blocks, binding)
                    by_flank |= {name: by_flank[name] / share for name in by_flank if name == "energies"}
                    return replace(held, by_flank=by_flank)
                near = {name: own | broken[name] for name, own in near.items()}
            multipliers = pushing
            at = stack.iterates(ahead[0][None], np.array([ahead[1]]), as_given=True)
            rows = {block.name: block for block in objective.program(at, np.zeros(1), penalty).blocks}
            near = {name: own | _broken(rows[name]) for name, own in near.items()}
        raise ValueError(
            "which limits, zones and nodes bind cannot be told, as where one of them is about to: change "
            "trajectory.duration_s a little"
        )

    def _step(self, held: ActiveSet) -> tuple[tuple[np.ndarray, float], np.ndarray]:
        """Coefficients and duration after a step, and multipliers of the rows that are near."""
        on = np.flatnonzero(np.concatenate([held.linear.on, held.loads.on, held.zones.on]))
        size = held.x.size
        z = flat(held)
        with jax.enable_x64(True):
            own, inputs = self._inputs(held)
            left, matrix = (np.asarray(array) for array in linearised(own, inputs, z))
            primal = np.concatenate([np.arange(size), np.arange(size + len(held.multipliers), len(z))])
            slopes = matrix[np.ix_(size + on, primal)]
            gradient = left[primal] - slopes.T @ z[size + on]
            step, pushes = solve_exactly(matrix[np.ix_(primal, primal)], gradient, slopes, left[size + on])
            z[primal] += step
            coefficients, duration = (np.asarray(part) for part in curve_of(own, inputs, z))
        multipliers = np.zeros(len(held.multipliers))
        multipliers[on] = pushes
        return (coefficients, float(duration)), multipliers

    def _inputs(self, held: ActiveSet):
        problem = self.problem
        path = Path(
            attitudes=padded(problem.attitudes, FEWEST_NODES),
            joints=padded(problem.joints, FEWEST_NODES),
            edge_costs=np.zeros(0),
        )
        asked = problem.settings.duration
        settings = replace(problem.settings, duration=0.0 if isinstance(asked, str) else asked)
        return _inputs(held, path, problem.spacecraft, settings, problem.cones, problem.rates)

    def _root(self, held: ActiveSet) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Coefficients, multipliers and duration where ``F`` is zero, by Newton's method, or None."""
        z = flat(held)
        with jax.enable_x64(True):
            held, inputs = self._inputs(held)
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
        profile, asked = self.problem.quickest(), self.problem.settings.duration
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
        if np.isnan(self.attempt.request.mesh.flank) and not exact:
            return {}
        here = self._flank
        step = options.ACTIVE_SET.flank_step * here
        after, before = (
            self._on_mesh(self._at_flank(flank), rows, binding) for flank in (here + step, here - step)
        )
        return {name: (after[name] - before[name]) / (2 * step) for name in after}

    def _at_flank(self, flank: float) -> DiscreteProblem:
        """The problem on the breaks of another pace, at whose places nodes are that are passed exactly."""
        problem, discrete, mesh = self.problem, self.attempt.discrete, self.attempt.request.mesh
        profile = TrapezoidalProfile(length=0.0, duration=1.0, flank=flank)
        intervals, nodes = len(mesh.basis.breaks) - 1, len(mesh.places)
        places = mesh.places
        if self._exact:
            places = profile.places(node_fractions(problem.times))
            breaks = np.interp(np.linspace(0, nodes - 1, intervals + 1), np.arange(nodes), places)
        else:
            breaks = profile.breaks(intervals)
        return on_mesh(problem, discrete, replace(mesh, basis=Basis.on(breaks), places=places))

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
        linear, loads, zones, _ = _gathered(discrete, self.attempt.request.mesh, rows, binding, none)
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
        rows: Blocks,
        binding: Masks,
        multipliers: Masks,
        share: float,
    ) -> ActiveSet:
        """All that is held with some rows that bind; their multipliers, and the curve, are to begin with."""
        problem, discrete = self.problem, self.attempt.discrete
        space, system = discrete.space, discrete.system
        inner = np.arange(1, len(problem.attitudes) - 1) if self._exact else np.zeros(0, int)
        mesh = self.attempt.request.mesh
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
            windings=padded(_windings(system.chart, problem.attitudes, mesh.places), FEWEST_NODES),
            long_way=np.array(float(np.linalg.norm(system.chart.turn) > np.pi)),
            share=np.array(system.share),
            widened=np.array(self._widened()),
            counted=np.isfinite(end_margins(system, problem.attitudes, problem.joints)),
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
    joints = [name for name, block in blocks.items() if isinstance(block, JointDerivativeBlock)]
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
    system, basis = discrete.system, discrete.space.basis
    joints = discrete.space.fixed.shape[1] - 3
    quantities = [limit.quantity for limit in system.joint_limits]
    matrices = {quantity.name: basis.differences[quantity.power] for quantity in quantities}
    matrices["range"] = np.eye(basis.size)
    steady = {name: np.pad(own[:, None], ((0, 0), (0, 3), (0, 0))) for name, own in matrices.items()}
    if discrete.tube is not None:
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


def _windings(chart: Chart, attitudes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Whole turns added to the logarithm at each node."""
    eta = chart.coordinates(attitudes, places) - places[:, None] * chart.turn
    short = chart.departures(attitudes, places)[0]
    angles = np.linalg.norm(short, axis=1)
    along = np.sum(eta * short, axis=1) / np.where(angles > 0, angles, 1)
    return np.round((along - angles) / (2 * np.pi))


def _broken(block: ConstraintBlock) -> np.ndarray:
    """The rows of one curve that are broken; of those at places next to each other the worst."""
    slack = block.slack
    broken: np.ndarray = slack < -options.ACTIVE_SET.broken
    if not block.linear:
        least = np.pad(slack, [(0, 0), (1, 1), *[(0, 0)] * (slack.ndim - 2)], constant_values=np.inf)
        with np.errstate(invalid="ignore"):
            broken &= (slack <= least[:, :-2]) & (slack <= least[:, 2:])
    return broken


def solve_exactly(
    hessian: np.ndarray, gradient: np.ndarray, slopes: np.ndarray, excess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The step of least ``d^T H d / 2 + g^T d`` with ``G d + e <= 0``, and its rows' multipliers.

    None of the rows that push follows from the others. A Hessian that is not positive is made so.
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    try:
        factor = np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(hessian)
        values = np.maximum(np.abs(values), 1e-6 * np.max(np.abs(values)))
        factor = np.linalg.cholesky((vectors * values) @ vectors.T)
    towards = solve_triangular(factor, slopes.T, lower=True)  # in the unknowns u = L^T d + L^-1 g
    down = solve_triangular(factor, gradient, lower=True)
    rest = excess - towards.T @ down
    aim = np.zeros(len(down) + 1)
    aim[-1] = 1.0
    pushes = np.zeros(len(excess))
    if len(pushes):
        scale = max(1.0, float(np.linalg.norm(down)))
        try:
            found, left = nnls(np.vstack([-towards, rest / scale]), aim)
            print('   nnls', len(pushes), (found>0).sum(), left)
            short = 1 - rest / scale @ found
            pushes = scale * found / short
        except RuntimeError:
            pass
    step = solve_triangular(factor, -towards @ pushes - down, lower=True, trans=1)
    return step, pushes


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
