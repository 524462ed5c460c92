"""Directions: inertial ones that stand still or move, and sights, which are fixed to a device or the body.

**Directions over time** are inertial, of a target or a zone; a fixed one stands still. Between its samples a
direction follows the cubic spline through them, brought to unit length:

    e(t) = s(t) / norm(s(t)),        e'(t) = (s' - (s' . e) e) / norm(s),

``s`` with two continuous derivatives, and a third one over the first and the last two intervals (not-a-knot).
It passes every sample, and is off by the fourth power of the time between them: of a neighbour in low orbit
that is sampled every 10 s by about 1e-9 rad. Times are seconds from the start of the manoeuvre on.

**Sights** are what pointing constraints bind, fixed to what carries them. A sight is the boresight of a
device, an axis of the body, or another vector of a device's moving part. Shapes: S sights, devices first
(terminals, drives, instruments), then axes of the body, then vectors of moving parts; g gimbals, which are
the first sights. All of it computes with numpy or JAX, as its arguments do.
"""

from dataclasses import dataclass, field
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, separation
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.gimbals import Gimbals
from jaxplan.model.hidden import UNNAMED, Hidden
from jaxplan.runtime.arguments import floats
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

# Largest distance of the spline's control points from the sample before them, so that it stays off zero;
# and what turns farther between two samples is refused.
FARTHEST = 0.6
_PLACES = 65  # instants at which `reach` evaluates a path; with more its bound is sharper
_ROUNDING = 4 * np.finfo(float).eps  # by which the length of a unit vector may differ from one


@shown("times s", "samples", "slopes 1/s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionPath:
    """A direction over time; `through` makes it from samples, `still` of one that does not move.

    Attributes:
        samples: (n, 3) unit vectors.
        times: (n,) s, rising; a single one of a direction that stands still.
        slopes: (n, 3) 1/s, derivatives of the spline at the samples.
        hidden: when what is there cannot be seen, and so is no target.
        called: name of what is there, for figures, events and the viewer; empty where it is not known.
    """

    samples: np.ndarray = field(
        metadata=key("direction_samples", "unit vectors over times_s, of an axis that moves", kind="samples")
    )
    times: np.ndarray = field(
        metadata=key(
            "times_s",
            "of direction_samples; 0 where the manoeuvre starts",
            "[-1e7, 1e7]",
            kind="sample times",
        )
    )
    slopes: np.ndarray = field(metadata=key("", kind="slopes"))
    hidden: tuple[Hidden, ...] = keyed((), "hidden", "when what is there is hidden, of a target", static=True)
    called: str = keyed(
        "", "target", "name of what is there, for figures and events", kind="target name", static=True
    )

    @classmethod
    def through(cls, times: ArrayLike, samples: ArrayLike) -> Self:
        """The path through samples.

        Args:
            times: (n,) s, rising, at least two.
            samples: (n, 3) unit vectors to 1e-6, brought to unit length.

        Raises:
            ValueError: if shapes or numbers are wrong, or the direction turns too far between two samples.
        """
        from scipy.interpolate import CubicSpline  # slow to import, so not at the top

        t = floats("times", times, "an array of numbers of seconds")
        p = floats("samples", samples, "an array of unit vectors")
        if t.ndim != 1 or len(t) < 2 or p.shape != (len(t), 3):
            raise ValueError(
                f"times and samples: must be (n,) and (n, 3), n at least 2, not {t.shape} and {p.shape}"
            )
        if not np.all(np.isfinite(t)):
            i = int(np.argmin(np.isfinite(t)))
            raise ValueError(f"times[{i}] = {t[i]}: must be finite")
        if not np.all(np.diff(t) > 0):
            i = int(np.argmin(np.diff(t) > 0)) + 1
            raise ValueError(f"times[{i}] = {t[i]}: must rise, and be later than {t[i - 1]}")
        length = np.linalg.norm(p, axis=1)
        if not np.all(np.abs(length - 1) <= 1e-6):
            i = int(np.argmin(np.abs(length - 1) <= 1e-6))
            raise ValueError(f"samples[{i}] = {p[i].tolist()}: must be a unit vector, to 1e-6")
        odd = np.abs(length - 1) > _ROUNDING  # the others keep their bits, as when a file is read
        p[odd] /= length[odd, None]
        path = cls(times=t, samples=p, slopes=np.asarray(CubicSpline(t, p)(t, 1)))
        far = path._spread()[0] > FARTHEST
        if np.any(far):
            raise ValueError(f"samples: {too_far(int(np.argmax(far)))}")
        return path

    @classmethod
    def still(cls, direction: ArrayLike) -> Self:
        """The path of a direction (3,) that stands still; it is known at all times."""
        _, unit = arrays(direction)
        return cls(times=np.zeros(1), samples=unit[None], slopes=np.zeros((1, 3)))

    @property
    def moves(self) -> bool:
        """Whether the direction changes with time."""
        return len(self.times) > 1

    @property
    def target(self) -> str:
        """Name of what is there: its own, or else that which spans carry when it is hidden; perhaps empty."""
        return self.called or min({span.target for span in self.hidden} - {UNNAMED}, default="")

    def at(self, time: ArrayLike) -> Any:
        """The direction at some times.

        Args:
            time: (...) s within the samples'.

        Returns:
            (..., 3) unit vectors; arrays of JAX where one is given or traced, NaN at a time outside.

        Raises:
            ValueError: if a time, of numpy, is outside: nothing is extrapolated.
        """
        if not self.moves:
            return self._everywhere(self.samples[0], time)
        xp, value, _ = self._spline(time)
        return value / xp.linalg.norm(value, axis=-1, keepdims=True)

    def rate(self, time: ArrayLike) -> Any:
        """Derivative of `at` by time at some times (...), s.

        Returns:
            (..., 3) 1/s, across the direction; its length is the rate of turn in rad/s.
        """
        if not self.moves:
            return self._everywhere(self.slopes[0], time)
        xp, value, slope = self._spline(time)
        length = xp.linalg.norm(value, axis=-1, keepdims=True)
        unit = value / length
        return (slope - xp.sum(slope * unit, axis=-1, keepdims=True) * unit) / length

    def largest_rate(self, first: float, last: float) -> float:
        """Upper bound, rad/s, of the rate of turn at all times from `first` to `last`, s."""
        if not self.moves:
            return 0.0
        far, speed = self._spread()
        within = (self.times[1:] >= first) & (self.times[:-1] <= last)
        return float(np.max((speed / (1 - far))[within]))

    def reach(self, axis: np.ndarray, first: float, last: float) -> float:
        """Upper bound, rad, of the angle between an axis and the path at all times between two.

        Args:
            axis: (3,) unit vector.
            first: s.
            last: s, not before.
        """
        seen = self.at(np.linspace(first, last, _PLACES))
        apart = separation(axis, seen)
        between = self.largest_rate(first, last) * (last - first) / (_PLACES - 1) / 2
        return float(min(np.max(apart) + between, np.pi))

    def covers(self, last: float) -> bool:
        """Whether the direction is known from the start of the manoeuvre to the time `last`, s."""
        return not self.moves or bool(self.times[0] <= 0 and last <= self.times[-1])

    @staticmethod
    def _everywhere(vector: ArrayLike, time: ArrayLike) -> Any:
        """A vector (3,), repeated for each of times (...): (..., 3)."""
        xp, same = arrays(vector)
        return xp.broadcast_to(same, (*np.shape(time), 3))

    def _spline(self, time: ArrayLike) -> tuple[Any, Any, Any]:
        """The module (numpy or JAX), and value (..., 3) and derivative (..., 3) 1/s of the spline ``s``.

        Raises:
            ValueError: if a time, of numpy, is outside the samples'.
        """
        if not isinstance(time, jax.Array):
            time = floats("time", time, "a number of seconds, or an array of them")
        xp, t, times, p, m = arrays(time, self.times, self.samples, self.slopes)
        outside = ~((t >= times[0]) & (t <= times[-1]))
        if xp is np and np.any(outside):
            raise ValueError(
                f"time = {float(np.asarray(t)[outside].flat[0]):g}: "
                f"must lie in [{times[0]:g}, {times[-1]:g}] s, where the direction is known"
            )
        i = xp.clip(xp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        h = (times[i + 1] - times[i])[..., None]
        u = (t - times[i])[..., None] / h
        p0, p1, m0, m1 = p[i], p[i + 1], h * m[i], h * m[i + 1]
        square, cube = 3 * (p1 - p0) - 2 * m0 - m1, 2 * (p0 - p1) + m0 + m1
        # from the nearer sample on, so that each is passed without rounding
        late = u > 0.5
        v = u - 1
        value = xp.where(
            late, p1 + v * (m1 + v * (square + 3 * cube + v * cube)), p0 + u * (m0 + u * (square + u * cube))
        )
        slope = (m0 + u * (2 * square + 3 * u * cube)) / h
        if xp is jnp:
            value = jnp.where(outside[..., None], jnp.nan, value)
        return xp, value, slope

    def _spread(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest distance of control points from the first sample of each interval, and the largest |s'|.

        Both are (n - 1,), the latter in 1/s. The spline lies within the hull of its control points, and its
        derivative within that of theirs.
        """
        h = np.diff(self.times)[:, None]
        p, m = self.samples, self.slopes
        points = np.stack([p[:-1], p[:-1] + h * m[:-1] / 3, p[1:] - h * m[1:] / 3, p[1:]])
        far = np.linalg.norm(points[1:] - points[0], axis=-1).max(axis=0)
        speed = np.linalg.norm(3 * np.diff(points, axis=0) / h, axis=-1).max(axis=0)
        return far, speed


def as_path(direction: ArrayLike | DirectionPath) -> DirectionPath:
    """The path of a direction, which may be given as (3,) or as a path already."""
    return direction if isinstance(direction, DirectionPath) else DirectionPath.still(direction)


def too_far(interval: int) -> str:
    """The message that a direction turns too far in an interval, given by its number."""
    return f"the direction turns too far between the samples {interval} and {interval + 1}: give more samples"


@shown("gimbals", "fixed", "carrier", "carried")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """The directions that constraints bind, fixed to what carries them.

    Attributes:
        gimbals: of the devices with joints, whose boresights come first.
        fixed: (f, 3) unit vectors in body axes: boresights of the instruments, then axes of the body.
        carrier: (v,) int, the gimbal to whose moving part each further vector is fixed.
        carried: (v, 3) unit vectors along that device's boresight, to its left and upward, at any angles.
    """

    gimbals: Gimbals
    fixed: np.ndarray
    carrier: np.ndarray
    carried: np.ndarray

    @property
    def count(self) -> int:
        """Number of sights, S."""
        return self.gimbals.count + self.fixed.shape[0] + self.carried.shape[0]

    @property
    @made_once
    def carriers(self) -> AnyArray:
        """(S,) int, the gimbal to whose moving part each sight is fixed; -1 of those fixed to the body."""
        xp = array_module(self.carrier)
        own, still = xp.arange(self.gimbals.count), xp.full(self.fixed.shape[0], -1)
        return xp.concatenate([own, still, xp.asarray(self.carrier, int)])

    @property
    @made_once
    def turning(self) -> AnyArray:
        """(2, S) one where the yaw of its gimbal (row 0) or the pitch (row 1) turns a sight, else zero."""
        xp = array_module(self.carrier)
        carriers: AnyArray = self.carriers
        return xp.stack([carriers >= 0, (carriers >= 0) & (carriers < self.gimbals.terminals)]).astype(float)

    def in_body(self, joints: ArrayLike) -> AnyArray:
        """All sights (..., S, 3), unit vectors in body axes, at joints (..., 2n + d) rad, equation (13)."""
        xp, moving, fixed = arrays(self.gimbals.boresights(joints), self.fixed)
        still = xp.broadcast_to(fixed.astype(moving.dtype), (*moving.shape[:-2], *fixed.shape))
        seen = [moving, still]
        if self.carried.shape[0]:
            a, e = (part[..., self.carrier] for part in self.gimbals.angles(joints))
            own = xp.stack(self.carried_at(xp.cos(a), xp.sin(a), xp.cos(e), xp.sin(e)), axis=-1)
            _, frames = arrays(self.gimbals.frames)
            seen.append(xp.sum(frames[self.carrier] * own[..., None, :], axis=-1))
        return xp.concatenate(seen, axis=-2)

    def carried_at(
        self, ca: AnyArray, sa: AnyArray, ce: AnyArray, se: AnyArray, *, behind: int = 0
    ) -> vectors.Vector:
        """Components of the further vectors of moving parts, in the axes of their gimbals at zero angles.

        Args:
            ca: (..., v, ...) cosine of the azimuth of each vector's gimbal.
            sa: (..., v, ...) its sine.
            ce: (..., v, ...) cosine of the elevation.
            se: (..., v, ...) its sine.
            behind: number of axes behind that of the vectors.
        """
        _, own = arrays(self.carried)
        return vectors.carried([part.reshape(-1, *(1,) * behind) for part in own.T], ca, sa, ce, se)

    def bounds(self, joint_change: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """Bounds of the derivatives of sights in body axes while joints change at constant rates.

        With ``y = |dyaw|`` and ``p = |dpitch|`` a vector of the moving part turns about the yaw axis and one
        at right angles to it, so at ``hypot(y, p)`` at most, and its second derivative is at most the square
        of that plus ``y p``. That of the boresight, by equation (13), has a square that is linear in
        ``cos^2 pitch``: at most ``(y^2 + p^2)^2`` (pitch 0) or ``p^2 (p^2 + 4 y^2)`` (pitch 90 deg).

        Args:
            joint_change: (..., 2n + d) rad over the motion.

        Returns:
            (..., S) each: bounds of the first and second derivative in the share of the motion.
        """
        xp, given = arrays(joint_change)
        yaw, pitch = self.gimbals.parts(xp.abs(given))
        rate = length(xp.stack([yaw, pitch], axis=-1))
        bend = xp.maximum(rate * rate, pitch * length(xp.stack([pitch, 2 * yaw], axis=-1)))
        still = xp.zeros((*given.shape[:-1], self.fixed.shape[0]), given.dtype)
        rates, bends = [rate, still], [bend, still]
        if self.carried.shape[0]:
            rates.append(rate[..., self.carrier])
            bends.append((rate * rate + yaw * pitch)[..., self.carrier])
        return xp.concatenate(rates, axis=-1), xp.concatenate(bends, axis=-1)
