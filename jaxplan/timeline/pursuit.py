"""What must point where while targets are tracked: attitudes that allow it, and the joints that follow.

A terminal can follow its target whatever the platform does: its yaw and pitch are the angles toward it. An
instrument asks two numbers of the attitude and a drive one: with the target ``s = R^T e`` in body axes, the
instrument's ``c . s = 0`` for two directions ``c`` across its boresight, and the drive's
``a . s = sin(tilt)`` for its axis ``a``. By a turn ``R exp(z^)`` they change by ``(c x s) . z``. Devices that
have no target keep their joints, or have them among the unknowns.

Shapes: K instants, k devices with targets, J joints, m equations. Times are seconds from the timeline's
start on; attitudes are body to inertial, angles in radians.
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

_NEWTON = 12  # most steps of Newton's method; it doubles its digits in each
_MET = 1e-13  # of an equation, of which unit vectors are; rounding allows no less
_ALIKE = 1e-9  # sine of an angle below which two directions have no axis between them
_KEPT = 8  # sets of instants for which directions are kept
_FARTHEST = 0.5  # rad, most that a step turns, since equations are linear near a solution alone


@dataclass(frozen=True, kw_only=True, eq=False)
class Pursuit:
    """Devices with the targets that they follow, and constraints that must hold meanwhile.

    Attributes:
        craft: with the ranges and limits that may be used.
        rows: the constraints.
        devices: numbers (k,) of the devices with targets, as of `Spacecraft.device_names`.
        paths: (k) of their targets.
    """

    craft: Spacecraft
    rows: Constraints
    devices: tuple[int, ...]
    paths: tuple[DirectionPath, ...]
    _known: dict[bytes, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, craft: Spacecraft, rows: Constraints, targets: Targets | None) -> "Pursuit":
        """The pursuit of targets; without any, nothing must point anywhere."""
        if targets is None:
            return cls(craft=craft, rows=rows, devices=(), paths=())
        return cls(craft=craft, rows=rows, devices=targets.numbers(craft), paths=targets.paths)

    @cached_property
    def own_joints(self) -> np.ndarray:
        """Numbers of the joints that targets decide on."""
        gimbals = self.craft.gimbals
        own = [gimbals.joints_of(number) for number in self.devices if number < gimbals.count]
        return np.concatenate([np.zeros(0, int), *own]).astype(int)

    @cached_property
    def equations(self) -> int:
        """How many numbers targets ask of the attitude, m."""
        gimbals = self.craft.gimbals
        return sum(2 if n >= gimbals.count else 1 if n >= gimbals.terminals else 0 for n in self.devices)

    @cached_property
    def sights(self) -> Sights:
        """What the constraints bind."""
        return self.rows.sights(self.craft.gimbals, self.craft.fixed_boresights)

    def directions(self, times: np.ndarray) -> np.ndarray:
        """Directions (K, k, 3) of the targets at times (K,), inertial unit vectors."""
        return self._at(times)[0]

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions (K, k, 3) of targets and axes (K, Z, 3) of constraints; kept for nodes that stay."""
        key = times.tobytes()
        if key not in self._known:
            seen = [np.asarray(as_path(path).at(times)) for path in self.paths]
            directions = np.stack(seen, axis=1) if seen else np.zeros((len(times), 0, 3))
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = directions, np.asarray(self.rows.axes(times))
        return self._known[key]

    def residuals(self, attitudes: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What targets ask of attitudes, which is zero where these allow all devices to point.

        Args:
            attitudes: (K, 3, 3).
            times: (K,).

        Returns:
            (K, m), and derivatives (K, m, 3) by turns ``z`` of ``R exp(z^)``.
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
        """The attitudes (K, 3, 3) near given ones from which all devices can point at their targets.

        Where there are none, as two instruments cannot point as they are asked to, it is those of least
        squares.
        """
        turned = np.asarray(attitudes, float)
        if not self.equations:
            return turned
        turned = self._turned_about(turned, times)
        for _ in range(_NEWTON):
            value, slope = self.residuals(turned, times)
            if np.all(np.abs(value) <= _MET):
                break
            step = -(np.linalg.pinv(slope, rcond=1e-9) @ value[..., None])[..., 0]
            size = np.linalg.norm(step, axis=-1, keepdims=True)
            turned = turned @ so3.exp(step * np.minimum(1, _FARTHEST / np.maximum(size, 1e-300)))
        return turned

    def _turned_about(self, attitudes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Attitudes (K, 3, 3) turned until the first instrument with a target points there, if it is far off.

        Its equations hold with its back to the target, too.
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
        axis = np.where(sine[:, None] > _ALIKE, axis / np.maximum(sine, _ALIKE)[:, None], across)
        angle = np.arctan2(sine, cosine)
        turn = so3.exp(np.where(angle > _FARTHEST, angle, 0.0)[:, None] * axis)
        return np.asarray(attitudes @ turn)

    def joints(self, attitudes: np.ndarray, times: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Joints (K, J) with which devices point at their targets.

        Args:
            attitudes: (K, 3, 3).
            times: (K,).
            rest: (K, J), joints of the others; of yaws that may be whole turns apart the nearest to it is
                taken.
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
        """Joints (K, J) in which no yaw that follows a target jumps by a whole turn from one to the next."""
        yaws = np.intersect1d(self.own_joints, self.craft.gimbals.yaws)
        smooth = np.array(joints)
        smooth[:, yaws] = np.unwrap(smooth[:, yaws], axis=0, period=TURN)
        return smooth

    def margins(self, attitudes: np.ndarray, joints: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Margins (K, p) rad of all that must hold: of pairs of row and sight, and of the best of a group."""
        rows, sights = self.rows, self.sights
        seen = sights.in_body(joints)
        values = joint_values(rows, sights.gimbals, joints) if rows.inner else None
        axes = axes_in_body(rows, self._at(times)[1] @ attitudes, seen)
        table = pair_margins(rows, seen, axes, values)
        row, sight = np.nonzero(rows.bound & rows.single[:, None])
        groups = np.flatnonzero((rows.group == np.arange(len(rows.group))) & ~rows.single)
        best = best_entries(rows, np.min(table, axis=-1, initial=np.inf))[:, groups]
        return np.asarray(np.concatenate([table[:, row, sight], best], axis=1))

    def errors(self, attitudes: np.ndarray, joints: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Angles (K, k) rad between the devices' boresights and their targets."""
        craft = self.craft
        moving = craft.gimbals.boresights(joints)
        still = np.broadcast_to(craft.fixed_boresights, (len(times), *craft.fixed_boresights.shape))
        beams = np.concatenate([moving, still], axis=1)[:, list(self.devices)]
        return np.asarray(separation(np.einsum("kij,kdj->kdi", attitudes, beams), self.directions(times)))
