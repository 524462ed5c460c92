"""Curves of a stack of alike problems: attitudes, loads and margins at their places, and slopes of the loads.

G problems of one kind, the *members*, are worked on together as a `Stack`, with S *places* each: fractions of
the duration, in [0, 1], at which curves are evaluated. A curve has n spline coefficients on each of A = 3 + J
axes: the platform's coordinates ``b`` in a chart of SO(3) (`curve`), and J joint angles. *Loads* are the C
components of the platform's limited quantities, followed by E lesser parts; they depend on the first B axes
(`kernels`). D sights are the directions that Z rows of constraints bind, *margins* the angles (rad) by which
they keep these, negative if broken. Rates are derivatives by the place; to get those by time they are divided
by powers of the duration. A *slope* is a derivative in coefficients or coordinates.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from jaxplan.model.constraints import axes_in_body, counted, joint_values
from jaxplan.model.gimbals import Gimbals
from jaxplan.model.kinematics import time_factor
from jaxplan.model.scores import margins_of_scores, scores
from jaxplan.trajectory.discretisation import DiscreteProblem
from jaxplan.trajectory.kernels import Kernel, load_slopes_at, motion_at, padded_call

_MAX_PEAK_RISE = 0.02  # of a limit, the most by which a load is taken to exceed its values at nearest places
_MIN_CURVATURE = 1e-12  # of a limit, least curvature of a parabola that is divided by
_VIOLATION_TOLERANCE = 1e-6  # the largest violation of a constraint that still counts as none

LIMIT, ZONE, TUBE = range(3)  # kinds of constraints; joint ranges count as LIMIT

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Stack:
    """G discrete problems of one kind, their arrays stacked along a first axis.

    Attributes:
        members: the problems.
        places: (G, S) in [0, 1].
        rows: (G, 4, S, n) values of the n splines, and of their three derivatives, at the S places.
        wanted: (G, D, Z) rad, margins to keep, of D sights to Z rows of the constraints.
        free: (G, n, k) changes of the n coefficients of an axis by the k free ones.
        by_time: (G, n, A) rad/s, change of the coefficients of A axes for each second of the duration.
        energies: (G, 4, n, n) Gram matrices of the splines and of their first three derivatives.
        weights: (G, 3) of the squares of rate, acceleration and jerk.
        tube_rows: (G, M, n) values of the splines at M nodes with a tube.
        tube_values: (G, M, A) rad, those nodes: ``b`` and joint angles.
        tube_radius: (G, A) rad, of the tube.
        limits: (G, C) on the C components of the platform's loads, in SI units.
        joint_limits: (G, L, J) on the L limited quantities (rates, accelerations) of J joints.
        centres: (G, J) rad, middles of the joints' ranges.
        reaches: (G, J) rad, halves of the joints' ranges.
    """

    members: list[DiscreteProblem]
    places: np.ndarray
    rows: np.ndarray
    wanted: np.ndarray
    free: np.ndarray
    by_time: np.ndarray
    energies: np.ndarray
    weights: np.ndarray
    tube_rows: np.ndarray
    tube_values: np.ndarray
    tube_radius: np.ndarray
    limits: np.ndarray
    joint_limits: np.ndarray
    centres: np.ndarray
    reaches: np.ndarray

    @classmethod
    def of(cls, members: Sequence[DiscreteProblem]) -> "Stack":
        """Stack problems of one kind (`DiscreteProblem.kind`)."""
        problems = [own.problem for own in members]
        shape = len(members), len(problems[0].joint_limits), problems[0].joints.shape[1]

        def all_of(name: str, owners: Sequence[Any]) -> np.ndarray:
            return stacked([getattr(own, name) for own in owners])

        ranges = np.stack([own.spacecraft.joint_ranges for own in problems])
        names = ("places", "rows", "tube_rows", "tube_values", "tube_radius")
        of_spaces = ("free", "by_time", "energies")
        return cls(
            members=list(members),
            **{name: all_of(name, members) for name in names},
            **{name: all_of(name, [own.space for own in members]) for name in of_spaces},
            wanted=all_of("wanted", problems),
            weights=np.array([own.weights for own in problems]),
            limits=np.stack(
                [own.share * np.concatenate([limit.bound for limit in own.problem.limits]) for own in members]
            ),
            joint_limits=np.reshape([[limit.bound for limit in own.joint_limits] for own in problems], shape),
            centres=np.mean(ranges, axis=-1),
            reaches=np.diff(ranges, axis=-1)[..., 0] / 2,
        )

    @cached_property
    def columns(self) -> dict[str, np.ndarray]:
        """Attributes of the members' `Constraints` and `Sights` by name, stacked along a first axis.

        Of constraints ``side``, ``frame``, ``partner`` (G, Z) and ``axis`` (G, Z, 3), of sights ``carriers``
        (G, D) and ``turning`` (G, 2, D).
        """
        problems = [own.problem for own in self.members]
        rows = ("side", "frame", "partner", "axis")
        found = {name: np.stack([getattr(own.cones, name) for own in problems]) for name in rows}
        for name in ("carriers", "turning"):
            found[name] = np.stack([getattr(own.sights, name) for own in problems])
        return found

    @cached_property
    def moving_axes(self) -> np.ndarray:
        """(G, S, Z, 3) axes by problem, place and row, for constraints of which some move."""
        return np.stack([own.problem.axes(own.places) for own in self.members])

    @property
    def gimbals(self) -> Gimbals:
        """The gimbals of the first problem, whose joints are numbered like those of all."""
        return self.members[0].problem.sights.gimbals

    @cached_property
    def frames(self) -> np.ndarray:
        """(G, g, 3, 3) mounting frames of the g gimbals of each problem, as in `Gimbals`."""
        return np.stack([own.problem.sights.gimbals.frames for own in self.members])

    @property
    def has_inner(self) -> bool:
        """Whether any row's axis is not inertial but of the body, a sight or a terminal's joints."""
        return self.members[0].problem.cones.inner

    def iterates(
        self, coefficients: np.ndarray, duration: np.ndarray, *, as_given: bool = False
    ) -> "Iterates":
        """Evaluate one curve for each member at its places.

        Args:
            coefficients: (G, n, A) of the curves.
            duration: (G,) s.
            as_given: whether these durations are kept. Otherwise curves of a free duration that rest at both
                ends get the shortest one within the limits at the places.
        """
        curves = self.rows @ coefficients[:, None]
        motions = self.evaluated(_motion_kernel, curves, range(len(curves)))
        found = [
            (*motion, *_margins_along(own, curve, motion[0]))
            for own, curve, motion in zip(self.members, curves, motions, strict=True)
        ]
        attitude, tangent, loads, body, cosines, margins = map(np.stack, zip(*found, strict=True))
        at = Iterates(
            stack=self,
            coefficients=coefficients,
            duration=duration,
            curves=curves,
            attitude=attitude,
            tangent=tangent,
            loads=loads,
            body=body,
            cosines=cosines,
            margins=margins,
            violations=np.full((len(duration), 3), -np.inf),
            known_slopes=[None] * len(duration),
        )
        broken, kind = at.violations, self.members[0]
        broken[:, ZONE] = _largest_per_member(self.wanted[:, None] - margins)
        off_centre = np.abs(curves[:, 0, :, 3:] - self.centres[:, None])
        broken[:, LIMIT] = _largest_per_member(off_centre - self.reaches[:, None])
        broken[:, TUBE] = _largest_per_member(
            np.abs(self.tube_rows @ coefficients - self.tube_values) - self.tube_radius[:, None]
        )
        if kind.limited:
            rooted = self.rooted_durations(at)
            needed = self.needed_durations(at)
            if kind.free_time and not (as_given or kind.problem.at_speed):
                at = replace(at, duration=np.maximum(needed, rooted))
            broken[:, LIMIT] = np.maximum(broken[:, LIMIT], needed / at.duration - 1)
            if kind.problem.wheel_rows:
                broken[:, LIMIT] = np.maximum(broken[:, LIMIT], self.rooted_shares(at) - 1)
        broken[~at.finite, LIMIT] = np.inf
        return at

    def evaluated(
        self, kernel_of: Callable[[DiscreteProblem], Kernel], curves: np.ndarray, which: Sequence[int]
    ) -> list[list[np.ndarray]]:
        """Call a kernel for some of the curves; those of one problem share a call.

        Args:
            kernel_of: makes the kernel of a problem.
            curves: (G, 4, S, A).
            which: numbers of the curves to call it for.

        Returns:
            For each of these curves, the kernel's arrays (S, ...).
        """
        alike: dict[int, list[int]] = {}
        for number in which:
            alike.setdefault(id(self.members[number]), []).append(number)
        found: dict[int, list[np.ndarray]] = {}
        for numbers in alike.values():
            own, count = self.members[numbers[0]], len(numbers)
            axes = own.problem.body.axes
            if count == 1:
                found[numbers[0]] = padded_call(kernel_of(own), own.places, curves[numbers[0]], axes)
                continue
            joined = np.concatenate([curves[number] for number in numbers], axis=1)
            told = padded_call(kernel_of(own), np.tile(own.places, count), joined, axes)
            parts = zip(*(np.split(array, count) for array in told), strict=True)
            found |= {number: list(part) for number, part in zip(numbers, parts, strict=True)}
        return [found[number] for number in which]

    def needed_durations(self, at: "Iterates") -> np.ndarray:
        """Shortest duration (G,) in s in which each curve keeps limits of rates and loads at the places.

        Loads with a lesser part are left to `rooted_durations`.
        """
        problem, between = self.members[0].problem, self.members[0].hastens
        shares = [
            (
                self.with_peaks(np.abs(at.loads[:, :, own]) / self.limits[:, None, own], between),
                limit.quantity.power,
            )
            for own, limit in zip(problem.components, problem.limits, strict=True)
            if limit.quantity.lesser is None
        ]
        for number, limit in enumerate(problem.joint_limits):
            power = limit.quantity.power
            own = np.abs(at.curves[:, power, :, 3:]) / self.joint_limits[:, None, number]
            shares.append((own, power))
        factors = [time_factor(np.max(own, axis=(1, 2)), power) for own, power in shares]
        return np.asarray(np.max(factors, axis=0))

    def with_peaks(self, shares: np.ndarray, between: bool) -> np.ndarray:
        """Raise fractions of limits at local maxima to the peaks of parabolas through their neighbours.

        Args:
            shares: (G, S, ...) fractions of limits by curve and place.
            between: whether to look between the places; otherwise `shares` are returned as they are.
        """
        if not between:
            return shares
        gaps = np.diff(self.places, axis=1).reshape(len(shares), -1, *[1] * (shares.ndim - 2))
        slopes = np.diff(shares, axis=1) / gaps
        before, after = slopes[:, :-1], slopes[:, 1:]
        wide = gaps[:, :-1] + gaps[:, 1:]
        slope = (after * gaps[:, :-1] + before * gaps[:, 1:]) / wide
        bend = np.maximum((before - after) / wide, _MIN_CURVATURE)
        peak = (before >= 0) & (after <= 0)
        found = shares.copy()
        found[:, 1:-1] += np.where(peak, np.minimum(slope**2 / (4 * bend), _MAX_PEAK_RISE), 0.0)
        return found

    def _loads_with_lesser_part(self, at: "Iterates") -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        """Yield, for each load with a lesser part, its two terms as shares of the limit.

        A load at duration T is ``leading / T^p + lower / T^(p - 1)``; the curves' loads are those for 1 s.

        Yields:
            The leading term (G, S, c), the exponent p, and the lower-order term (G, S, c).
        """
        problem = self.members[0].problem
        for own, lesser, limit in zip(problem.components, problem.lesser, problem.limits, strict=True):
            if lesser is not None:
                slow, bound = at.loads[:, :, lesser], self.limits[:, None, own]
                yield (at.loads[:, :, own] - slow) / bound, limit.quantity.power, slow / bound

    def rooted_durations(self, at: "Iterates") -> np.ndarray:
        """Shortest duration (G,) in s from which on each curve keeps limits of loads with a lesser part.

        Places where slowing down does not help are left out.
        """
        found = np.zeros(len(at.duration))
        for share, power, lesser in self._loads_with_lesser_part(at):
            factors = time_factor(share, power, lesser)
            factors[np.isinf(factors)] = 0.0
            found = np.maximum(found, np.max(factors, axis=(1, 2)))
        return found

    def rooted_shares(self, at: "Iterates") -> np.ndarray:
        """Largest fraction (G,) of a limit that loads with a lesser part take, in each curve's duration."""
        found, duration = np.zeros(len(at.duration)), at.duration[:, None, None]
        for share, power, lesser in self._loads_with_lesser_part(at):
            own = np.abs(share / duration**power + lesser / duration ** (power - 1))
            found = np.maximum(found, np.max(own, axis=(1, 2)))
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterates:
    """One curve for each of the G members of a stack, with all values at the places.

    Attributes:
        stack: the problems.
        coefficients: (G, n, A) of the curves, n on each of A axes.
        duration: (G,) s.
        curves: (G, 4, S, A) ``b`` and joints (rad), with three derivatives by the place.
        attitude: (G, S, 3, 3) body to inertial, at S places.
        tangent: (G, S, 3, 3) ``U^T D``, which takes a change of ``b`` to a rotation vector in body axes.
        loads: (G, S, C + E) of the platform for a duration of 1 s: C loads, then E lesser parts (`kernels`).
        body: (G, S, D, 3) unit vectors of D sights in body axes.
        cosines: (G, S, D, Z) of the angles between sights and axes of Z rows of the constraints.
        margins: (G, S, D, Z) rad; +inf where a row does not bind a sight, and for all entries of a constraint
            but the one that holds best from there to the next place, and to the place before.
        violations: (G, 3) the largest by kind of constraint (`LIMIT`, `ZONE`, `TUBE`); zero or less if none
            is broken. Of limits it is the fraction by which the duration is too short (or by which a load
            with a lesser part exceeds its limit), of joint ranges, zones and tubes the excess in rad.
        known_slopes: for each curve the result of `load_slopes`, None until that is called.
    """

    stack: Stack
    coefficients: np.ndarray
    duration: np.ndarray
    curves: np.ndarray
    attitude: np.ndarray
    tangent: np.ndarray
    loads: np.ndarray
    body: np.ndarray
    cosines: np.ndarray
    margins: np.ndarray
    violations: np.ndarray
    known_slopes: list[np.ndarray | None]

    @property
    def is_sound(self) -> np.ndarray:
        """(G,) bool for each curve, whether no constraint is broken at the places."""
        return np.all(self.violations <= _VIOLATION_TOLERANCE, axis=1)

    @cached_property
    def finite(self) -> np.ndarray:
        """(G,) bool for each curve, whether all loads and cosines are finite."""
        kept = np.all(np.isfinite(self.loads), axis=(1, 2))
        return np.asarray(kept & np.all(np.isfinite(self.cosines), axis=(1, 2, 3)))


def members_of(whole: T, which: np.ndarray) -> T:
    """Select the part of stacked data that belongs to some of the G members; it must not be written to.

    Args:
        whole: an array (G, ...), a list of length G, or a dictionary or dataclass of such.
        which: the members' numbers, rising, or (G,) bool.
    """
    found: Any
    if isinstance(whole, np.ndarray):
        found = taken(whole, which)
    elif isinstance(whole, list):
        found = [whole[number] for number in np.arange(len(whole))[which].tolist()]
    elif isinstance(whole, dict):
        found = {name: members_of(own, which) for name, own in whole.items()}
    else:
        names = [field.name for field in fields(whole) if field.init]  # type: ignore[arg-type]
        parts = {name: members_of(getattr(whole, name), which) for name in names}
        found = replace(whole, **parts)  # type: ignore[type-var]
    return found


def mixed(first: Iterates, other: Iterates, others: np.ndarray) -> Iterates:
    """Merge two iterates of a stack: curves of `other` where (G,) `others` is true, else of `first`."""
    if np.all(others) or not np.any(others):
        return other if np.any(others) else first

    def of_both(own: Any, another: Any) -> Any:
        if own is another:
            return own
        if isinstance(own, list):
            return [b if is_other else a for a, b, is_other in zip(own, another, others, strict=True)]
        found = own.copy()
        found[others] = another[others]
        return found

    names = [field.name for field in fields(first)]
    return Iterates(**{name: of_both(getattr(first, name), getattr(other, name)) for name in names})


def stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Stack G arrays (...) to (G, ...); if all are the same object, a read-only view without a copy."""
    first = arrays[0]
    if all(array is first for array in arrays):
        return np.broadcast_to(first, (len(arrays), *first.shape))
    return np.stack(arrays)


def taken(array: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Select entries of an array (G, ...) by rising numbers or (G,) bool; perhaps a view, so read it only."""
    count = int(np.sum(which)) if which.dtype == bool else len(which)
    if count == len(array):
        return array
    if array.strides[0] == 0:
        return np.broadcast_to(array[0], (count, *array.shape[1:]))
    return array[which]


def _largest_per_member(values: np.ndarray) -> np.ndarray:
    """Largest value of each of G arrays (G, ...), as (G,); -inf for empty ones."""
    return np.asarray(np.max(values.reshape(len(values), -1), axis=1, initial=-np.inf))


def _motion_kernel(discrete: DiscreteProblem) -> Kernel:
    """Make the kernel for attitudes, tangents and loads of one problem's curves."""
    problem, chart = discrete.problem, discrete.chart
    return partial(motion_at, chart.attitude, chart.turn, body=problem.body, names=problem.names)


def _slopes_kernel(discrete: DiscreteProblem) -> Kernel:
    """Make the kernel for derivatives of the loads of one problem's curves."""
    problem = discrete.problem
    return partial(load_slopes_at, discrete.chart.turn, body=problem.body, names=problem.names)


def _margins_along(
    discrete: DiscreteProblem, curve: np.ndarray, attitude: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sights, cosines and margins, as of `Iterates`, along a curve (4, S, A) with attitudes (S, 3, 3)."""
    problem, places, joints = discrete.problem, discrete.places, curve[0, :, 3:]
    cones, body = problem.cones, problem.sights.in_body(joints)
    inertial = problem.axes(places) if cones.paths else cones.axis
    cosines = body @ np.swapaxes(axes_in_body(cones, inertial @ attitude, body), -1, -2)
    of_joints = joint_values(cones, problem.sights.gimbals, joints) if cones.inner else None
    margins = np.asarray(margins_of_scores(cones, scores(cones, cosines, of_joints)))
    np.copyto(margins, np.inf, where=~cones.bound.T)
    if np.any(cones.entry != cones.group):
        # One entry has to hold at both of two neighbouring places, or between them none might hold.
        of_rows = np.min(margins, axis=1, initial=np.inf)
        ends = np.concatenate([of_rows[:1], of_rows, of_rows[-1:]])
        from_to = counted(cones, np.minimum(ends[:-1], ends[1:]))
        np.copyto(margins, np.inf, where=~(from_to[:-1] | from_to[1:])[:, None])
    return body, cosines, margins


def load_slopes(at: Iterates, curve: int) -> np.ndarray:
    """Derivatives (S, C + E, 4, B) of a curve's loads: by place, load, derivative and axis.

    They are stored in `at.known_slopes`, for all curves of the same problem at once. `curve` is a number.
    """
    known = at.known_slopes[curve]
    if known is not None:
        return known
    # Whoever needs one curve of a problem will need its other curves next.
    own = at.stack.members[curve]
    unknown = [n for n, slopes in enumerate(at.known_slopes) if slopes is None]
    alike = [n for n in unknown if at.stack.members[n] is own]
    found = {
        n: slopes
        for n, (slopes,) in zip(alike, at.stack.evaluated(_slopes_kernel, at.curves, alike), strict=True)
    }
    for number, slopes in found.items():
        at.known_slopes[number] = slopes
    return found[curve]
