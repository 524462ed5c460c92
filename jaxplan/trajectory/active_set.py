"""The optimum near a spline fit, and which rows bind there.

A fit ends some thousandths of its energy or less above the optimum. From there steps of sequential quadratic
programming with the exact second derivatives (`optimality`) lead to it. A *row* is an inequality of the fit:
of a joint, a node in its tube, a load of the platform or a margin (`constraints`). Each step solves the
program of the rows that are *near* their bounds, so that the rows with positive multipliers are those that
bind, and none of them follows from the others. Rows that are broken after a step are near from then on. The
steps end where one changes next to nothing and no row is broken, at a minimum; a step aside leads away from a
saddle. Where steps do not settle, *careful* ones are taken: short ones that follow negative curvature
downwards.

What the optimum's derivatives keep fixed, above all the rows that bind, is an `ActiveSet`. A path has m + 1
nodes; other letters of sizes are those of `motion` and `binding`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np

from jaxplan.model.path import Path
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory import sqp
from jaxplan.trajectory.binding import ActiveSet, BindingLinear, BindingLoads, BindingMargins
from jaxplan.trajectory.constraints import SIGNS, ConstraintBlock, Index, LoadBlock
from jaxplan.trajectory.curve_attempts import Attempt, finished
from jaxplan.trajectory.derivative import gather_inputs
from jaxplan.trajectory.discretisation import DiscreteProblem
from jaxplan.trajectory.exact_qp import downward_way, least_change
from jaxplan.trajectory.motion import Iterates, Stack
from jaxplan.trajectory.node_times import FEWEST_NODES, TrapezoidalProfile, node_fractions, padded
from jaxplan.trajectory.optimality import curve_of, flat, linearised
from jaxplan.trajectory.problem import FitProblem, Mesh
from jaxplan.trajectory.splines import Basis, CurveSpace

_PADDING = (64, 16, 16)  # least padded numbers of rows: linear ones, of loads, of margins
_FTOL = 1e-9  # of the energy; so near the optimum, much nearer than a plan's fit, it shows which rows bind
_STEPS = 60  # most steps of this module, from where that ends to the optimum
_SETTLED = 1e-8  # rad; a step that changes less is the last
_REACH = 0.05  # rad; a careful step changes no unknown by more
_ASIDE = 1e-5  # rad; a step away from a saddle, from where further steps lead to a minimum near it
_BROKEN = 1e-8  # of a limit, or rad; a row that is broken by more is near
_FLANK_STEP = 1e-4  # of the pace's flank, step to either side of finite differences by it

Masks = dict[str, np.ndarray]  # by block of constraints, one number or bool for every row
Rows = dict[str, Index]  # indices of some rows of one curve by block, in the order of `ActiveSet`

_inputs = quick_jit(gather_inputs, level=0)  # higher levels would not be faster, as arrays are small


@shown()
@dataclass(frozen=True, kw_only=True, eq=False)
class FitRecord:
    """How a fit came about; its derivatives start from this record.

    Attributes:
        problem: what was fitted.
        attempt: how it ended.
        stretched: whether its time was stretched to the limits afterwards.
    """

    problem: FitProblem
    attempt: Attempt
    stretched: bool

    def hold(self, nodes: int = FEWEST_NODES, nearer: sqp.NearOptimum | None = None) -> ActiveSet:
        """Find the optimum near the fit, with the rows that bind and all else that derivatives hold fixed.

        Args:
            nodes: the smallest number to which the path's nodes are padded.
            nearer: the entry of `nearer_optima` for this record; None to compute it now.

        Raises:
            ValueError: if the fit is neither an optimum in a given time or without limits, nor a shortest
                motion from rest to rest, or if no optimum is found near it.
        """
        self._expect_an_optimum()
        state, at, multipliers = nearer_optima([self])[0] if nearer is None else nearer
        for careful in (False, True):
            held = self._settled(state, at, multipliers, nodes, careful=careful)
            if held is not None:
                return held
        raise ValueError(
            "which limits, zones and nodes bind cannot be told, as where one of them is about to: change "
            "trajectory.duration_s a little"
        )

    def _settled(
        self, state: sqp.SQPState, at: Iterates, multipliers: Masks, nodes: int, *, careful: bool
    ) -> ActiveSet | None:
        """Take steps until one changes next to nothing and no row is broken; None if they do not settle.

        Args:
            state: of the fit, alone in its stack.
            at: the curve to begin with.
            multipliers: of every row there.
            nodes: as in `hold`.
            careful: whether steps are short, and follow curvature downwards to the next row.
        """
        share, quadratic = float(state.share[0]), state.program(at, np.zeros(1))
        near = {name: own > 0 for name, own in multipliers.items()}
        length = np.inf
        for _ in range(_STEPS):
            broken = {block.name: _broken(block) & ~near[block.name] for block in quadratic.blocks}
            if length <= _SETTLED and not any(map(np.any, broken.values())):
                rows = _listed(quadratic.blocks, {name: own > 0 for name, own in multipliers.items()})
                held = self._held(at, rows, multipliers, share, nodes)
                by_flank = self._by_flank(rows)
                by_flank |= {name: by_flank[name] / share for name in by_flank if name == "energies"}
                return replace(held, by_flank=by_flank)
            near = {name: own | broken[name] for name, own in near.items()}
            rows = _listed(quadratic.blocks, near)
            coefficients, duration, pushes, length = self._step(
                self._held(at, rows, multipliers, share, nodes), careful=careful
            )
            if not np.isfinite(length):
                return None
            at = state.stack.iterates(coefficients[None], np.array([duration]), as_given=True)
            quadratic = state.program(at, np.zeros(1))
            multipliers = {name: np.zeros(own.shape) for name, own in near.items()}
            for name, index in rows.items():
                multipliers[name][0][index], pushes = np.split(pushes, [len(index[0])])
        return None

    @property
    def guess(self) -> sqp.InitialGuess:
        """The fit as the starting point of the search for a curve still nearer to the optimum."""
        discrete, solution = replace(self.attempt.discrete, to_the_end=True), self.attempt.solution
        return sqp.InitialGuess(
            discrete=discrete, coefficients=solution.coefficients, duration=solution.duration, ftol=_FTOL
        )

    def _expect_an_optimum(self) -> None:
        """Raise a ValueError for a fit that has no derivatives, see `hold`."""
        asked, discrete = self.problem.settings.duration, self.attempt.discrete
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

    def at_optimum(self) -> Attempt | None:
        """Make the attempt with the curve of the optimum; None if no optimum is found, see `hold`."""
        try:
            held = self.hold()
        except ValueError:
            return None
        discrete, duration = self.attempt.discrete, float(held.duration)
        coefficients = held.free @ held.x + discrete.space.fixed + duration * discrete.space.by_time
        at = Stack.of([discrete]).iterates(coefficients[None], np.array([duration]), as_given=True)
        return finished([(discrete, sqp.solution_at(at, 0, self.attempt.solution.steps))])[0]

    def _step(self, held: ActiveSet, *, careful: bool) -> tuple[np.ndarray, float, np.ndarray, float]:
        """Take a step of sequential quadratic programming from the curve of an active set, under its rows.

        `careful` is that of `_settled`.

        Returns:
            Coefficients (n, A) and duration (s) after it, multipliers of the rows that are not padding, and
            the largest change of an unknown, which is NaN where numbers overflow.
        """
        problem, asked = self.problem, self.problem.settings.duration
        path = Path(
            attitudes=padded(problem.attitudes, len(held.places)),
            joints=padded(problem.joints, len(held.places)),
            edge_costs=np.zeros(0),
        )
        settings = replace(problem.settings, duration=0.0 if isinstance(asked, str) else asked)
        z, size = flat(held), held.x.size
        on = np.concatenate([held.linear.on, held.loads.on, held.zones.on])
        rows, unknowns = size + np.flatnonzero(on), np.delete(np.arange(len(z)), np.s_[size : size + len(on)])
        with jax.enable_x64(True):
            held, inputs = _inputs(held, path, problem.spacecraft, settings, problem.cones, problem.rates)
            left, matrix = (np.asarray(array) for array in linearised(held, inputs, z))
            slopes = matrix[np.ix_(rows, unknowns)]
            change, pushes = np.full(len(unknowns), np.nan), np.zeros(len(rows))
            if np.all(np.isfinite(left)) and np.all(np.isfinite(matrix)):
                hessian, gradient = matrix[np.ix_(unknowns, unknowns)], left[unknowns] - slopes.T @ z[rows]
                change, pushes = least_change(
                    hessian, gradient, slopes, left[rows], z[rows] > 0, downwards=careful
                )
                if careful:
                    change *= min(1.0, _REACH / np.max(np.abs(change), initial=_REACH))
                if np.all(np.abs(change) <= _SETTLED):
                    way = downward_way(hessian, slopes[pushes > 0])
                    change = change if way is None else change + _ASIDE * way
            z[unknowns] += change
            coefficients, duration = (np.asarray(part) for part in curve_of(held, inputs, z))
        return coefficients, float(duration), pushes, float(np.max(np.abs(change)))

    @property
    def _flank(self) -> float:
        """Fraction of the duration that each flank of the trapezoidal pace along the path takes."""
        asked = self.problem.settings.duration
        profile = self.problem.quickest if isinstance(asked, str) else self.problem.pace_in(asked)
        return float(profile.flank_share)

    @property
    def _exact(self) -> bool:
        """Whether nodes are passed exactly, without a tube."""
        return self.attempt.radius == 0

    def _by_flank(self, rows: Rows) -> dict[str, np.ndarray]:
        """Derivatives, by the flank's fraction of the duration, of all that depends on the spline's breaks.

        Args:
            rows: those that bind.

        Returns:
            Arrays by the names of attributes of `ActiveSet`; empty where the breaks do not follow the flank.
        """
        exact = self._exact and self.attempt.discrete.mesh.pace == "rest to rest"
        if np.isnan(self.attempt.discrete.mesh.flank) and not exact:
            return {}
        here = self._flank
        step = _FLANK_STEP * here
        after, before = (self._on_mesh(self._at_flank(flank), rows) for flank in (here + step, here - step))
        return {name: (after[name] - before[name]) / (2 * step) for name in after}

    def _at_flank(self, flank: float) -> DiscreteProblem:
        """The problem on breaks for another fraction of the flank; nodes passed exactly move, too."""
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

    def _on_mesh(self, discrete: DiscreteProblem, rows: Rows) -> dict[str, np.ndarray]:
        """Everything in an active set that depends on a problem's breaks, by the names of its attributes."""
        linear, loads, zones = _gathered(discrete, self.attempt.discrete.mesh, rows)
        return {
            **_of_curves(discrete.space),
            "linear.rows": linear.rows,
            "loads.place": loads.place,
            "loads.rows": loads.rows,
            "zones.place": zones.place,
            "zones.row": zones.row,
        }

    def _widened(self) -> float:
        """Ratio of the tube radius that was used to the one asked for; 1 without a tube or if that is 0."""
        asked, kept = self.problem.width, self.attempt.radius
        return kept / asked if np.isfinite(kept) and asked > 0 else 1.0

    def _free(self, at: Iterates) -> np.ndarray:
        """Free coefficients ``x`` (k, A) of the first curve of `at`, k on each of A axes."""
        space = self.attempt.discrete.space
        start = space.fixed + at.duration[0] * space.by_time
        return np.linalg.lstsq(space.free, at.coefficients[0] - start, rcond=None)[0]

    @cached_property
    def _of_own_curves(self) -> dict[str, np.ndarray]:
        """The result of `_of_curves` for the curves of this fit."""
        return _of_curves(self.attempt.discrete.space)

    @cached_property
    def _windings(self) -> np.ndarray:
        """(m + 1,) whole turns by which the chart coordinates of each node exceed the shortest logarithm."""
        chart, places = self.attempt.discrete.chart, self.attempt.discrete.mesh.places
        nodes = self.problem.attitudes, self.problem.turns, places
        eta = chart.coordinates(*nodes) - places[:, None] * chart.turn
        short = chart.departures(*nodes)[0]
        angles = np.linalg.norm(short, axis=1)
        along = np.sum(eta * short, axis=1) / np.where(angles > 0, angles, 1)
        return np.asarray(np.round((along - angles) / (2 * np.pi)))

    def _held(self, at: Iterates, rows: Rows, multipliers: Masks, share: float, nodes: int) -> ActiveSet:
        """Make the active set of a curve.

        Args:
            at: the curve, alone in its stack.
            rows: the rows that are held as equalities.
            multipliers: of every row.
            share: energy of the first curve, by which energies are divided.
            nodes: the smallest number to which the path's nodes are padded.
        """
        problem, discrete = self.problem, self.attempt.discrete
        chart, of_curves = discrete.chart, self._of_own_curves
        inner = np.arange(1, len(problem.attitudes) - 1) if self._exact else np.zeros(0, int)
        mesh = discrete.mesh
        linear, loads, zones = _gathered(discrete, mesh, rows)
        on = np.concatenate([linear.on, loads.on, zones.on])
        pushes = np.zeros(len(on))
        pushes[on] = np.concatenate([multipliers[name][0][index] for name, index in rows.items()])
        return ActiveSet(
            **(of_curves | {"energies": of_curves["energies"] / share}),
            places=padded(mesh.places, nodes),
            flank=np.array(self._flank),
            least_length=np.array(problem.least_length),
            by_flank={},
            given=np.concatenate([[0, len(problem.attitudes) - 1], inner]),
            windings=padded(self._windings, nodes),
            long_way=np.array(float(np.linalg.norm(chart.turn) > np.pi)),
            share=np.array(discrete.share),
            widened=np.array(self._widened()),
            counted=np.isfinite(problem.end_margins),
            duration=np.array(at.duration[0]),
            linear=linear,
            loads=loads,
            zones=zones,
            x=self._free(at),
            multipliers=pushes,
            pace=self.attempt.discrete.mesh.pace,
            stretched=self.stretched and not discrete.free_time,
            free_time=discrete.free_time,
        )


def nearer_optima(records: Sequence[FitRecord]) -> list[sqp.NearOptimum]:
    """Improve fits together, until each is so near its optimum that it shows which rows bind."""
    return sqp.near_optima([record.guess for record in records])


def _of_curves(space: CurveSpace) -> dict[str, np.ndarray]:
    """Those attributes of `ActiveSet`, by name, that depend on the space of curves alone."""
    return {
        "free": space.free,
        "of_values": space.of_values,
        "of_rates": space.of_rates,
        "energies": space.energies[1:],
        "pieces": space.basis.pieces(np.eye(space.basis.size)),
        "breaks": space.basis.breaks,
    }


def _listed(blocks: Iterable[ConstraintBlock], wanted: Masks) -> Rows:
    """Indices of the wanted rows, by block, of the first curve.

    They are in the order of `ActiveSet`: joints' rates and accelerations, ranges, tube; then loads; then
    zones.
    """
    named = {block.name: block for block in blocks}
    joints = [name for name, block in named.items() if block.linear and block.power]
    loads = [name for name, block in named.items() if isinstance(block, LoadBlock)]
    names = (*joints, "range", "tube", *loads, "zone")
    return {name: np.nonzero(wanted[name][0]) for name in names if name in named}


def _gathered(
    discrete: DiscreteProblem, mesh: Mesh, rows: Rows
) -> tuple[BindingLinear, BindingLoads, BindingMargins]:
    """Collect rows in the form in which `ActiveSet` has them, padded to a few sizes.

    Args:
        discrete: the problem whose places and splines they are written in.
        mesh: gives the places of nodes in a tube.
        rows: indices of the rows by block.
    """
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
    loads = [(none, np.zeros(0), none)]
    components = dict(zip(problem.names, problem.components, strict=True))
    place, device, zone = rows.get("zone", (none, none, none))
    for name, index in rows.items():
        if name in steady:
            sign, row, axis = index
            of_nodes = name == "tube"
            node = row + 1 if of_nodes else np.full(len(row), -1)
            scale = list(steady).index(name) * joints + axis
            linear.append((steady[name][row], SIGNS[sign], axis + (0 if of_nodes else 3), node, scale))
        elif name != "zone":
            at, sign, axis = index
            loads.append((at, SIGNS[sign], components[name].start + axis))
    row, sign, axis, node, scale = (np.concatenate(parts) for parts in zip(*linear, strict=True))
    at, load_sign, component = (np.concatenate(parts) for parts in zip(*loads, strict=True))
    # There is padding even where no row binds, so that the active sets of several plans can be stacked.
    sizes = [
        padded_count(max(len(own), 1), count) for own, count in zip((row, at, place), _PADDING, strict=True)
    ]
    if not len(at):
        sizes[1] = 0  # loads seldom bind, and their slopes take long to compute
    if not len(problem.cones.axis):
        sizes[2] = 0
    return (
        BindingLinear(**_filled(sizes[0], rows=row, sign=sign, axis=axis, node=node, scale=scale)),
        BindingLoads(
            **_filled(
                sizes[1],
                place=discrete.places[at],
                rows=np.swapaxes(discrete.rows[:, at], 0, 1),
                sign=load_sign,
                component=component,
            )
        ),
        BindingMargins(
            **_filled(
                sizes[2],
                place=discrete.places[place],
                row=discrete.rows[0, place],
                device=device,
                zone=zone,
            )
        ),
    )


def _filled(size: int, **arrays: np.ndarray) -> dict[str, np.ndarray]:
    """Pad arrays (k, ...) with zeros to (size, ...), by name, and add "on" (size,), False for padding."""
    found = {}
    for name, own in arrays.items():
        found[name] = np.concatenate([own, np.zeros((size - len(own), *own.shape[1:]), own.dtype)])
        found["on"] = np.arange(size) < len(own)
    return found


def _broken(block: ConstraintBlock) -> np.ndarray:
    """Bool array like the slack of a block, true for broken rows; of neighbouring places only the worst."""
    slack = block.slack
    broken: np.ndarray = slack < -_BROKEN
    if not block.linear:
        around = np.pad(slack, [(0, 0), (1, 1), *[(0, 0)] * (slack.ndim - 2)], constant_values=np.inf)
        broken &= (slack <= around[:, :-2]) & (slack <= around[:, 2:])
    return broken
