"""What holds at single instants: no jumps at breaks, the wanted states at both ends.

The samples of an interval include both of its ends, so the last of one and the first of the next are
the values left and right of the same instant.
"""

from collections.abc import Iterator

import numpy as np

from jaxplan.certificate.motion import Samples
from jaxplan.certificate.report import EndState

# Largest jump at a break and largest distance from a wanted state: rad, rad/s, rad/s^2, rad/s^3.
TOLERANCE = 1e-8
_PLATFORM = ("attitude", "angular_velocity", "angular_acceleration", "angular_jerk")
_JOINTS = ("joints", "joint_rates", "joint_accelerations", "joint_jerks")


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle between attitudes (3, 3, ...), rad, exact when small: the norm is ``sqrt(8) sin(angle / 2)``."""
    distance = np.linalg.norm((first - second).reshape(9, *first.shape[2:]), axis=0)
    return 2 * np.arcsin(np.minimum(distance / np.sqrt(8), 1))


def jumps(samples: Samples) -> dict[str, np.ndarray]:
    """Jumps by the names and units of `Report.jumps`, (n,) each: from every interval to the next.

    From the last one it is to the first, so that there are two at least (see `motion`).
    """
    found = {_PLATFORM[0]: _apart(samples.attitude[..., -1], np.roll(samples.attitude[..., 0], -1, axis=-1))}
    for names, curves in ((_PLATFORM[1:], samples.spin), (_JOINTS, samples.joints)):
        steps = np.abs(curves[..., -1] - np.roll(curves[..., 0], -1, axis=-1)).max(axis=1, initial=0)
        found |= dict(zip(names, steps, strict=True))
    return found


def jump_faults(
    found: dict[str, np.ndarray], times: np.ndarray, smoothness: int, jerk_limited: bool
) -> Iterator[str]:
    """A sentence for each quantity that jumps though it must not.

    Args:
        found: (k,) each, the jumps of a trajectory.
        times: (k,) s, when they are.
        smoothness: number of derivatives that the trajectory claims to be continuous; rates must be anyway.
        jerk_limited: whether the spacecraft limits the jerk, so that the angular acceleration must not jump.
    """
    for name, steps in found.items():
        order = (_PLATFORM if name in _PLATFORM else _JOINTS).index(name)
        needed = max(smoothness, 2 if jerk_limited and name in _PLATFORM else 1)
        if order <= needed and not np.all(steps <= TOLERANCE):
            worst = int(np.argmax(steps))
            unit = "rad" + ("", "/s", "/s^2", "/s^3")[order]
            time = times[worst]
            yield f"there is a jump of {steps[worst]:.3g} {unit} in {_words(name)} at t = {time:.6g} s"


def end_faults(samples: Samples, name: str, end: EndState, instant: tuple[int, int]) -> Iterator[str]:
    """A sentence for each part of a wanted state that the trajectory misses.

    Args:
        samples: of the motion.
        name: of the state, for the sentences.
        end: the wanted state.
        instant: its interval, and its number there.
    """
    at = (..., *instant)
    rest = np.zeros(3), np.zeros(samples.joints.shape[1])
    wanted_spin = rest[0] if end.angular_velocity is None else end.angular_velocity
    wanted_rates = rest[1] if end.joint_rates is None else end.joint_rates
    misses = {
        "attitude": (_apart(samples.attitude[at], np.asarray(end.attitude)), "rad"),
        "angular_velocity": (np.abs(samples.spin[0][at] - wanted_spin), "rad/s"),
        "joints": (np.abs(samples.joints[0][at] - end.joints), "rad"),
        "joint_rates": (np.abs(samples.joints[1][at] - wanted_rates), "rad/s"),
    }
    for part, (miss, unit) in misses.items():
        if not np.all(miss <= TOLERANCE):
            yield f"the {name} is missed by {np.max(miss):.3g} {unit} in {_words(part)}"


def _words(name: str) -> str:
    return name.replace("_", " ")
