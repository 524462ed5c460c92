"""Directions: inertial ones that stand still or move, and sights, which are fixed to a device or the body.

**Directions over time** are inertial, such as that of a target or of a zone's axis; some do not move. Between
its samples a direction follows the cubic spline ``s`` through them, scaled to unit length:

    e(t) = s(t) / norm(s(t)),        e'(t) = (s' - (s' . e) e) / norm(s).

``s`` has two continuous derivatives, and also a third one across the second and the last but one sample
(not-a-knot). It passes through every sample. Its error is of the fourth order in the time between samples:
for a neighbour in low orbit that is sampled every 10 s it is about 1e-9 rad. Times are seconds from the start
of the manoeuvre.

**Sights** are the directions that pointing constraints bind. A sight is the boresight of a device, an axis of
the body, or another vector that is fixed to the moving part of a device. Array shapes: S is the number of
sights, in the order devices (terminals, drives, instruments), axes of the body, vectors of moving parts. The
first g sights are the boresights of the g gimbals, which are n terminals and d drives with 2n + d joints.
Everything computes with numpy or with JAX, depending on its arguments.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, separation
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.gimbals import Gimbals
from jaxplan.model.hidden_spans import UNNAMED, Hidden
from jaxplan.runtime.arguments import floats
from jaxplan.runtime.at_once import at_once
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

Tree = TypeVar("Tree")

# Largest distance of the spline's control points from the first sample of their interval. It keeps the spline
# away from zero; a direction that turns farther between two samples is refused.
FARTHEST = 0.6
_REACH_SAMPLES = 65  # instants at which `reach` evaluates a path; with more its bound is sharper
_UNIT_TOLERANCE = 4 * np.finfo(float).eps  # by which the length of a unit vector may differ from one


@shown("times s", "samples", "slopes 1/s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionPath:
    """An inertial unit vector over time; `through` makes one from samples, `still` one that does not move.

    Attributes:
        samples: (n, 3) unit vectors.
        times: (n,) s from the start of the manoeuvre, rising; a single one if the direction stands still.
        slopes: (n, 3) 1/s, derivatives of the spline at the samples.
        hidden: spans of time in which what lies in this direction cannot be seen and so is no valid target.
        called: name of what lies there, for figures, events and the viewer; empty where it is not known.
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
        """Make the path that passes through samples.

        Args:
            times: (n,) s, strictly rising, at least two.
            samples: (n, 3) vectors whose length is 1 to within 1e-6; they are scaled to unit length.

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
        odd = np.abs(length - 1) > _UNIT_TOLERANCE  # the others keep their bits, as when a file is read
        p[odd] /= length[odd, None]
        path = cls(times=t, samples=p, slopes=np.asarray(CubicSpline(t, p)(t, 1)))
        far = path._bound_intervals()[0] > FARTHEST
        if np.any(far):
            raise ValueError(f"samples: {too_far(int(np.argmax(far)))}")
        return path

    @classmethod
    def still(cls, direction: ArrayLike) -> Self:
        """Make the path of a unit vector (3,) that stands still; it is known at all times."""
        _, unit = arrays(direction)
        return cls(times=np.zeros(1), samples=unit[None], slopes=np.zeros((1, 3)))

    @property
    def resplined(self) -> "DirectionPath":
        """The path that `through` makes of the samples, which are scaled to unit length, computed by JAX.

        So its slopes are functions of samples and times, and not numbers of their own.
        """
        if not self.moves:
            return self
        made: Any = _spline(jnp.asarray(self.times), jnp.asarray(self.samples))
        return replace(self, samples=made[0], slopes=made[1])

    @property
    def moves(self) -> bool:
        """Whether the direction changes with time."""
        return len(self.times) > 1

    @property
    def target(self) -> str:
        """Name of what lies there: `called`, else the name in the spans of `hidden`, else empty."""
        return self.called or min({span.target for span in self.hidden} - {UNNAMED}, default="")

    def at(self, time: ArrayLike) -> Any:
        """Return the direction at given times.

        Args:
            time: (...) s, within the times of the samples; any time for a direction that stands still.

        Returns:
            (..., 3) unit vectors, as an array of JAX if an argument is one or is traced. With JAX the result
            is NaN at times outside the samples.

        Raises:
            ValueError: if a time given to numpy lies outside the samples, since nothing is extrapolated.
        """
        if not self.moves:
            return self._repeat_over_times(self.samples[0], time)
        xp, value, _ = self._evaluate_spline(time)
        return value / xp.linalg.norm(value, axis=-1, keepdims=True)

    def rate(self, time: ArrayLike) -> Any:
        """Return the derivative of `at` with respect to time at times (...), s.

        Returns:
            (..., 3) 1/s, at right angles to the direction; its length is the rate of turn in rad/s.
        """
        if not self.moves:
            return self._repeat_over_times(self.slopes[0], time)
        xp, value, slope = self._evaluate_spline(time)
        length = xp.linalg.norm(value, axis=-1, keepdims=True)
        unit = value / length
        return (slope - xp.sum(slope * unit, axis=-1, keepdims=True) * unit) / length

    def largest_rate(self, first: float, last: float) -> float:
        """Return an upper bound, rad/s, of the rate of turn at all times from `first` to `last`, s."""
        if not self.moves:
            return 0.0
        far, speed = self._bound_intervals()
        within = (self.times[1:] >= first) & (self.times[:-1] <= last)
        return float(np.max((speed / (1 - far))[within]))

    def reach(self, axis: np.ndarray, first: float, last: float) -> float:
        """Return an upper bound, rad, of the angle between an axis and the path over a span of time.

        Args:
            axis: (3,) unit vector, inertial.
            first: s, start of the span.
            last: s, end of the span, not before `first`.
        """
        seen = self.at(np.linspace(first, last, _REACH_SAMPLES))
        apart = separation(axis, seen)
        between = self.largest_rate(first, last) * (last - first) / (_REACH_SAMPLES - 1) / 2
        return float(min(np.max(apart) + between, np.pi))

    def covers(self, last: float) -> bool:
        """Tell whether the direction is known from the start of the manoeuvre to the time `last`, s."""
        return not self.moves or bool(self.times[0] <= 0 and last <= self.times[-1])

    @staticmethod
    def _repeat_over_times(vector: ArrayLike, time: ArrayLike) -> Any:
        """Repeat a vector (3,) for each of the times (...), as (..., 3)."""
        xp, same = arrays(vector)
        return xp.broadcast_to(same, (*np.shape(time), 3))

    def _evaluate_spline(self, time: ArrayLike) -> tuple[Any, Any, Any]:
        """Evaluate the spline ``s``, which is not scaled to unit length, at times (...), s.

        Returns:
            The module (numpy or JAX), the value (..., 3) and the derivative (..., 3) 1/s.

        Raises:
            ValueError: if a time given to numpy lies outside the samples.
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
        # expanded about the nearer sample, so that the value at a sample has no rounding error
        late = u > 0.5
        v = u - 1
        value = xp.where(
            late, p1 + v * (m1 + v * (square + 3 * cube + v * cube)), p0 + u * (m0 + u * (square + u * cube))
        )
        slope = (m0 + u * (2 * square + 3 * u * cube)) / h
        if xp is jnp:
            value = jnp.where(outside[..., None], jnp.nan, value)
        return xp, value, slope

    def _bound_intervals(self) -> tuple[np.ndarray, np.ndarray]:
        """Bound the spline on each of its n - 1 intervals, by its Bezier control points.

        The spline lies in the convex hull of its control points, and its derivative in that of theirs.

        Returns:
            (n - 1,) largest distance of a control point from the first sample of the interval, and (n - 1,)
            1/s largest ``|s'|``.
        """
        h = np.diff(self.times)[:, None]
        p, m = self.samples, self.slopes
        points = np.stack([p[:-1], p[:-1] + h * m[:-1] / 3, p[1:] - h * m[1:] / 3, p[1:]])
        far = np.linalg.norm(points[1:] - points[0], axis=-1).max(axis=0)
        speed = np.linalg.norm(3 * np.diff(points, axis=0) / h, axis=-1).max(axis=0)
        return far, speed


@at_once(of_arrays=True)
def _spline(times: jax.Array, samples: jax.Array) -> jax.Array:
    """Return samples (n, 3) of length one, and the slopes there of the spline through them, as (2, n, 3)."""
    units = samples / jnp.linalg.norm(samples, axis=1, keepdims=True)
    return jnp.stack([units, _spline_slopes(times, units)])


def _spline_slopes(times: jax.Array, samples: jax.Array) -> jax.Array:
    """Return the derivatives (n, 3), 1/s, at the samples of the cubic spline through n of them.

    With ``h`` the times between samples and ``c`` the chords' slopes, its second derivative is continuous if

        h[i] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i-1] m[i+1] = 3 (h[i] c[i-1] + h[i-1] c[i]),

    and a condition at either end makes the third one so across the next sample.
    """
    h = jnp.diff(times)[:, None]
    c = jnp.diff(samples, axis=0) / h
    if len(times) == 2:
        return jnp.concatenate([c, c])
    before, after, none = h[:-1], h[1:], jnp.zeros((1, 1))
    first, second, start = _end_condition(h, c)
    last, last_but_one, end = _end_condition(h[::-1], c[::-1])
    lower = jnp.concatenate([none, after, last_but_one])
    diagonal = jnp.concatenate([first, 2 * (before + after), last])
    upper = jnp.concatenate([second, before, none])
    right = jnp.concatenate([start, 3 * (after * c[:-1] + before * c[1:]), end])
    return jax.lax.linalg.tridiagonal_solve(lower[:, 0], diagonal[:, 0], upper[:, 0], right)


def _end_condition(h: jax.Array, c: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return the condition on the slopes at an end of a spline, with times and chords counted from there.

    Returns:
        The factors (1, 1) of the slopes at the first sample and at the second, and the right side (1, 3).
    """
    if len(h) == 2:  # a parabola through three samples
        return jnp.ones((1, 1)), jnp.ones((1, 1)), 2 * c[:1]
    first, second = h[:1], h[1:2]
    both = first + second
    return second, both, ((first + 2 * both) * second * c[:1] + first**2 * c[1:2]) / both


def resplined(tree: Tree) -> Tree:
    """Return a tree with the moving paths in it `resplined`, so that slopes follow from samples and times."""
    made: Tree = jax.tree.map(
        lambda leaf: leaf.resplined if isinstance(leaf, DirectionPath) else leaf,
        tree,
        is_leaf=lambda leaf: isinstance(leaf, DirectionPath),
    )
    return made


def as_path(direction: ArrayLike | DirectionPath) -> DirectionPath:
    """Return a direction as a path: a unit vector (3,) as one that stands still, a path as it is."""
    return direction if isinstance(direction, DirectionPath) else DirectionPath.still(direction)


def too_far(interval: int) -> str:
    """Text of the message that a direction turns too far between sample `interval` and the next one."""
    return f"the direction turns too far between the samples {interval} and {interval + 1}: give more samples"


@shown("gimbals", "fixed", "carrier", "carried")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """The directions that constraints bind, with what carries them; shapes are as in the module's docstring.

    Attributes:
        gimbals: the devices with joints, whose boresights are the first sights.
        fixed: (f, 3) unit vectors in body axes: boresights of the instruments, then axes of the body.
        carrier: (v,) int, number of the gimbal to whose moving part each of v further vectors is fixed.
        carried: (v, 3) these vectors, as components along their gimbal's boresight, to its left and upward,
            which do not change as the joints move.
    """

    gimbals: Gimbals
    fixed: np.ndarray
    carrier: np.ndarray
    carried: np.ndarray

    @property
    def count(self) -> int:
        """Number S of sights, the directions that constraints bind."""
        return self.gimbals.count + self.fixed.shape[0] + self.carried.shape[0]

    @property
    @made_once
    def carriers(self) -> AnyArray:
        """(S,) int, number of the gimbal to whose moving part each sight is fixed.

        It is -1 for a sight that the body carries.
        """
        xp = array_module(self.carrier)
        own, still = xp.arange(self.gimbals.count), xp.full(self.fixed.shape[0], -1)
        return xp.concatenate([own, still, xp.asarray(self.carrier, int)])

    @property
    @made_once
    def turning(self) -> AnyArray:
        """(2, S): 1 where the yaw (row 0) or the pitch (row 1) of its gimbal turns a sight, else 0.

        A drive's angle counts as a yaw.
        """
        xp = array_module(self.carrier)
        carriers: AnyArray = self.carriers
        return xp.stack([carriers >= 0, (carriers >= 0) & (carriers < self.gimbals.terminals)]).astype(float)

    def in_body(self, joints: ArrayLike) -> AnyArray:
        """Return all sights (..., S, 3), unit vectors in body axes, at joints (..., 2n + d) rad.

        That is equation (13), for sights that joints turn.
        """
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
        """Turn the v further vectors of moving parts by the angles of their gimbals.

        Args:
            ca: (..., v, ...) cosine of the azimuth of each vector's gimbal.
            sa: (..., v, ...) sine of the azimuth.
            ce: (..., v, ...) cosine of the elevation.
            se: (..., v, ...) sine of the elevation.
            behind: number of array axes that follow the axis of the vectors.

        Returns:
            The three components (..., v, ...) in the axes that the gimbals have at zero angles.
        """
        _, own = arrays(self.carried)
        return vectors.carried([part.reshape(-1, *(1,) * behind) for part in own.T], ca, sa, ce, se)

    def bounds(self, joint_change: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """Bound the derivatives of sights in body axes over a motion whose joints change at constant rates.

        With ``y = |dyaw|`` and ``p = |dpitch|`` a vector of the moving part turns about the yaw axis and
        about one at right angles to it, so its rate is at most ``hypot(y, p)``, and its second derivative is
        at most the square of that plus ``y p``. By equation (13) the square of the boresight's second
        derivative is linear in ``cos^2 pitch``, and at most ``(y^2 + p^2)^2`` (pitch 0) or
        ``p^2 (p^2 + 4 y^2)`` (pitch 90 deg).

        Args:
            joint_change: (..., 2n + d) rad, change of the joints over the whole motion.

        Returns:
            (..., S) upper bounds of the length of the first derivative, and (..., S) of the second, with
            respect to the fraction of the motion, which goes from 0 to 1.
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
