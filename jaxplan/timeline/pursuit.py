"""What must point where while targets are tracked: attitudes that allow it, and joints that then follow.

A terminal can follow its target whatever the platform does: its yaw and pitch are the angles toward it. An
instrument imposes two equations on the attitude and a drive one: with the target ``s = R^T e`` in body axes,
``e`` in inertial ones, the instrument's ``c . s = 0`` for two directions ``c`` across its boresight, and the
drive's ``a . s = sin(tilt)`` for its axis ``a``. By a turn ``R exp(z^)`` they change by ``(c x s) . z``.
Devices without a target keep their joints, or have them among the unknowns.

Shapes: K instants, k devices with targets, J joints, m equations, Z rows of constraints. Times are seconds
from the timeline's start on; attitudes are body to inertial, angles in radians.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import separation
from jaxplan.model.constraints import (
    Constraints,
    axes_in_body,
    best_entries,
    joint_values,
    pair_margins,
)
from jaxplan.model.directions import DirectionPath, Sights, as_path
from jaxplan.model.gimbals import TURN, angles_along, in_range
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft

_MAX_NEWTON_STEPS = 12  # most steps of Newton's method; it doubles its digits in each
_EQUATION_TOLERANCE = 1e-13  # most error of an equation of unit vectors; rounding allows no less
_MIN_SINE = 1e-9  # sine of an angle below which the axis of a turn from one direction to another is undefined
_MAX_CACHED = 8  # most sets of instants for which directions are cached
_MAX_STEP_ANGLE = 0.5  # rad, most that a step turns, since equations are linear only near a solution


@dataclass(frozen=True, kw_only=True, eq=False)
class Pursuit:
    """Devices with the targets that they follow, and constraints that must hold meanwhile.

    Attributes:
        craft: the spacecraft with the ranges and limits that may be used.
        rows: the constraints.
        devices: indices of the k devices with targets, as of `Spacecraft.device_names`.
        paths: the k directions of their targets over time.
    """

    craft: Spacecraft
    rows: Constraints
    devices: tuple[int, ...]
    paths: tuple[DirectionPath, ...]
    _cache: dict[bytes, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, craft: Spacecraft, rows: Constraints, targets: Targets | None) -> "Pursuit":
        """Return the pursuit of targets; with None no device has a target."""
        if targets is None:
            return cls(craft=craft, rows=rows, devices=(), paths=())
        return cls(craft=craft, rows=rows, devices=targets.numbers(craft), paths=targets.paths)

    @cached_property
    def own_joints(self) -> np.ndarray:
        """Indices of the joints of devices with targets, which these determine."""
        gimbals = self.craft.gimbals
        own = [gimbals.joints_of(number) for number in self.devices if number < gimbals.count]
        return np.concatenate([np.zeros(0, int), *own]).astype(int)

    @cached_property
    def equations(self) -> int:
        """Number m of equations that the targets impose on an attitude."""
        gimbals = self.craft.gimbals
        return sum(2 if n >= gimbals.count else 1 if n >= gimbals.terminals else 0 for n in self.devices)

    @cached_property
    def sights(self) -> Sights:
        """The directions that the constraints bind."""
        return self.rows.sights(self.craft.gimbals, self.craft.fixed_boresights)

    def directions(self, times: np.ndarray) -> np.ndarray:
        """Directions of the targets at times (K,), s: (K, k, 3) inertial unit vectors."""
        return self._directions_and_axes(times)[0]

    def _directions_and_axes(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions (K, k, 3) of targets and axes (K, Z, 3) of constraints at times (K,), cached."""
        key = times.tobytes()
        if key not in self._cache:
            seen = [np.asarray(as_path(path).at(times)) for path in self.paths]
            directions = np.stack(seen, axis=1) if seen else np.zeros((len(times), 0, 3))
            if len(self._cache) >= _MAX_CACHED:
                self._cache.clear()
            self._cache[key] = directions, np.asarray(self.rows.axes(times))
        return self._cache[key]

    def residuals(self, attitudes: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the equations that targets impose on attitudes; zero means that all devices can point.

        Args:
            attitudes: (K, 3, 3).
            times: (K,) s.

        Returns:
            Values (K, m), and their derivatives (K, m, 3) by turns ``z`` of ``R exp(z^)``.
        """
        gimbals, craft = self.craft.gimbals, self.craft
        seen = self.directions(times) @ attitudes  # in body axes
        values, slopes = [np.zeros((len(times), 0))], [np.zeros((len(times), 0, 3))]
        for place, number in enumerate(self.devices):
            if number < gimbals.terminals:
                continue
            if number >= gimbals.count:
                boresight = craft.fixed_boresights[number - gimbals.count]
                across, wanted = np.linalg.svd(boresight[None])[2][1:], np.zeros(2)
            else:
                drive = number - gimbals.terminals
                across = gimbals.frames[number][:, 2][None]
                wanted = np.sin(np.atleast_1d(gimbals.tilts[drive]))
            own = seen[:, place]
            values.append(own @ across.T - wanted)
            slopes.append(np.cross(across[None], own[:, None]))
        return np.concatenate(values, axis=1), np.concatenate(slopes, axis=1)

    def meeting(self, attitudes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the attitudes (K, 3, 3) near given ones from which all devices can point at their targets.

        If there are none, as when two instruments cannot point as they are asked to, the equations hold as
        well as they can in the sense of least squares.
        """
        turned = np.asarray(attitudes, float)
        if not self.equations:
            return turned
        turned = self._turn_toward_target(turned, times)
        for _ in range(_MAX_NEWTON_STEPS):
            value, slope = self.residuals(turned, times)
            if np.all(np.abs(value) <= _EQUATION_TOLERANCE):
                break
            step = -(np.linalg.pinv(slope, rcond=1e-9) @ value[..., None])[..., 0]
            size = np.linalg.norm(step, axis=-1, keepdims=True)
            turned = turned @ so3.exp(step * np.minimum(1, _MAX_STEP_ANGLE / np.maximum(size, 1e-300)))
        return turned

    def _turn_toward_target(self, attitudes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Turn attitudes (K, 3, 3) until the first instrument with a target points there, if it is far off.

        Its equations hold with its back to the target, too, so Newton's method might turn it that way.
        """
        gimbals = self.craft.gimbals
        fixed = [place for place, number in enumerate(self.devices) if number >= gimbals.count]
        if not fixed:
            return attitudes
        seen = (self.directions(times) @ attitudes)[:, fixed[0]]
        boresight = self.craft.fixed_boresights[self.devices[fixed[0]] - gimbals.count]
        axis, cosine = np.cross(boresight, seen), seen @ boresight
        sine = np.linalg.norm(axis, axis=1)
        across = np.linalg.svd(boresight[None])[2][1]
        axis = np.where(sine[:, None] > _MIN_SINE, axis / np.maximum(sine, _MIN_SINE)[:, None], across)
        angle = np.arctan2(sine, cosine)
        turn = so3.exp(np.where(angle > _MAX_STEP_ANGLE, angle, 0.0)[:, None] * axis)
        return np.asarray(attitudes @ turn)

    def joints(self, attitudes: np.ndarray, times: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Return joints (K, J), rad, with which devices point at their targets.

        Args:
            attitudes: (K, 3, 3).
            times: (K,) s.
            rest: (J,) or (K, J) rad, joints of the other devices; if a yaw may be whole turns away, the one
                nearest to its value here is taken.
        """
        gimbals = self.craft.gimbals
        found = np.array(np.broadcast_to(rest, (len(times), self.craft.joint_count)), float)
        places = [place for place, number in enumerate(self.devices) if number < gimbals.count]
        if not places:
            return found
        numbers = np.array([self.devices[place] for place in places])
        seen = (self.directions(times) @ attitudes)[:, places]
        azimuth, elevation = angles_along(gimbals.frames[numbers], seen)
        yaws = gimbals.yaws[numbers]
        found[:, yaws] = in_range(azimuth, self.craft.joint_ranges[yaws], found[:, yaws])
        lifting = numbers < gimbals.terminals
        found[:, gimbals.pitches[numbers[lifting]]] = elevation[:, lifting]
        return found

    def unwrapped(self, joints: np.ndarray) -> np.ndarray:
        """Return joints (K, J) with whole turns added so that no yaw with a target jumps in time."""
        yaws = np.intersect1d(self.own_joints, self.craft.gimbals.yaws)
        smooth = np.array(joints)
        smooth[:, yaws] = np.unwrap(smooth[:, yaws], axis=0, period=TURN)
        return smooth

    def margins(self, attitudes: np.ndarray, joints: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Margins (K, p), rad, of all that must hold, negative where broken.

        They are those of single pairs of row and sight, then those of the best entry of each group.
        """
        rows, sights = self.rows, self.sights
        seen = sights.in_body(joints)
        values = joint_values(rows, sights.gimbals, joints) if rows.inner else None
        axes = axes_in_body(rows, self._directions_and_axes(times)[1] @ attitudes, seen)
        table = pair_margins(rows, seen, axes, values)
        row, sight = np.nonzero(rows.bound & rows.single[:, None])
        groups = np.flatnonzero((rows.group == np.arange(len(rows.group))) & ~rows.single)
        best = best_entries(rows, np.min(table, axis=-1, initial=np.inf))[:, groups]
        return np.asarray(np.concatenate([table[:, row, sight], best], axis=1))

    def errors(self, attitudes: np.ndarray, joints: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Angles (K, k), rad, between the devices' boresights and their targets."""
        craft = self.craft
        moving = craft.gimbals.boresights(joints)
        still = np.broadcast_to(craft.fixed_boresights, (len(times), *craft.fixed_boresights.shape))
        beams = np.concatenate([moving, still], axis=1)[:, list(self.devices)]
        return np.asarray(separation(np.einsum("kij,kdj->kdi", attitudes, beams), self.directions(times)))
