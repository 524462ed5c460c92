"""Motions at many places: attitudes, loads and margins, with the slopes that a program needs.

Motions are looked at together, a stack of G. Rates are those in ``s``, the place in [0, 1]; in time they are
divided by powers of the duration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.trajectory.global_spline import kernels
from jaxplan.trajectory.global_spline.problem import Problem

_NEAR_AXIS = 1e-6  # least sine of an angle to a zone's axis, where the margin has no slope


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A stack of curves at S places.

    Attributes:
        problems: chart, spacecraft and zones of each; they have as many devices and zones and the same loads.
        places: (G, S) in [0, 1].
        curves: (G, 4, S, 3 + 2n) ``b`` and joints with three derivatives.
        attitude: (G, S, 3, 3) body to inertial.
        tangent: (G, S, 3, 3) what turns a change of ``b`` into a rotation, in body axes: ``U^T D``.
        loads: (G, S, Q, 3) of the platform.
        body: (G, S, D, 3) boresights in body axes.
        body_slopes: (G, S, 2, n, 3) their derivatives in yaw and in pitch.
        cosines: (G, S, D, Z) of the angles between boresights and zones' axes.
        margins: (G, S, D, Z) rad; +inf where a zone does not bind a device, and for all entries of a group
            but the one that holds best.
    """

    problems: Sequence[Problem]
    places: np.ndarray
    curves: np.ndarray
    attitude: np.ndarray
    tangent: np.ndarray
    loads: np.ndarray
    body: np.ndarray
    body_slopes: np.ndarray
    cosines: np.ndarray
    margins: np.ndarray
    _load_slopes: dict[int, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def load_slopes(self, curve: int) -> np.ndarray:
        """(S, Q, 3, 4, 3) derivatives of a curve's loads in ``b`` and its derivatives (last axes)."""
        if curve not in self._load_slopes:
            problem = self.problems[curve]
            turn, inertia, choices = problem.chart.turn, problem.inertia, _choices(problem)
            (self._load_slopes[curve],) = kernels.by_chunks(
                lambda places, own: (kernels.load_slopes(turn, places, own, inertia, **choices),),
                self.places[curve],
                self.curves[curve],
            )
        return self._load_slopes[curve]

    @cached_property
    def _zones(self) -> tuple[np.ndarray, np.ndarray]:
        """Sides (G, Z) of the zones, and their axes (G, S, Z, 3)."""
        cones = [problem.cones for problem in self.problems]
        sides = np.stack([own.side for own in cones])
        if cones[0].paths:
            return sides, _moving_axes(self.problems, self.places)
        axes = np.stack([own.axis for own in cones])[:, None]
        return sides, np.broadcast_to(axes, (*self.places.shape, *axes.shape[2:]))

    @cached_property
    def finite(self) -> np.ndarray:
        """(G,) whether all numbers are."""
        kept = np.all(np.isfinite(self.loads), axis=(1, 2, 3))
        return np.asarray(kept & np.all(np.isfinite(self.cosines), axis=(1, 2, 3)))

    def some(self, which: np.ndarray) -> "Motion":
        """Some of the curves, by their numbers or as (G,) bool."""
        numbers = np.arange(len(self.problems))[which].tolist()
        arrays = {name: getattr(self, name)[which] for name in _ARRAYS}
        found = replace(self, problems=[self.problems[number] for number in numbers], **arrays)
        known = self._load_slopes
        found._load_slopes.update({own: known[one] for own, one in enumerate(numbers) if one in known})
        return found

    def mixed(self, other: "Motion", others: np.ndarray) -> "Motion":
        """With the curves of another stack of the same problems where `others` (G,) says so."""
        arrays = {name: getattr(self, name).copy() for name in _ARRAYS}
        for name, own in arrays.items():
            own[others] = getattr(other, name)[others]
        found = replace(self, **arrays)
        for number, theirs in enumerate(others.tolist()):
            known = (other if theirs else self)._load_slopes
            if number in known:
                found._load_slopes[number] = known[number]
        return found

    def margin_slopes(
        self, curve: np.ndarray, place: np.ndarray, device: np.ndarray, zone: np.ndarray
    ) -> np.ndarray:
        """Derivatives of some margins in ``b`` and the joints.

        Args:
            curve: (R,) number.
            place: (R,) index of a place.
            device: (R,) index.
            zone: (R,) index.

        Returns:
            (R, 3 + 2n) of ``side * (angle - half angle)``; the angle falls by ``d cos / sin``.
        """
        joints = self.body_slopes.shape[3]
        sides, directions = self._zones
        side, axes = sides[curve, zone], directions[curve, place, zone]
        cosine = self.cosines[curve, place, device, zone]
        factor = -side / np.maximum(np.sqrt(np.maximum(1 - cosine**2, 0)), _NEAR_AXIS)
        axis = np.einsum("ri,rij->rj", axes, self.attitude[curve, place])  # in the body
        slopes = np.zeros((len(place), 3 + 2 * joints))
        # A rotation d of the body takes the boresight v to v + d x v, and axis . (d x v) = d . (v x axis).
        turning = _cross(self.body[curve, place, device], axis)
        slopes[:, :3] = np.einsum("rk,rka->ra", turning, self.tangent[curve, place])
        row = np.flatnonzero(device < joints)
        own = self.body_slopes[curve[row], place[row], :, device[row]]  # (rows, 2, 3), of yaw and pitch
        for part in range(2):
            turned = own[:, part] * axis[row]
            slopes[row, 3 + part * joints + device[row]] = turned[:, 0] + turned[:, 1] + turned[:, 2]
        return slopes * factor[:, None]


_ARRAYS = (
    "places",
    "curves",
    "attitude",
    "tangent",
    "loads",
    "body",
    "body_slopes",
    "cosines",
    "margins",
)


def evaluate(problems: Sequence[Problem], places: np.ndarray, curves: np.ndarray) -> Motion:
    """The motions of a stack of curves.

    Args:
        problems: chart, spacecraft and zones of each; zones move in all of them or in none.
        places: (G, S) in [0, 1].
        curves: (G, 4, S, 3 + 2n) values and derivatives.
    """
    found = [
        kernels.by_chunks(
            lambda part, own, problem=problem: kernels.values(  # type: ignore[misc]
                problem.chart.attitude, problem.chart.turn, part, own, problem.inertia, **_choices(problem)
            ),
            *own,
        )
        for problem, *own in zip(problems, places, curves, strict=True)
    ]
    attitude, tangent, loads = (np.stack(arrays) for arrays in zip(*found, strict=True))
    body, body_slopes = _body(problems, curves[:, 0, :, 3:])
    own_cosines = _cosines(problems, places, attitude, body)
    return Motion(
        problems=problems,
        places=places,
        curves=curves,
        attitude=attitude,
        tangent=tangent,
        loads=loads,
        body=body,
        body_slopes=body_slopes,
        cosines=own_cosines,
        margins=margins([problem.cones for problem in problems], own_cosines),
    )


def cosines(
    problems: Sequence[Problem], places: np.ndarray, attitudes: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """Cosines of `Motion` at places (G, S) for attitudes (G, S, 3, 3) and joints (G, S, 2n)."""
    return _cosines(problems, places, attitudes, _body(problems, joints)[0])


def margins(cones: Sequence[Constraints], angle_cosines: np.ndarray) -> np.ndarray:
    """Margins (G, S, D, Z) as `Motion` has them, from the cosines (G, S, D, Z)."""
    side, half, bound = (
        np.stack(parts)[:, None]
        for parts in zip(*((own.side[None], own.half_angle[None], own.bound.T) for own in cones), strict=True)
    )
    found = side * (np.arccos(np.clip(angle_cosines, -1, 1)) - half)
    found = np.where(bound, found, np.inf)
    for own, one in zip(cones, found, strict=True):
        for leader in np.flatnonzero(np.bincount(own.group, minlength=1) > 1):
            members = np.flatnonzero(own.group == leader)
            best = np.argmax(one[:, :, members].min(axis=1), axis=1)
            others = members[None, :] != members[best][:, None]
            one[:, :, members] = np.where(others[:, None, :], np.inf, one[:, :, members])
    return found


def _cosines(
    problems: Sequence[Problem], places: np.ndarray, attitudes: np.ndarray, body: np.ndarray
) -> np.ndarray:
    seen = body @ np.swapaxes(attitudes, -1, -2)
    if problems[0].cones.paths:
        return np.asarray(seen @ np.swapaxes(_moving_axes(problems, places), -1, -2))
    directions = np.stack([problem.cones.axis.T for problem in problems])
    return np.asarray(seen @ directions[:, None])


def _moving_axes(problems: Sequence[Problem], places: np.ndarray) -> np.ndarray:
    """(G, S, Z, 3) of the zones."""
    return np.stack([problem.axes(own) for problem, own in zip(problems, places, strict=True)])


def _body(problems: Sequence[Problem], joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boresights (G, S, D, 3) in body axes (equation 13), and of terminals their slopes (G, S, 2, n, 3)."""
    yaw, pitch = np.split(joints, 2, axis=-1)
    azimuth = yaw + np.stack([problem.spacecraft.mounts for problem in problems])[:, None]
    (sin_a, sin_p), (cos_a, cos_p) = np.sin([azimuth, pitch]), np.cos([azimuth, pitch])
    moving = np.stack([cos_p * cos_a, cos_p * sin_a, sin_p], axis=-1)
    by_yaw = np.stack([-cos_p * sin_a, cos_p * cos_a, np.zeros_like(sin_a)], axis=-1)
    by_pitch = np.stack([-sin_p * cos_a, -sin_p * sin_a, cos_p], axis=-1)
    fixed = np.stack([np.asarray(problem.spacecraft.fixed_boresights, float) for problem in problems])
    still = np.broadcast_to(fixed[:, None], (*joints.shape[:2], *fixed.shape[1:]))
    return np.concatenate([moving, still], axis=2), np.stack([by_yaw, by_pitch], axis=2)


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of vectors (R, 3); numpy's takes several times as long for a few."""
    (a, b, c), (x, y, z) = first.T, second.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _choices(problem: Problem) -> dict[str, bool]:
    return {"dynamic": problem.dynamic, "jerky": problem.jerky}
