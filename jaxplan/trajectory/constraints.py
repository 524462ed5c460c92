"""Constraints of the spline fit as blocks of linear rows near curves: joints, tubes, loads and margins.

The G curves of a stack are handled together, each with its own rows; letters of sizes are those of `motion`.
A *row* is the inequality ``slopes . dc + time * dT / T <= slack`` for a change ``dc`` of the coefficients and
``dT`` of the duration; its *slack*, what is left to the bound, is negative if it is broken. A block holds the
slack of all its rows and how a step changes it, and writes out only the R rows that a program asks for. The
derivatives of a row in the coefficients (n, A) are a product of a row of the axes and one of the basis, or a
sum of P such products: slopes are pairs of arrays (R, P, A) and (R, P, n).

Rows of joints by the coefficients, and of nodes in a tube, are exact for every step. All values of a spline
lie between the least and the largest of its coefficients, and those of a derivative likewise, so what holds
for the coefficients holds at every instant. Rows of the platform's loads and of margins are linearised at
places close to each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.geometry.vectors import cross, dot
from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT
from jaxplan.trajectory.motion import LIMIT, TUBE, ZONE, Iterates, load_slopes, stacked, taken

_NEAR_BOUND_SHARE = 0.15  # of a limit or tube radius; rows with less slack are in a program from the start
_NEAR_BOUND_ANGLE = float(np.deg2rad(1.0))  # rad; the same for slacks that are angles
_OUT_OF_REACH_SHARE = 0.5  # of a limit; if slack is larger at every place, a step is assumed not to reach it
_PLACE_STRIDE = 4  # every so many places rows enter a program, besides those of locally least slack
_MIN_SINE = 1e-6  # least sine of the angle to a row's axis that is divided by; at 0 there is no slope

SIGNS = np.array([1.0, -1.0])  # of the two rows of a bound on both sides

Index = tuple[np.ndarray, ...]  # indices (R,) of rows along each axis of a slack, the curve's first
Slopes = tuple[np.ndarray, np.ndarray]  # (R, P, A) of the axes and (R, P, n) of the basis


def numbers(chosen: np.ndarray) -> Index:
    """Indices of the true entries of a bool array, like `np.nonzero` but much faster where they are few."""
    return np.unravel_index(np.flatnonzero(chosen), chosen.shape)


def lowest(slack: np.ndarray) -> np.ndarray:
    """Bool array like `slack`, true where it is no larger than its neighbours on the second to last axis."""
    kept = np.ones(slack.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        down = slack[..., 1:, :] <= slack[..., :-1, :]
        up = slack[..., :-1, :] <= slack[..., 1:, :]
    kept[..., 1:, :] &= down
    kept[..., :-1, :] &= up
    return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearBlock:
    """Rows ``|matrix . c - centre| scale <= bound`` of some axes, (G, 2, r, a) with both signs.

    They are those of rates, accelerations and angles of the joints, and of nodes in a tube. Slacks are
    fractions of the bound or, for angles, in rad. Here r counts the rows of the matrix, a the axes concerned.

    Attributes:
        name: unique among the blocks of a fit.
        kind: `LIMIT` or `TUBE`.
        power: the power of 1 / duration to which the values are proportional.
        tolerance: rows with less slack are in a program from the start.
        coefficients: (G, n, A) ``c``.
        matrix: (G, r, n) from coefficients to values, such as derivatives.
        scale: (G, a), of the last a of the A axes.
        centre: (G, r, a), in the unit of the values.
        bound: (G, 1, 1, a).
    """

    name: str
    kind: int = LIMIT
    power: int = 0
    tolerance: float = 2 * _NEAR_BOUND_SHARE
    coefficients: np.ndarray
    matrix: np.ndarray
    scale: np.ndarray
    centre: np.ndarray | float = 0.0
    bound: np.ndarray | float = 1.0
    linear = True

    @property
    def _from_axis(self) -> int:
        """Index of the first axis that the rows concern; they concern all axes from there on."""
        return self.coefficients.shape[2] - self.scale.shape[1]

    @cached_property
    def slack(self) -> np.ndarray:
        """What is left to the bound, negative if broken: (G, 2, r, a) for curves, signs, rows and axes."""
        value = (self.matrix @ self.coefficients[:, :, self._from_axis :] - self.centre) * self.scale[:, None]
        return self.bound - np.stack([value, -value], axis=1)

    @property
    def may_bind(self) -> np.ndarray:
        """(G,) bool for each curve, whether a step may break any of its rows: always true."""
        return np.ones(len(self.coefficients), dtype=bool)

    def time(self, index: Index) -> np.ndarray:
        """Derivative in the logarithm of the duration of each of the R indexed rows' values."""
        return np.full(len(index[0]), -float(self.power))

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """Slack gained by relative changes `stretch` (g,) of the durations of the curves `which` (g,)."""
        return (self.power * stretch).reshape(-1, *[1] * (self.slack.ndim - 1))

    def change(self, which: np.ndarray, coefficients: np.ndarray, _: np.ndarray) -> np.ndarray:
        """How much slack each row of some curves loses by a step at an unchanged duration, (g, 2, r, a).

        Args:
            which: (g,) numbers of the curves.
            coefficients: (g, n, A) their changes.
            _: (g, 4, S, A) changes of the curves and of their derivatives at the places; not used here.
        """
        matrix, scale = taken(self.matrix, which), self.scale[which][:, None]
        value = matrix @ coefficients[:, :, self._from_axis :] * scale
        return np.stack([value, -value], axis=1)

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the indexed rows in the coefficients, as a pair of arrays (see the module)."""
        curve, sign, row, axis = index
        axes = np.zeros((len(axis), 1, self.coefficients.shape[2]))
        axes[np.arange(len(axis)), 0, self._from_axis + axis] = SIGNS[sign] * self.scale[curve, axis]
        return axes, self.matrix[curve, row][:, None]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Select the rows to take among those `wanted` of some curves, given their slack: here all."""
        return wanted


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadBlock:
    """One of the platform's loads at the places, as fractions of its limit: rows (G, S, 2, c), of both signs.

    Rows are linearised at the curve. For the length of a vector, which is convex, a step may exceed the limit
    to second order, by turning the vector; the next program corrects that.

    Attributes:
        name: of the load.
        power: the power of 1 / duration to which it is proportional.
        own: slice of its c components among those of all loads.
        at: the curves.
        scale: (G, c) 1 / (limit * duration^power).
        lesser: the slice of its lesser parts, which fall by one power less, among all loads, and the scale
            (G, c) that they have beyond `scale`, by which they count as part of the whole already; None
            without.
    """

    name: str
    power: int
    own: slice
    at: Iterates
    scale: np.ndarray
    lesser: tuple[slice, np.ndarray] | None = None
    kind = LIMIT
    tolerance = _NEAR_BOUND_SHARE
    linear = False

    @cached_property
    def slack(self) -> np.ndarray:
        """Fraction of each limit that is left: (G, S, 2, c) for curves, places, signs and components."""
        shares = self.at.loads[:, :, self.own] * self.scale[:, None]
        if self.lesser is not None:
            part, scale = self.lesser
            shares = shares + self.at.loads[:, :, part] * scale[:, None]
        stack = self.at.stack
        between = stack.members[0].hastens and self.lesser is None  # as in `Stack.needed_durations`
        return 1 - stack.with_peaks(SIGNS[:, None] * shares[:, :, None], between)

    @cached_property
    def _decay_exponents(self) -> np.ndarray | None:
        """How fast fractions of the limit fall with the logarithm of the duration, shaped like `slack`.

        None if for all rows this is `power`. Otherwise it is that of rows at their bound, or of
        ``a + b T <= limit T^p`` with the duration ``T``: so, as for a power alone, what a curve changes of a
        row does not depend on what the duration does.
        """
        if self.lesser is None:
            return None
        part, scale = self.lesser
        slow = self.at.loads[:, :, part] * (scale + self.scale)[:, None]
        return self.power - SIGNS[:, None] * slow[:, :, None]

    def time(self, index: Index) -> np.ndarray:
        """See `LinearBlock.time`."""
        if self._decay_exponents is None:
            return np.full(len(index[0]), -float(self.power))
        return np.asarray(-self._decay_exponents[index])

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """See `LinearBlock.relief`."""
        if self._decay_exponents is None:
            return (self.power * stretch).reshape(-1, 1, 1, 1)
        return np.asarray(taken(self._decay_exponents, which) * stretch[:, None, None, None])

    @cached_property
    def may_bind(self) -> np.ndarray:
        """(G,) bool for each curve, whether a step may reach a bound: unless all its slacks are large."""
        return ~np.all(self.slack > _OUT_OF_REACH_SHARE, axis=(1, 2, 3))

    @cached_property
    def _slope_cache(self) -> dict[int, np.ndarray]:
        """Results of `_local_slopes` by number of the curve."""
        return {}

    def _local_slopes(self, curve: int) -> np.ndarray:
        """Derivatives of a curve's load over its limit, (S, c, 4, B): place, component, derivative, axis."""
        known = self._slope_cache.get(curve)
        if known is not None:
            return known
        slopes = load_slopes(self.at, curve)
        found = slopes[:, self.own] * self.scale[curve, :, None, None]
        if self.lesser is not None:
            part, scale = self.lesser
            found = found + slopes[:, part] * scale[curve, :, None, None]
        self._slope_cache[curve] = found
        return found

    def change(self, which: np.ndarray, _: np.ndarray, curves: np.ndarray) -> np.ndarray:
        """How much slack each row of the curves `which` loses by a step; see `LinearBlock.change`."""
        change = np.empty((len(which), *self.slack.shape[1:]))
        for own, curve in enumerate(which.tolist()):
            local = self._local_slopes(curve)
            shares = np.einsum("sida,dsa->si", local, curves[own, :, :, : local.shape[-1]])
            change[own] = SIGNS[:, None] * shares[:, None]
        return change

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the indexed rows in the coefficients: a sum of four products, one by derivative."""
        curve, place, sign, axis = index
        axes = np.zeros((len(place), 4, self.at.curves.shape[3]))
        for each in np.unique(curve).tolist():
            rows = curve == each
            local = self._local_slopes(each)[place[rows], axis[rows]]
            axes[rows, :, : local.shape[-1]] = SIGNS[sign[rows]][:, None, None] * local
        return axes, self.at.stack.rows[curve, :, place]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Select `wanted` rows at every few places, at local minima of slack, and at the last place."""
        kept = _mark_key_places(slack)
        kept[:, -1] = True
        return wanted & kept


@dataclass(frozen=True, kw_only=True, eq=False)
class MarginBlock:
    """Margins at the places, in rad: rows (G, S, D, Z) for curves, places, sights and rows of constraints.

    Attributes:
        at: the curves.
        slack: (G, S, D, Z) rad, margins beyond what is wanted, +inf where a row does not bind a sight.
    """

    at: Iterates
    slack: np.ndarray
    name = "zone"
    kind = ZONE
    power = 0
    tolerance = _NEAR_BOUND_ANGLE
    linear = False

    @cached_property
    def may_bind(self) -> np.ndarray:
        """(G,) bool for each curve, whether a step may reach a bound: if any of its slacks is finite."""
        return np.any(np.isfinite(self.slack), axis=(1, 2, 3))

    def time(self, index: Index) -> np.ndarray:
        """See `LinearBlock.time`; zero for margins."""
        return np.full(len(index[0]), -float(self.power))

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """See `LinearBlock.relief`; zero for margins."""
        return np.zeros((len(which), 1, 1, 1))

    @cached_property
    def _slope_cache(self) -> tuple[np.ndarray, np.ndarray]:
        """Cache of slopes: which are known, a bool array like `slack`, and their values by axis (last)."""
        shape = self.slack.shape
        return np.zeros(shape, dtype=bool), np.empty((*shape, self.at.curves.shape[3]))

    def _local_slopes(self, index: Index) -> np.ndarray:
        """Derivatives (R, A) of the indexed margins in each axis (``b`` and joints), computed only once."""
        known, slopes = self._slope_cache
        new = ~known[index]
        if np.any(new):
            part = tuple(own[new] for own in index)
            slopes[part], known[part] = margin_slopes(self.at, *part), True
        return np.asarray(slopes[index])

    def change(self, which: np.ndarray, _: np.ndarray, curves: np.ndarray) -> np.ndarray:
        """How much slack each row loses by a step; zero for rows whose slack surely stays large."""
        slack, moved = taken(self.slack, which), curves[:, 0]
        own, *rest = numbers(slack < self.tolerance + margin_reach(self.at, which, moved))
        local = self._local_slopes((which[own], *rest))
        change = np.zeros_like(slack)
        change[(own, *rest)] = -np.einsum("ra,ra->r", local, moved[own, rest[0]])
        return change

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the indexed rows in the coefficients, as a pair of arrays (see the module)."""
        local = -self._local_slopes(index)
        return local[:, None], self.at.stack.rows[index[0], 0, index[1]][:, None]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Select `wanted` rows at every few places and at local minima of slack, if their slack is finite."""
        return wanted & _mark_key_places(slack) & np.isfinite(self.slack[which])


ConstraintBlock = LinearBlock | LoadBlock | MarginBlock


def _mark_key_places(slack: np.ndarray) -> np.ndarray:
    """Bool array like `slack`, true at every `_PLACE_STRIDE`-th place (second axis) and at local minima."""
    kept = np.zeros(slack.shape, dtype=bool)
    kept[:, ::_PLACE_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[:, 1:-1] |= (slack[:, 1:-1] <= slack[:, :-2]) & (slack[:, 1:-1] <= slack[:, 2:])
    return kept


def constraint_blocks(at: Iterates) -> Iterator[ConstraintBlock]:
    """Yield all constraints of a stack of problems as blocks of rows near the curves `at`."""
    stack = at.stack
    kind, c = stack.members[0], at.coefficients
    differences = [own.space.basis.differences for own in stack.members]
    if np.any(np.isfinite(at.margins)):
        yield MarginBlock(at=at, slack=at.margins - stack.wanted[:, None])
    if stack.reaches.shape[1]:
        yield LinearBlock(
            name="range",
            tolerance=_NEAR_BOUND_ANGLE,
            coefficients=c,
            matrix=stacked([own[0] for own in differences]),
            scale=np.ones_like(stack.reaches),
            bound=stack.reaches[:, None, None],
            centre=stack.centres[:, None],
        )
    for number, limit in enumerate(kind.problem.joint_limits if kind.limited else ()):
        name, power = limit.quantity.name, limit.quantity.power
        scale = 1 / (stack.joint_limits[:, number] * at.duration[:, None] ** power)
        matrix = stacked([own[power] for own in differences])
        yield LinearBlock(name=name, power=power, coefficients=c, matrix=matrix, scale=scale)
    loads = zip(kind.problem.components, kind.problem.lesser, kind.problem.limits, strict=True)
    for own, lesser, limit in loads if kind.limited else ():
        name, power = limit.quantity.name, limit.quantity.power
        scale = 1 / (stack.limits[:, own] * at.duration[:, None] ** power)
        more = None if lesser is None else (lesser, scale * at.duration[:, None] - scale)
        yield LoadBlock(name=name, power=power, own=own, at=at, scale=scale, lesser=more)
    if stack.tube_rows.shape[1]:
        rows, centre, scale = stack.tube_rows, stack.tube_values, 1 / stack.tube_radius
        yield LinearBlock(name="tube", kind=TUBE, coefficients=c, matrix=rows, scale=scale, centre=centre)


def margin_reach(at: Iterates, which: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Bound on how much a step changes margins: the angles by which sight and axis turn, added up.

    Args:
        at: the curves.
        which: (g,) numbers of the curves.
        step: (g, S, A) rad, change of ``b`` and joints at the places.

    Returns:
        (g, S, D, Z) rad, or (g, S, D, 1) where it is the same for all rows.
    """
    stack, moved, gimbals = at.stack, np.abs(step), at.stack.gimbals
    x, y, z = np.moveaxis(moved[:, :, :3], 2, 0)
    platform = np.sqrt(x * x + y * y + z * z)[:, :, None]
    joints = np.zeros((*moved.shape[:2], gimbals.count + 1))  # the last is for what no device carries
    joints[:, :, :-1] = sum(gimbals.parts(moved[:, :, 3:]))
    own = np.take_along_axis(joints, stack.columns["carriers"][which][:, None], axis=2)
    if not stack.has_inner:
        return (platform + own)[..., None]
    frame, partner = (stack.columns[name][which][:, None] for name in ("frame", "partner"))
    axes = np.where(frame == SIGHT, np.take_along_axis(own, partner, axis=2), 0.0)
    return own[..., None] + np.where(frame == INERTIAL, platform, axes)[:, :, None]


def margin_slopes(
    at: Iterates, curve: np.ndarray, place: np.ndarray, sight: np.ndarray, row: np.ndarray
) -> np.ndarray:
    """Derivatives of some margins in ``b`` and the joint angles.

    Args:
        at: the curves.
        curve: (R,) number of the curve.
        place: (R,) index of the place.
        sight: (R,) index of the sight.
        row: (R,) index of the row of the constraints.

    Returns:
        (R, A) derivatives of ``side * (angle - half angle)``, where the angle changes by ``-d cos / sin``;
        for rows of joints these are their weights ``f``.
    """
    stack = at.stack
    cones, moves = stack.columns, stack.members[0].problem.cones.paths
    given = stack.moving_axes[curve, place, row] if moves else cones["axis"][curve, row]
    seen, axis = at.body[curve, place, sight], np.einsum("ri,rij->rj", given, at.attitude[curve, place])
    if stack.has_inner:
        frame, partner = cones["frame"][curve, row], cones["partner"][curve, row]
        partners = at.body[curve, place, partner]
        own = np.where((frame == SIGHT)[:, None], partners, given)
        axis = np.where((frame == INERTIAL)[:, None], axis, own)
    cosine, side = at.cosines[curve, place, sight, row], cones["side"][curve, row]
    factor = -side / np.maximum(np.sqrt(np.maximum(1 - cosine**2, 0)), _MIN_SINE)
    slopes = np.zeros((len(place), at.curves.shape[3]))
    # A rotation d of the body takes the sight v to v + d x v, and axis . (d x v) = d . (v x axis).
    turned = np.stack(cross(seen.T, axis.T), axis=1)
    slopes[:, :3] = np.einsum("rk,rka->ra", turned, at.tangent[curve, place])
    _add_joint_slopes(slopes, at, curve, place, sight, seen, axis)
    if not stack.has_inner:
        return slopes * factor[:, None]
    slopes[frame != INERTIAL, :3] = 0.0
    of = np.flatnonzero(frame == SIGHT)
    both = slopes[of]
    _add_joint_slopes(both, at, curve[of], place[of], partner[of], axis[of], seen[of])
    slopes[of] = both
    slopes *= factor[:, None]
    of = np.flatnonzero(frame == JOINTS)
    slopes[of] = 0.0
    for part, joint in enumerate((stack.gimbals.yaws, stack.gimbals.pitches)):
        slopes[of, 3 + joint[sight[of]]] = cones["axis"][curve[of], row[of], part]
    return slopes


def _add_joint_slopes(
    slopes: np.ndarray,
    at: Iterates,
    curve: np.ndarray,
    place: np.ndarray,
    sight: np.ndarray,
    seen: np.ndarray,
    other: np.ndarray,
) -> None:
    """Add to `slopes`, in place, the derivatives of ``seen . other`` in the joints that turn the sight.

    Args:
        slopes: (R, A) in ``b`` and the joints.
        at: the curves.
        curve: (R,) number of the curve.
        place: (R,) index of the place.
        sight: (R,) index of the sight that is turned.
        seen: (R, 3) that sight, body axes.
        other: (R, 3) the vector that does not turn with it, body axes.
    """
    columns, gimbals = at.stack.columns, at.stack.gimbals
    carrier = columns["carriers"][curve, sight]
    row = np.flatnonzero(carrier >= 0)
    carrier, place, curve = carrier[row], place[row], curve[row]
    yaw = 3 + gimbals.yaws[carrier]
    azimuth = at.curves[curve, 0, place, yaw][:, None]
    ahead, left, up = np.moveaxis(at.stack.frames[curve, carrier], -1, 0)
    about = up, np.sin(azimuth) * ahead - np.cos(azimuth) * left
    # axis . (w x v) = w . (v x axis)
    turned = np.stack(cross(seen[row].T, other[row].T))
    slopes[row, yaw] += dot(about[0].T, turned)
    lifted = np.flatnonzero(carrier < gimbals.terminals)
    slopes[row[lifted], 3 + gimbals.pitches[carrier[lifted]]] += dot(about[1].T, turned)[lifted]
