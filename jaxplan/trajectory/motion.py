"""Motions at many places: attitudes, loads and margins, with the slopes that a program needs.

Motions are looked at together, a stack of G. Rates are those in ``s``, the place in [0, 1]; in time they are
divided by powers of the duration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import cross, dot
from jaxplan.model.constraints import (
    INERTIAL,
    JOINTS,
    SIGHT,
    axes_in_body,
    counted,
    joint_values,
    margins_of_scores,
    scores,
)
from jaxplan.model.limits import Kinematics, highest_derivative, values
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory.curve import chart_motion
from jaxplan.trajectory.problem import System

_NEAR_AXIS = 1e-6  # least sine of an angle to a row's axis, where the margin has no slope


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A stack of curves at S places, with D sights and Z rows of constraints.

    Attributes:
        systems: chart, spacecraft and constraints of each; they have as many terminals, sights of each sort
            and rows, and the same loads.
        places: (G, S) in [0, 1].
        curves: (G, 4, S, 3 + 2n) ``b`` and joints with three derivatives.
        attitude: (G, S, 3, 3) body to inertial.
        tangent: (G, S, 3, 3) what turns a change of ``b`` into a rotation, in body axes: ``U^T D``.
        loads: (G, S, Q, 3) of the platform.
        body: (G, S, D, 3) sights in body axes.
        cosines: (G, S, D, Z) of the angles between sights and axes.
        margins: (G, S, D, Z) rad; +inf where a row does not bind a sight, and for all entries of a constraint
            but the one that holds best from there to the next place, and to the place before.
    """

    systems: Sequence[System]
    places: np.ndarray
    curves: np.ndarray
    attitude: np.ndarray
    tangent: np.ndarray
    loads: np.ndarray
    body: np.ndarray
    cosines: np.ndarray
    margins: np.ndarray
    _load_slopes: dict[int, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def load_slopes(self, curve: int) -> np.ndarray:
        """(S, Q, 3, 4, 3) derivatives of a curve's loads in ``b`` and its derivatives (last axes)."""
        if curve not in self._load_slopes:
            system = self.systems[curve]
            turn, inertia, names = system.chart.turn, system.inertia, system.names
            (self._load_slopes[curve],) = padded_call(
                lambda places, own: (load_slopes(turn, places, own, inertia, names=names),),
                self.places[curve],
                self.curves[curve],
            )
        return self._load_slopes[curve]

    @cached_property
    def carriers(self) -> np.ndarray:
        """(G, D) int, terminals that carry the sights; -1 of those fixed to the body."""
        return np.stack([system.sights.carriers for system in self.systems])

    @cached_property
    def _turning(self) -> np.ndarray:
        """(G, 2, D), see `Sights.turning`."""
        return np.stack([system.sights.turning for system in self.systems])

    @cached_property
    def _rows(self) -> dict[str, np.ndarray]:
        """Of the rows, all (G, Z) but for axes, which are (G, Z, 3) and of rows of joints ``f``."""
        names = ("side", "frame", "partner", "axis")
        return {name: np.stack([getattr(system.cones, name) for system in self.systems]) for name in names}

    @cached_property
    def _moving(self) -> np.ndarray:
        """(G, S, Z, 3) axes where some move."""
        return np.stack([one.axes(own) for one, own in zip(self.systems, self.places, strict=True)])

    def _axes(self, curve: np.ndarray, place: np.ndarray, row: np.ndarray) -> np.ndarray:
        """(R, 3) of some rows, in body axes."""
        moving = self.systems[0].cones.paths
        given = self._moving[curve, place, row] if moving else self._rows["axis"][curve, row]
        turned = np.einsum("ri,rij->rj", given, self.attitude[curve, place])
        if not self.systems[0].cones.inner:
            return np.asarray(turned)
        frame = self._rows["frame"][curve, row][:, None]
        sights = self.body[curve, place, self._rows["partner"][curve, row]]
        return np.where(frame == INERTIAL, turned, np.where(frame == SIGHT, sights, given))

    @cached_property
    def finite(self) -> np.ndarray:
        """(G,) whether all numbers are."""
        kept = np.all(np.isfinite(self.loads), axis=(1, 2, 3))
        return np.asarray(kept & np.all(np.isfinite(self.cosines), axis=(1, 2, 3)))

    def some(self, which: np.ndarray) -> "Motion":
        """Some of the curves, by their numbers or as (G,) bool."""
        numbers = np.arange(len(self.systems))[which].tolist()
        arrays = {name: getattr(self, name)[which] for name in _ARRAYS}
        found = replace(self, systems=[self.systems[number] for number in numbers], **arrays)
        known = self._load_slopes
        found._load_slopes.update({own: known[one] for own, one in enumerate(numbers) if one in known})
        return found

    def mixed(self, other: "Motion", others: np.ndarray) -> "Motion":
        """With the curves of another stack of the same systems where `others` (G,) says so."""
        arrays = {name: getattr(self, name).copy() for name in _ARRAYS}
        for name, own in arrays.items():
            own[others] = getattr(other, name)[others]
        found = replace(self, **arrays)
        for number, theirs in enumerate(others.tolist()):
            known = (other if theirs else self)._load_slopes
            if number in known:
                found._load_slopes[number] = known[number]
        return found

    def reach(self, step: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Bound of what a step changes margins by: no more than sight and axis turn, seen from each other.

        Args:
            step: (g, S, 3 + 2n) change of ``b`` and joints.
            which: (g,) numbers of the curves.

        Returns:
            (g, S, D, Z) rad, or (g, S, D, 1) where it is the same of all rows.
        """
        moved = np.abs(step)
        count = (moved.shape[2] - 3) // 2
        x, y, z = np.moveaxis(moved[:, :, :3], 2, 0)
        platform = np.sqrt(x * x + y * y + z * z)[:, :, None]
        joints = np.zeros((*moved.shape[:2], count + 1))  # the last of what no terminal carries
        np.add(moved[:, :, 3 : 3 + count], moved[:, :, 3 + count :], out=joints[:, :, :count])
        own = np.take_along_axis(joints, self.carriers[which][:, None], axis=2)
        if not self.systems[0].cones.inner:
            return (platform + own)[..., None]
        frame, partner = self._rows["frame"][which][:, None], self._rows["partner"][which][:, None]
        axes = np.where(frame == SIGHT, np.take_along_axis(own, partner, axis=2), 0.0)
        return own[..., None] + np.where(frame == INERTIAL, platform, axes)[:, :, None]

    def margin_slopes(
        self, curve: np.ndarray, place: np.ndarray, sight: np.ndarray, row: np.ndarray
    ) -> np.ndarray:
        """Derivatives of some margins in ``b`` and the joints.

        Args:
            curve: (R,) number.
            place: (R,) index of a place.
            sight: (R,) index.
            row: (R,) index.

        Returns:
            (R, 3 + 2n) of ``side * (angle - half angle)``, the angle falling by ``d cos / sin``; of rows of
            joints ``f``.
        """
        seen, axis = self.body[curve, place, sight], self._axes(curve, place, row)
        cosine, side = self.cosines[curve, place, sight, row], self._rows["side"][curve, row]
        factor = -side / np.maximum(np.sqrt(np.maximum(1 - cosine**2, 0)), _NEAR_AXIS)
        slopes = np.zeros((len(place), self.curves.shape[3]))
        # A rotation d of the body takes the sight v to v + d x v, and axis . (d x v) = d . (v x axis).
        slopes[:, :3] = np.einsum(
            "rk,rka->ra", np.stack(cross(seen.T, axis.T), axis=1), self.tangent[curve, place]
        )
        self._add_turns(slopes, curve, place, sight, seen, axis)
        if not self.systems[0].cones.inner:
            return slopes * factor[:, None]
        frame, partner = self._rows["frame"][curve, row], self._rows["partner"][curve, row]
        slopes[frame != INERTIAL, :3] = 0.0
        of = np.flatnonzero(frame == SIGHT)
        both = slopes[of]
        self._add_turns(both, curve[of], place[of], partner[of], axis[of], seen[of])
        slopes[of] = both
        slopes *= factor[:, None]
        of = np.flatnonzero(frame == JOINTS)
        slopes[of] = 0.0
        for part in range(2):
            column = 3 + part * self._terminals + sight[of]
            slopes[of, column] = self._rows["axis"][curve[of], row[of], part]
        return slopes

    @property
    def _terminals(self) -> int:
        return (self.curves.shape[3] - 3) // 2

    def _add_turns(
        self,
        slopes: np.ndarray,
        curve: np.ndarray,
        place: np.ndarray,
        sight: np.ndarray,
        seen: np.ndarray,
        other: np.ndarray,
    ) -> None:
        """Add to slopes (R, 3 + 2n) how ``sight . other`` changes with the joints that turn the sight."""
        carrier = self.carriers[curve, sight]
        row = np.flatnonzero(carrier >= 0)
        yaw, place, curve, sight = 3 + carrier[row], place[row], curve[row], sight[row]
        mounts = np.stack([system.sights.mounts for system in self.systems])
        azimuth = self.curves[curve, 0, place, yaw] + mounts[curve, yaw - 3]
        turns = vectors.turns(tuple(seen[row].T), np.cos(azimuth), np.sin(azimuth))
        for part, change in enumerate(turns):
            weight = self._turning[curve, part, sight]
            slopes[row, yaw + part * self._terminals] += weight * dot(change, other[row].T)


_ARRAYS = (
    "places",
    "curves",
    "attitude",
    "tangent",
    "loads",
    "body",
    "cosines",
    "margins",
)


def evaluate(systems: Sequence[System], places: np.ndarray, curves: np.ndarray) -> Motion:
    """The motions of a stack of curves.

    Args:
        systems: chart, spacecraft and constraints of each; axes move in all of them or in none.
        places: (G, S) in [0, 1].
        curves: (G, 4, S, 3 + 2n) values and derivatives.
    """
    found = []
    for system, *own in zip(systems, places, curves, strict=True):
        attitude, tangent, loads = padded_call(
            lambda part, curve, system=system: motion_at(  # type: ignore[misc]
                system.chart.attitude, system.chart.turn, part, curve, system.inertia, names=system.names
            ),
            *own,
        )
        found.append((attitude, tangent, loads, *_pointing(system, own[0], attitude, own[1][0, :, 3:])))
    names = ("attitude", "tangent", "loads", "body", "cosines", "margins")
    parts = {name: np.stack(arrays) for name, arrays in zip(names, zip(*found, strict=True), strict=True)}
    return Motion(systems=systems, places=places, curves=curves, **parts)


def _pointing(
    system: System, places: np.ndarray, attitude: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Sights, cosines and margins of one curve, as `Motion` has them."""
    cones, body = system.cones, system.sights.in_body(joints)
    inertial = system.axes(places) if cones.paths else cones.axis
    axes = axes_in_body(cones, inertial @ attitude, body)
    cosines = body @ np.swapaxes(axes, -1, -2)
    values = joint_values(cones, joints) if cones.inner else None
    margins = np.asarray(margins_of_scores(cones, scores(cones, cosines, values)))
    np.copyto(margins, np.inf, where=~cones.bound.T)
    if np.any(cones.entry != cones.group):
        # From each place to the next one entry holds at both, or between them none might.
        of_rows = np.min(margins, axis=1, initial=np.inf)
        ends = np.concatenate([of_rows[:1], of_rows, of_rows[-1:]])
        from_to = counted(cones, np.minimum(ends[:-1], ends[1:]))
        kept = from_to[:-1] | from_to[1:]
        np.copyto(margins, np.inf, where=~kept[:, None])
    return body, cosines, margins


_FEWEST_PLACES = 256  # that a kernel looks at in one call; 8 on each of 32 intervals


def padded_call(
    kernel: Callable[[np.ndarray, np.ndarray], tuple[Array, ...]], places: np.ndarray, curves: np.ndarray
) -> list[np.ndarray]:
    """What a kernel of places (S,) and platform curves (4, S, 3) answers, compiled for few S."""
    count, curves = len(places), curves[:, :, :3]
    extra = padded_count(count, _FEWEST_PLACES) - count
    if extra:
        places, curves = np.pad(places, (0, extra)), np.pad(curves, ((0, 0), (0, extra), (0, 0)))
    with jax.enable_x64(True):
        return [np.asarray(array)[:count] for array in kernel(places, curves)]


def loads_at(turn: Array, place: Array, z: Array, inertia: Array, names: tuple[str, ...]) -> Array:
    """The loads (Q, 3) of these names at one place from ``b`` and its derivatives, z (4, 3)."""

    def moving(*point: Array) -> tuple[Array, ...]:
        return chart_motion(turn, *point)[1:]

    b, first, second, third = z
    point = (place[None], b, first, second)
    if highest_derivative(names) > 2:
        spin, (_, jerk) = jax.jvp(moving, point, (jnp.ones(1), first, second, third))
        spin = (*spin, jerk)
    else:
        spin = moving(*point)
    return values(names, Kinematics(spin=spin, inertia=inertia))


@partial(quick_jit, static_argnames="names")
def motion_at(
    attitude: Array, turn: Array, places: Array, curves: Array, inertia: Array, *, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Attitudes, tangents and loads at all places."""

    def at(place: Array, z: Array) -> tuple[Array, Array, Array]:
        eta = z[0] - place * turn
        half = so3.exp(place * turn / 2)
        gamma = half @ so3.exp(eta) @ half
        return (
            attitude @ gamma,
            half.T @ so3.right_jacobian(eta),
            loads_at(turn, place, z, inertia, names),
        )

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))


@partial(quick_jit, static_argnames="names")
def load_slopes(
    turn: Array, places: Array, curves: Array, inertia: Array, *, names: tuple[str, ...]
) -> Array:
    """Derivatives of the loads at all places."""

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, inertia, names)

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))
