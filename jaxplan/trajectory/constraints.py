"""Constraints of the spline fit as blocks of linear rows near curves: joints, tubes, loads and margins.

The curves of a stack are looked at together, G of them, each with its own rows; sizes and their letters are
those of `motion`. A *row* is the inequality ``slopes . dc + time * dT / T <= slack`` for a change ``dc`` of
the coefficients and ``dT`` of the duration; its *slack*, what is left to the bound, is negative if it is
broken. A block knows the slack of all its rows and how a step changes it, and writes out only the rows that a
program asks for. The derivatives of a row in the coefficients (n, A) are a product of a row of the axes and
one of the basis, or a sum of P such products: slopes are pairs of arrays (R, P, A) and (R, P, n).

Rows of joints by the coefficients, and of nodes in a tube, are true of every step. All values of a spline lie
between the least and the largest of its coefficients, and those of a derivative likewise, so what holds for
the coefficients holds at every instant. Rows of the platform's loads and of margins are linearised at places
close to each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.geometry.vectors import cross, dot
from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT
from jaxplan.trajectory.motion import LIMIT, TUBE, ZONE, Iterates, load_slopes, stacked, taken

_NEAR_SHARE = 0.15  # of a limit or tube; rows with less slack are in a program from the start
_NEAR_ANGLE = float(np.deg2rad(1.0))  # rad; the same for angles
_FAR_SHARE = 0.5  # of a limit; with more slack at every place a step is assumed not to reach it
_STRIDE = 4  # rows at one of so many places enter a program, besides those of locally least slack
_NEAR_AXIS = 1e-6  # least sine of an angle to a row's axis, where the margin has no slope

SIGNS = np.array([1.0, -1.0])  # of a bound on both sides

Index = tuple[np.ndarray, ...]  # indices (R,) of rows along each axis of a slack, the curve's first
Slopes = tuple[np.ndarray, np.ndarray]  # (R, P, A) of the axes and (R, P, n) of the basis


def numbers(chosen: np.ndarray) -> Index:
    """Indices of the true entries of (G, ...) bool: `np.nonzero`, much faster where they are few."""
    return np.unravel_index(np.flatnonzero(chosen), chosen.shape)


def lowest(slack: np.ndarray) -> np.ndarray:
    """Bool like the slack: whether it is no larger than its neighbours along the second to last axis."""
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

    They are those of rates, accelerations and angles of the joints, and of nodes in a tube. Slacks are shares
    of the bound or, of angles, in rad. Here r counts the rows of the matrix, a the axes.

    Attributes:
        name: unique among the blocks of a fit, as of every block.
        kind: `LIMIT` or `TUBE`.
        power: the power of 1 / duration that the values have.
        tolerance: rows with less slack are in a program from the start.
        coefficients: (G, n, A) ``c``.
        matrix: (G, r, n).
        scale: (G, a), of the last a of the A axes.
        centre: (G, r, a).
        bound: (G, 1, 1, a).
    """

    name: str
    kind: int = LIMIT
    power: int = 0
    tolerance: float = 2 * _NEAR_SHARE
    coefficients: np.ndarray
    matrix: np.ndarray
    scale: np.ndarray
    centre: np.ndarray | float = 0.0
    bound: np.ndarray | float = 1.0
    linear = True

    @property
    def _first(self) -> int:
        """The first of the axes that the rows are about, which are the last ones."""
        return self.coefficients.shape[2] - self.scale.shape[1]

    @cached_property
    def slack(self) -> np.ndarray:
        """(G, 2, r, a), zero where a row just holds."""
        value = (self.matrix @ self.coefficients[:, :, self._first :] - self.centre) * self.scale[:, None]
        return self.bound - np.stack([value, -value], axis=1)

    @property
    def may_bind(self) -> np.ndarray:
        """Whether a step may break any of a curve's rows, (G,) bool: always."""
        return np.ones(len(self.coefficients), dtype=bool)

    def time(self, index: Index) -> np.ndarray:
        """Derivatives (R,) of the rows of these indices in the logarithm of the duration."""
        return np.full(len(index[0]), -float(self.power))

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """By how much relative changes (g,) of the durations of some curves (g,) add to their slack."""
        return (self.power * stretch).reshape(-1, *[1] * (self.slack.ndim - 1))

    def change(self, which: np.ndarray, coefficients: np.ndarray, _: np.ndarray) -> np.ndarray:
        """By how much a step of some curves lessens their slack, (g, ...), the duration staying as it is.

        Args:
            which: (g,) numbers of the curves.
            coefficients: (g, n, A) their changes.
            _: (g, 4, S, A) changes of the curves and of their derivatives at the places.
        """
        matrix, scale = taken(self.matrix, which), self.scale[which][:, None]
        value = matrix @ coefficients[:, :, self._first :] * scale
        return np.stack([value, -value], axis=1)

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the rows of these indices in the coefficients, see `Slopes`."""
        curve, sign, row, axis = index
        axes = np.zeros((len(axis), 1, self.coefficients.shape[2]))
        axes[np.arange(len(axis)), 0, self._first + axis] = SIGNS[sign] * self.scale[curve, axis]
        return axes, self.matrix[curve, row][:, None]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Bool (g, ...), the rows to take of those `wanted` of some curves, given their slack: all."""
        return wanted


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadBlock:
    """One of the platform's loads at the places, as shares of its limit: rows (G, S, 2, c).

    Rows are linearised at the curve. For the length of a vector, which is convex, this lets a step pass the
    limit to second order, by turning the vector; the next program corrects that.

    Attributes:
        name: of the load.
        power: the power of 1 / duration that it has.
        own: its components among those of all loads, c of them.
        at: the curves.
        scale: (G, c) 1 / (limit * duration^power).
        lesser: where its lesser parts are among all loads, which fall by one power less, and what their scale
            (G, c) is beyond `scale`, which is that of the whole; None without.
    """

    name: str
    power: int
    own: slice
    at: Iterates
    scale: np.ndarray
    lesser: tuple[slice, np.ndarray] | None = None
    kind = LIMIT
    tolerance = _NEAR_SHARE
    linear = False

    @cached_property
    def slack(self) -> np.ndarray:
        """(G, S, 2, c) shares of the limit, for a load and its negative; see `Stack.with_peaks`."""
        shares = self.at.loads[:, :, self.own] * self.scale[:, None]
        if self.lesser is not None:
            part, scale = self.lesser
            shares = shares + self.at.loads[:, :, part] * scale[:, None]
        stack = self.at.stack
        between = stack.members[0].hastens and self.lesser is None  # as of `Stack.needed_durations`
        return 1 - stack.with_peaks(SIGNS[:, None] * shares[:, :, None], between)

    @cached_property
    def _falls(self) -> np.ndarray | None:
        """(G, S, 2, c) by how much shares fall with the logarithm of the duration; None for their power's.

        It is that of rows at their bound, or of ``a + b T <= limit T^p`` with the duration ``T``: so, as of a
        power alone, what a curve changes of a row does not depend on what the duration does.
        """
        if self.lesser is None:
            return None
        part, scale = self.lesser
        slow = self.at.loads[:, :, part] * (scale + self.scale)[:, None]
        return self.power - SIGNS[:, None] * slow[:, :, None]

    def time(self, index: Index) -> np.ndarray:
        """Derivatives (R,) of the rows of these indices in the logarithm of the duration."""
        if self._falls is None:
            return np.full(len(index[0]), -float(self.power))
        return np.asarray(-self._falls[index])

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """By how much relative changes (g,) of the durations of some curves (g,) add to their slack."""
        if self._falls is None:
            return (self.power * stretch).reshape(-1, 1, 1, 1)
        return np.asarray(taken(self._falls, which) * stretch[:, None, None, None])

    @cached_property
    def may_bind(self) -> np.ndarray:
        """(G,) whether a step may take a curve to a row's bound."""
        return ~np.all(self.slack > _FAR_SHARE, axis=(1, 2, 3))

    def _local(self, curve: int) -> np.ndarray:
        """Derivatives (S, c, 4, B) of the load over its limit in the first B axes of one curve."""
        slopes = load_slopes(self.at, curve)
        found = slopes[:, self.own] * self.scale[curve, :, None, None]
        if self.lesser is not None:
            part, scale = self.lesser
            found = found + slopes[:, part] * scale[curve, :, None, None]
        return found

    def change(self, which: np.ndarray, _: np.ndarray, curves: np.ndarray) -> np.ndarray:
        """By how much a step lessens the slack of every row, see `LinearBlock.change`."""
        change = np.empty((len(which), *self.slack.shape[1:]))
        for own, curve in enumerate(which.tolist()):
            local = self._local(curve)
            shares = np.einsum("sida,dsa->si", local, curves[own, :, :, : local.shape[-1]])
            change[own] = SIGNS[:, None] * shares[:, None]
        return change

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the rows of these indices in the coefficients: four products, one by derivative."""
        curve, place, sign, axis = index
        axes = np.zeros((len(place), 4, self.at.curves.shape[3]))
        for each in np.unique(curve).tolist():
            rows = curve == each
            local = self._local(each)[place[rows], axis[rows]]
            axes[rows, :, : local.shape[-1]] = SIGNS[sign[rows]][:, None, None] * local
        return axes, self.at.stack.rows[curve, :, place]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Those `wanted`, thinned out by `_telling`; all at the last place, where a load may be the worst."""
        kept = _telling(slack)
        kept[:, -1] = True
        return wanted & kept


@dataclass(frozen=True, kw_only=True, eq=False)
class MarginBlock:
    """Margins at the places, in rad: rows (G, S, D, Z).

    Attributes:
        at: the curves.
        slack: (G, S, D, Z) margins beyond what is wanted.
    """

    at: Iterates
    slack: np.ndarray
    name = "zone"
    kind = ZONE
    power = 0
    tolerance = _NEAR_ANGLE
    linear = False

    @cached_property
    def may_bind(self) -> np.ndarray:
        """(G,) whether a step may take a curve to a row's bound."""
        return np.any(np.isfinite(self.slack), axis=(1, 2, 3))

    def time(self, index: Index) -> np.ndarray:
        """Derivatives (R,) of the rows of these indices in the logarithm of the duration: zero."""
        return np.full(len(index[0]), -float(self.power))

    def relief(self, which: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """By how much relative changes (g,) of the durations of some curves (g,) add to their slack: zero."""
        return np.zeros((len(which), 1, 1, 1))

    @cached_property
    def _known(self) -> tuple[np.ndarray, np.ndarray]:
        """Which rows' slopes are known, (G, S, D, Z) bool, and these, (G, S, D, Z, A)."""
        shape = self.slack.shape
        return np.zeros(shape, dtype=bool), np.empty((*shape, self.at.curves.shape[3]))

    def _local(self, index: Index) -> np.ndarray:
        """Derivatives (R, A) of some margins in ``b`` and the joints, each computed once for all rounds."""
        known, slopes = self._known
        new = ~known[index]
        if np.any(new):
            part = tuple(own[new] for own in index)
            slopes[part], known[part] = margin_slopes(self.at, *part), True
        return np.asarray(slopes[index])

    def change(self, which: np.ndarray, _: np.ndarray, curves: np.ndarray) -> np.ndarray:
        """By how much a step lessens slacks, zero where they surely stay large; see `LinearBlock.change`."""
        slack, moved = taken(self.slack, which), curves[:, 0]
        own, *rest = numbers(slack < self.tolerance + margin_reach(self.at, which, moved))
        local = self._local((which[own], *rest))
        change = np.zeros_like(slack)
        change[(own, *rest)] = -np.einsum("ra,ra->r", local, moved[own, rest[0]])
        return change

    def slopes(self, index: Index) -> Slopes:
        """Derivatives of the rows of these indices in the coefficients, see `Slopes`."""
        local = -self._local(index)
        return local[:, None], self.at.stack.rows[index[0], 0, index[1]][:, None]

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Those `wanted`, thinned out by `_telling`; of each constraint only the entry that holds best."""
        return wanted & _telling(slack) & np.isfinite(self.slack[which])


ConstraintBlock = LinearBlock | LoadBlock | MarginBlock


def _telling(slack: np.ndarray) -> np.ndarray:
    """Bool like the slack: rows at every `_STRIDE`-th place (second axis) and at local minima of it."""
    kept = np.zeros(slack.shape, dtype=bool)
    kept[:, ::_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[:, 1:-1] |= (slack[:, 1:-1] <= slack[:, :-2]) & (slack[:, 1:-1] <= slack[:, 2:])
    return kept


def constraint_blocks(at: Iterates) -> Iterator[ConstraintBlock]:
    """All constraints of a stack of problems as blocks of rows near the curves `at`."""
    stack = at.stack
    kind, c = stack.members[0], at.coefficients
    differences = [own.space.basis.differences for own in stack.members]
    if np.any(np.isfinite(at.margins)):
        yield MarginBlock(at=at, slack=at.margins - stack.wanted[:, None])
    if stack.reaches.shape[1]:
        yield LinearBlock(
            name="range",
            tolerance=_NEAR_ANGLE,
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
    """Bound on how much a step changes margins: no more than sight and axis turn, seen from each other.

    Args:
        at: the curves.
        which: (g,) numbers of the curves.
        step: (g, S, A) change of ``b`` and joints.

    Returns:
        (g, S, D, Z) rad, or (g, S, D, 1) where it is the same of all rows.
    """
    stack, moved, gimbals = at.stack, np.abs(step), at.stack.gimbals
    x, y, z = np.moveaxis(moved[:, :, :3], 2, 0)
    platform = np.sqrt(x * x + y * y + z * z)[:, :, None]
    joints = np.zeros((*moved.shape[:2], gimbals.count + 1))  # the last of what no device carries
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
    """Derivatives of some margins in ``b`` and the joints.

    Args:
        at: the curves.
        curve: (R,) number of the curve.
        place: (R,) index of the place.
        sight: (R,) index of the sight.
        row: (R,) index of the row of the constraints.

    Returns:
        (R, A) derivatives of ``side * (angle - half angle)``, where the angle changes by ``-d cos / sin``; of
        rows of joints these are their weights.
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
    factor = -side / np.maximum(np.sqrt(np.maximum(1 - cosine**2, 0)), _NEAR_AXIS)
    slopes = np.zeros((len(place), at.curves.shape[3]))
    # A rotation d of the body takes the sight v to v + d x v, and axis . (d x v) = d . (v x axis).
    turned = np.stack(cross(seen.T, axis.T), axis=1)
    slopes[:, :3] = np.einsum("rk,rka->ra", turned, at.tangent[curve, place])
    _add_turns(slopes, at, curve, place, sight, seen, axis)
    if not stack.has_inner:
        return slopes * factor[:, None]
    slopes[frame != INERTIAL, :3] = 0.0
    of = np.flatnonzero(frame == SIGHT)
    both = slopes[of]
    _add_turns(both, at, curve[of], place[of], partner[of], axis[of], seen[of])
    slopes[of] = both
    slopes *= factor[:, None]
    of = np.flatnonzero(frame == JOINTS)
    slopes[of] = 0.0
    for part, joint in enumerate((stack.gimbals.yaws, stack.gimbals.pitches)):
        slopes[of, 3 + joint[sight[of]]] = cones["axis"][curve[of], row[of], part]
    return slopes


def _add_turns(
    slopes: np.ndarray,
    at: Iterates,
    curve: np.ndarray,
    place: np.ndarray,
    sight: np.ndarray,
    seen: np.ndarray,
    other: np.ndarray,
) -> None:
    """Add to slopes (R, A), in place, the derivatives of ``seen . other`` in the joints that turn the sight.

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
