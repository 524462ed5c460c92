"""Whole-motion checkers for OMPL: is the straight motion between two states clear of all zones?

A motion is a pair of states, each as OMPL's compound state space serializes it: quaternion x, y, z, w, then
the joints (rad). It turns along the geodesic with linear joints, as those of `jaxplan.model.path` do, and
is sampled so that platform and joints move by at most the resolution from one sample to the next. A row of a
zone table is ``axis (3), cosine of the half-angle, side (+1 keep out, -1 keep in), 1 for each device bound``.

`compiled` is the fastest that a Python user gets, `vectorised` what numpy alone gives.
"""

from collections.abc import Callable

import numpy as np
from _options import MISSING

from jaxplan.search import Scene

try:
    import numba
except ModuleNotFoundError as missing:
    raise SystemExit(MISSING.format(missing.name, "bench")) from None

Checker = Callable[[np.ndarray, np.ndarray, np.ndarray, float], bool]
_STRIDE = 8  # every so many samples are taken first, so that a motion that is not clear is soon found out


def zone_table(scene: Scene) -> np.ndarray:
    """Rows (Z, 5 + n), as the module has them, of the zones that bind a terminal, without the padding."""
    cones = scene.cones
    rows = np.column_stack([cones.axis, np.cos(cones.half_angle), cones.side, cones.bound])
    return np.ascontiguousarray(rows[np.any(cones.bound, axis=1)], dtype=float)


@numba.njit
def compiled(motion: np.ndarray, mounts: np.ndarray, table: np.ndarray, resolution: float) -> bool:
    """Whether a motion (2, 4 + 2n) is clear at its samples, taken one after the other.

    Args:
        motion: its two states.
        mounts: (n,) rad, azimuth of each terminal in the body, to which its yaw adds.
        table: of `zone_table`.
        resolution: rad by which platform and joints move between samples.
    """
    first, last = motion[0], motion[1]
    count = len(mounts)
    cosine = first[0] * last[0] + first[1] * last[1] + first[2] * last[2] + first[3] * last[3]
    sign = 1.0 if cosine >= 0 else -1.0
    angle = np.arccos(min(abs(cosine), 1.0))  # half of the rotation
    sine = np.sin(angle)
    longest = 2 * angle
    for j in range(4, 4 + 2 * count):
        longest = max(longest, abs(last[j] - first[j]))
    samples = int(np.ceil(longest / resolution))
    for offset in (4, 0, 2, 6, 1, 3, 5, 7):
        for sample in range(offset, samples + 1, _STRIDE):
            part = sample / samples if samples else 0.0
            if sine > 1e-9:
                begin, end = np.sin((1 - part) * angle) / sine, sign * np.sin(part * angle) / sine
            else:
                begin, end = 1 - part, sign * part
            x = begin * first[0] + end * last[0]
            y = begin * first[1] + end * last[1]
            z = begin * first[2] + end * last[2]
            w = begin * first[3] + end * last[3]
            for device in range(count):
                yaw = mounts[device] + first[4 + device] + part * (last[4 + device] - first[4 + device])
                place = 4 + count + device
                pitch = first[place] + part * (last[place] - first[place])
                a, b, c = np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)
                p = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
                q = 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
                r = 2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c
                for zone in table:
                    if zone[5 + device] and zone[4] * (p * zone[0] + q * zone[1] + r * zone[2] - zone[3]) > 0:
                        return False
    return True


def vectorised(motion: np.ndarray, mounts: np.ndarray, table: np.ndarray, resolution: float) -> bool:
    """Whether a motion is clear, all samples at once in numpy; the arguments are those of `compiled`."""
    first, last = motion
    cosine = float(first[:4] @ last[:4])
    angle = np.arccos(min(abs(cosine), 1.0))  # half of the rotation
    longest = max(2 * angle, np.max(np.abs(last[4:] - first[4:])))
    part = np.linspace(0, 1, int(np.ceil(longest / resolution)) + 1)[:, None]
    begin, end = 1 - part, part
    if np.sin(angle) > 1e-9:
        begin, end = np.sin(begin * angle) / np.sin(angle), np.sin(end * angle) / np.sin(angle)
    turn = begin * first[:4] + np.where(cosine >= 0, end, -end) * last[:4]
    x, y, z, w = turn.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    to_inertial = np.array(rows).transpose(2, 0, 1)  # (samples, 3, 3), of row vectors
    joints = first[4:] + part * (last[4:] - first[4:])
    yaw, pitch = joints[:, : len(mounts)] + mounts, joints[:, len(mounts) :]
    level = np.cos(pitch)
    body = np.stack([level * np.cos(yaw), level * np.sin(yaw), np.sin(pitch)], axis=-1)
    cosines = body @ to_inertial @ table[:, :3].T  # (samples, devices, zones)
    broken = table[:, 4] * (cosines - table[:, 3]) > 0
    return not bool(np.any(broken & (table[:, 5:].T > 0)))
