"""The nearest goals of many satellites at once: problem (7) from a few starts each, without zones.

`decompose` starts from as many attitudes as it takes to find the global minimum. This starts from four,
quarter turns about the body's z axis from the start; what has no answer then is left to `decompose`.
"""

import jax
import numpy as np

from jaxplan import quaternion
from jaxplan.decomposition import multistart
from jaxplan.decomposition.caps import assemble
from jaxplan.decomposition.descent import descent_ends
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import tabulate
from jaxplan.runtime.quick_jit import quick_jit

TOGETHER = 256
"""Problems of one call: there is one shape to compile."""
_HALF = np.sqrt(0.5)
_STARTS = np.array([[1.0, 0.0, 0.0, 0.0], [_HALF, 0, 0, _HALF], [_HALF, 0, 0, -_HALF], [0.0, 0, 0, 1.0]])


def nearest_attitudes(
    spacecraft: Spacecraft, start_attitudes: np.ndarray, directions: np.ndarray, joint_limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each satellite the attitude nearest to a given one at which its terminals see their targets.

    Args:
        spacecraft: the same for all.
        start_attitudes: (N, 3, 3) body to inertial, to which the answers are near.
        directions: (N, n, 3) inertial unit vectors, one a terminal.
        joint_limits: (2n,) rad.

    Returns:
        Attitudes (N, 3, 3), joints (N, 2n) within the limits, and (N,) bool whether they were found: without
        it an attitude may still exist.
    """
    count = len(start_attitudes)
    attitudes, joints = np.empty((count, 3, 3)), np.empty((count, len(joint_limits)))
    found = np.empty(count, dtype=bool)
    for first in range(0, count, TOGETHER):
        rows = np.arange(first, min(first + TOGETHER, count))
        padded = np.resize(rows, TOGETHER)
        part = _nearest(spacecraft, start_attitudes[padded], directions[padded], joint_limits)
        attitudes[rows], joints[rows], found[rows] = (values[: len(rows)] for values in part)
    return attitudes, np.clip(joints, -joint_limits, joint_limits), found


def _nearest(
    spacecraft: Spacecraft, starts: np.ndarray, directions: np.ndarray, limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nowhere = tabulate((), (), spacecraft.device_names)
    caps = assemble(spacecraft, starts[0], directions[0], limits, nowhere)  # the same caps for all
    used = np.repeat(directions, 5, axis=1) @ starts  # five caps a terminal, see `caps`
    toward = np.zeros((len(starts), *caps.direction.shape))
    toward[:, : used.shape[1]] = used
    with jax.enable_x64(True):
        ends = np.asarray(_descents(_STARTS.T, caps.axis, toward, caps.half_angle, caps.member, caps.group))
    quaternions, slew, excess, residual, curvature = ends[:, :4], *np.moveaxis(ends[:, 4:], 1, 0)
    good = multistart.is_minimum(slew, excess, residual, curvature, multistart.LAST_TOLERANCE)
    best = np.argmin(np.where(good, slew, np.inf), axis=-1)
    chosen = np.take_along_axis(quaternions, best[:, None, None], axis=-1)[..., 0]
    attitudes = starts @ quaternion.to_matrix(chosen)
    return attitudes, spacecraft.joints_toward(attitudes, directions), np.any(good, axis=-1)


_descents = quick_jit(jax.vmap(descent_ends, in_axes=(None, None, 0, None, None, None)))
