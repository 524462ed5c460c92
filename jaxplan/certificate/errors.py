"""How far the polynomials through samples are off, and intervals on which that is next to nothing.

Interpolation. The polynomial of degree K through the samples at `motion.NODES` of an interval of half width
h is off by at most ``2^(1 - K) h^(K + 1) |f^(K+1)| / (K + 1)!``. Derivatives are bounded by majorants (see
`jets`). Let ``g`` be one of ``eta`` without its constant term. Then ``exp(g)`` is one of ``exp(eta^)``: in
the expansion around the constant every factor is a rotation, of norm one, or is bounded by ``g``. So with
``m = g + |Omega| t`` the attitude has the majorant ``exp(m)``, and the angular velocity, which is
``R^T R'``, the majorant ``exp(2 m) m'``. In body axes a boresight, or another vector of a terminal's moving
part, has the exponential of the majorants of its yaw and its pitch together, and what is fixed there is its
own majorant, one. In inertial axes ``m`` is added to the exponent. It is the scalar product of sight and axis
that is interpolated, so where both move the majorant is the product of theirs: the exponents of two sights
add up, and that of an inertial axis is in `axes`.

Rounding. Legendre sums err by a few units in the last place of their terms. How an error of ``eta`` moves
the rest follows from the same majorants, to first order; other steps are taken to err by a few units too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import perm

import numpy as np

from jaxplan.certificate import jets
from jaxplan.certificate.axes import Way
from jaxplan.certificate.motion import DEGREE, Intervals, Motion, Samples
from jaxplan.certificate.pieces import ROUNDING

# What a polynomial may be off, relative to what it is compared with: a hundredth of the allowances.
NEGLIGIBLE = 1e-11
_MOST_INTERVALS = 4000
_MOST_PARTS = 16
_ROUNDS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Bounds of errors on intervals.

    Attributes:
        direction: (S + k, n) of all sights as seen from inertial axes that may move, then of what is seen
            within the body (`motion.Views`).
        spin: (3, n) of the angular velocity and its two derivatives, rad/s, rad/s^2, rad/s^3.
        joints: (3, 2T, n) of the joints and their two derivatives, rad, rad/s, rad/s^2.
    """

    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Majorants:
    """Bounds of Taylor coefficients about any point of intervals, in the unit of their half widths h.

    Attributes:
        turning: (orders, n) ``m`` above, rad; zero at order zero.
        direction: (orders, S + k, n) of scalar products of sights with axes, as `Errors` has them.
        spin: (orders, n) of h times the angular velocity.
        joints: (orders, 2T, n) rad.
    """

    turning: np.ndarray
    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Samples of trajectories with all that is needed to speak for the time between them.

    Attributes:
        on: intervals that cover all the time of each, in its order.
        samples: of the motion at `motion.NODES` of each.
        majorants: of the motion on them.
        left_out: what the polynomials through the samples leave out.
        rounding: size of the samples' rounding errors.
    """

    on: Intervals
    samples: Samples
    majorants: Majorants
    left_out: Errors
    rounding: Errors


def _of_sights(motion: Motion, joints: np.ndarray) -> np.ndarray:
    """Yaw and pitch added for what moves with a terminal, else zero: (..., 2T, n) to (..., S, n)."""
    yaw, pitch = np.split(joints, 2, axis=-2)
    still = np.zeros((*yaw.shape[:-2], len(motion.fixed), yaw.shape[-1]))
    both = yaw + pitch
    return np.concatenate([both, still, both[..., motion.views.carrier, :]], axis=-2)


def _within(motion: Motion, of_sights: np.ndarray) -> np.ndarray:
    """The sums of a sight's and its axis' for what is seen within the body: (..., S, n) to (..., k, n)."""
    sight, axis = motion.views.within.T
    return of_sights[..., sight, :] + np.where(axis[:, None] < 0, 0, of_sights[..., axis, :])


def majorants(motion: Motion, on: Intervals, ways: Sequence[Way] = ()) -> Majorants:
    """Majorants of everything that moves, on some intervals, each within a piece of every way."""
    orders = DEGREE + 5
    centre = on.centre[:, None]
    unit = on.half ** np.arange(max(motion.platform.length, motion.joints.length, 2))[:, None]
    eta = motion.turn(on, centre, max(motion.platform.length, 2))[..., 0]
    turning = jets.majorant(np.linalg.norm(eta, axis=1) * unit[: len(eta)], orders)
    turning[1] += on.half * np.linalg.norm(motion.chart_rate[on.piece], axis=-1)
    turning[0] = 0
    joints = motion.joints.taylor(on.joint_piece, centre, motion.joints.length)[..., 0]
    moving = jets.majorant(np.abs(joints) * unit[: len(joints), None], orders)
    swinging = _of_sights(motion, moving)
    sweeping = np.concatenate([turning[:, None] + swinging, _within(motion, swinging)], axis=1)
    sweeping[0] = 0
    direction = jets.exponential(sweeping)
    if ways:
        swiftest = np.max([way.majorant(on.centre, on.half, orders) for way in ways], axis=0)
        outward = slice(swinging.shape[1])
        direction[:, outward] = jets.product("dn,n->dn", direction[:, outward], swiftest)
    spinning = jets.product("n,n->n", jets.exponential(2 * turning), jets.slope(turning))
    return Majorants(turning=turning, direction=direction, spin=spinning, joints=moving)


def interpolation(on: Intervals, bounds: Majorants) -> Errors:
    """What the polynomials through samples leave out."""
    factor = 2.0 ** (1 - DEGREE)
    order, unit = DEGREE + 1, on.half ** -np.arange(3.0)[:, None]
    spin = np.stack([perm(order + d, d) * bounds.spin[order + d] for d in range(3)])
    joints = np.stack([perm(order + d, d) * bounds.joints[order + d] for d in range(3)])
    return Errors(
        direction=factor * bounds.direction[order],
        spin=factor * spin * unit / on.half,
        joints=factor * joints * unit[:, None],
    )


def rounding(motion: Motion, on: Intervals, bounds: Majorants, ways: Sequence[Way] = ()) -> Errors:
    """Sizes of the rounding errors of samples, those of axes included."""
    unit = on.half ** np.arange(4)[:, None]
    eta = np.linalg.norm(motion.platform.rounding(on.piece, 4), axis=1) * unit
    eta[0] += ROUNDING
    lever = jets.slope(eta) + 2 * jets.product("n,n->n", jets.slope(bounds.turning[:4]), eta)
    spin = jets.product("n,n->n", jets.exponential(2 * bounds.turning[:3]), lever)
    joints = motion.joints.rounding(on.joint_piece, 3) + ROUNDING * bounds.joints[:3] / unit[:3, None]
    factorial = np.array([1, 1, 2])[:, None]
    of_axes = [np.zeros(len(on.half)), *(way.rounding(on.centre, on.half) for way in ways)]
    swung = _of_sights(motion, joints[0])
    outward, inward = eta[0] + swung + np.max(of_axes, axis=0), _within(motion, swung + ROUNDING)
    return Errors(
        direction=np.concatenate([outward, inward]),
        spin=factorial * (spin + ROUNDING * bounds.spin[:3]) / (unit[:3] * on.half),
        joints=factorial[:, None] * joints,
    )


def gather(motion: Motion, wanted: Errors, ways: Sequence[Way] = ()) -> Evidence:
    """Samples trajectories on intervals so short that the polynomials leave out at most as much as wanted.

    Args:
        motion: of one trajectory or of several.
        wanted: the errors that may remain, with the last axis for the trajectories. Where one would take too
            many intervals, larger ones do.
        ways: of the axes that move, where there is a single trajectory; they must be known all the time.
    """
    on = motion.pieces(ways)
    unsettled = np.ones(len(on.begins) - 1, dtype=bool)
    for left in reversed(range(_ROUNDS)):
        bounds = majorants(motion, on, ways)
        left_out = interpolation(on, bounds)
        # An error shrinks with the interval's power DEGREE + 1 at the least, so this rarely cuts too finely.
        parts = np.ceil(np.minimum(_excess(left_out, wanted, on) ** (1 / (DEGREE + 1)), _MOST_PARTS))
        before, after = np.diff(on.begins), np.add.reduceat(parts, on.begins[:-1])
        unsettled &= (after > before) & (after <= np.maximum(_MOST_INTERVALS, 2 * before))
        if left == 0 or not np.any(unsettled):
            break
        on = on.cut(np.where(unsettled[on.trajectory], parts, 1).astype(int))
    return Evidence(
        on=on,
        samples=motion.sample(on),
        majorants=bounds,
        left_out=left_out,
        rounding=rounding(motion, on, bounds, ways),
    )


def _excess(errors: Errors, wanted: Errors, on: Intervals) -> np.ndarray:
    """The worst ratio of an error to the one wanted on each interval, (n,), at least one."""
    ratios = (
        errors.direction / wanted.direction[:, on.trajectory],
        errors.spin / wanted.spin[:, on.trajectory],
        np.concatenate(errors.joints / wanted.joints[..., on.trajectory]),
    )
    return np.maximum(np.nan_to_num(np.concatenate(ratios), nan=np.inf).max(axis=0), 1)
