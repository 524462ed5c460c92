"""What must hold before a trajectory can be evaluated: shapes, finite numbers, rotations, rising breaks.

Each check yields a sentence for every fault. A NaN or an infinity anywhere is one.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from jaxplan.certificate.claims import EndState

if TYPE_CHECKING:
    from jaxplan.model.constraints import Constraints
    from jaxplan.model.directions import DirectionPath
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory

_ORTHONORMAL = 1e-9
_UNIT = 1e-6  # directions are normalised before use
_SAME_TIME = 1e-12

# What the axis of a row belongs to: the inertial frame, the body, a sight, or none since it is of joints.
INERTIAL, BODY, SIGHT, JOINTS = range(4)

Container = TypeVar("Container", "Trajectory", "Constraints")


def _arrays(container: Any) -> dict[str, np.ndarray]:
    fields = (f.name for f in dataclasses.fields(container) if not f.metadata.get("static"))
    fields = (name for name in fields if name != "paths")  # of constraints: `motion` reads them
    return {name: np.asarray(getattr(container, name), np.float64) for name in fields}


def plain(container: Container) -> Container:
    """The same with all arrays in numpy's float64."""
    arrays: dict[str, Any] = _arrays(container)
    return dataclasses.replace(container, **arrays)


def faults(
    trajectory: "Trajectory",
    spacecraft: "Spacecraft",
    cones: "Constraints",
    zones: int,
    ends: dict[str, EndState],
    sight_names: Sequence[str] | None = None,
) -> list[str]:
    """All faults of form; where shapes are wrong, only those.

    Args:
        trajectory: as `plain` gives it.
        spacecraft: any.
        cones: as `plain` gives them.
        zones: number of zones that have a name.
        ends: the wanted states by their names, "start" and "goal".
        sight_names: names of all that the constraints bind, if any are given.
    """
    terminals = len(spacecraft.terminals)
    further = len(np.atleast_1d(cones.body)) + len(np.atleast_1d(cones.carried))
    joints, sights = 2 * terminals, len(spacecraft.device_names) + further
    shapes = [*_trajectory_shapes(trajectory, joints), *_cone_shapes(cones, sights)]
    if sight_names is not None and len(sight_names) != sights:
        shapes.append(f"sight_names has {len(sight_names)} names for {sights} sights")
    for name, end in ends.items():
        shapes += _end_shapes(name, end, joints)
    if shapes:
        return shapes
    last = float(np.max(trajectory.breaks))
    found = [*_trajectory_numbers(trajectory), *_cone_numbers(cones, zones, terminals)]
    found += _spacecraft_numbers(spacecraft)
    found += [f for row, path in enumerate(cones.paths) if path is not None for f in _path(row, path, last)]
    for name, end in ends.items():
        found += _end_numbers(name, end)
    return found


def is_static(trajectory: "Trajectory") -> bool:
    """Whether the trajectory is a state without duration: breaks and joint breaks are [0, 0]."""
    return all(np.array_equal(breaks, [0, 0]) for breaks in (trajectory.breaks, trajectory.joint_breaks))


def held(trajectory: "Trajectory") -> "Trajectory":
    """The state of a trajectory without duration, held for a second."""
    second = np.array([0.0, 1.0])
    return dataclasses.replace(trajectory, breaks=second, joint_breaks=second)


def _shape(name: str, array: Any, shape: tuple[int, ...]) -> Iterator[str]:
    if np.shape(array) != shape:
        yield f"{name} has the shape {np.shape(array)} and not {shape}"


def _finite(name: str, array: Any) -> Iterator[str]:
    if not np.all(np.isfinite(np.asarray(array, np.float64))):
        yield f"{name} is not finite"


def _positive(name: str, value: Any) -> Iterator[str]:
    if not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
        yield f"{name} = {', '.join(f'{number:g}' for number in np.ravel(value))} is not positive and finite"


def _rotation(name: str, attitude: np.ndarray) -> Iterator[str]:
    gram = np.swapaxes(attitude, -1, -2) @ attitude
    if not (np.all(np.abs(gram - np.eye(3)) <= _ORTHONORMAL) and np.all(np.linalg.det(attitude) > 0)):
        yield f"{name} is no rotation matrix to {_ORTHONORMAL:g}"


def _unit(name: str, vectors: Any) -> Iterator[str]:
    if not np.all(np.abs(np.linalg.norm(vectors, axis=-1) - 1) <= _UNIT):
        yield f"{name} is no unit vector to {_UNIT:g}"


def _trajectory_shapes(trajectory: "Trajectory", joints: int) -> Iterator[str]:
    pieces = trajectory.breaks.size - 1
    yield from _shape("trajectory.chart_attitude", trajectory.chart_attitude, (pieces, 3, 3))
    yield from _shape("trajectory.chart_start", trajectory.chart_start, (pieces,))
    yield from _shape("trajectory.chart_rate", trajectory.chart_rate, (pieces, 3))
    for prefix, breaks, coefficients, components in (
        ("", trajectory.breaks, trajectory.coefficients, 3),
        ("joint_", trajectory.joint_breaks, trajectory.joint_coefficients, joints),
    ):
        if breaks.ndim != 1 or breaks.size < 2:
            yield f"trajectory.{prefix}breaks has the shape {breaks.shape} and not (pieces + 1,)"
        length = max(1, *coefficients.shape[1:2])
        yield from _shape(
            f"trajectory.{prefix}coefficients", coefficients, (breaks.size - 1, length, components)
        )


def _trajectory_numbers(trajectory: "Trajectory") -> Iterator[str]:
    unclear = [f for name, array in _arrays(trajectory).items() for f in _finite(f"trajectory.{name}", array)]
    if unclear:
        yield from unclear
        return
    yield from _rotation("trajectory.chart_attitude", trajectory.chart_attitude)
    ends = trajectory.breaks[[0, -1]]
    if ends[0] != 0:
        yield f"trajectory.breaks start at {ends[0]:g} s and not at 0"
    # The two may differ by rounding; both curves go on beyond their last break.
    if not np.all(np.abs(trajectory.joint_breaks[[0, -1]] - ends) <= _SAME_TIME * ends[1]):
        yield "trajectory.joint_breaks do not start and end with trajectory.breaks"
    if is_static(trajectory):
        moving = (trajectory.chart_rate, trajectory.coefficients[:, 1:], trajectory.joint_coefficients[:, 1:])
        if any(np.any(array != 0) for array in moving):
            yield "the trajectory has no duration and yet is not constant"
        return
    for name in ("breaks", "joint_breaks"):
        if not np.all(np.diff(getattr(trajectory, name)) > 0):
            yield f"trajectory.{name} do not rise"


def _cone_shapes(cones: "Constraints", sights: int) -> Iterator[str]:
    zones = cones.half_angle.size
    if len(cones.paths) > zones:
        yield f"cones.paths has {len(cones.paths)} axes for {zones} rows"
    for name, tail in (
        ("axis", (3,)),
        ("frame", ()),
        ("partner", ()),
        ("half_angle", ()),
        ("side", ()),
        ("bound", (sights,)),
        ("entry", ()),
        ("group", ()),
    ):
        yield from _shape(f"cones.{name}", getattr(cones, name), (zones, *tail))
    for name, each, tail in (
        ("body", cones.body, (3,)),
        ("carrier", cones.carried, ()),
        ("carried", cones.carried, (3,)),
    ):
        yield from _shape(f"cones.{name}", getattr(cones, name), (len(np.atleast_1d(each)), *tail))


def _cone_numbers(cones: "Constraints", zones: int, terminals: int) -> Iterator[str]:
    stands = np.array([path is None for path in cones.paths] + [True] * (zones - len(cones.paths)), bool)
    still = np.ones(len(cones.axis), bool)
    still[: len(stands)] = stands
    unclear: list[str] = []
    for name, array in _arrays(cones).items():
        unclear += _finite(f"cones.{name}", array[still] if name == "axis" else array)
    yield from unclear
    for name, vectors in (("axis", cones.axis[still]), ("body", cones.body), ("carried", cones.carried)):
        yield from _unit(f"cones.{name}", vectors)
    of_joints = cones.frame == JOINTS
    if not np.all((cones.half_angle > 0) & (cones.half_angle < np.pi) | of_joints):
        yield "cones.half_angle is not between 0 and 180 deg"
    if not np.all(np.abs(cones.side) == 1):
        yield "cones.side is neither +1 nor -1"
    if np.any(cones.bound[zones:] != 0):
        yield f"cones has zones that bind devices beyond the {zones} that have a name"
    if np.any(cones.axis[of_joints, 2:] != 0):
        yield "cones.axis of a row of joints is not of yaw and pitch alone"
    if not unclear:
        yield from (*_kinds(cones, terminals), *_nests(cones))


def _kinds(cones: "Constraints", terminals: int) -> Iterator[str]:
    """Check what each axis belongs to, and whether its row may bind what it binds."""
    frame, bound = cones.frame, cones.bound != 0
    if not _whole(frame, 4):
        yield "cones.frame is none of the four that there are"
    if not _whole(cones.carrier, terminals):
        yield f"cones.carrier is none of the {terminals} terminals"
    moving = np.array([path is not None for path in cones.paths], bool)
    if np.any(frame[: len(moving)][moving] != INERTIAL):
        yield "cones.paths has an axis that moves and is not inertial"
    if np.any(bound[frame == JOINTS, terminals:]):
        yield "cones.bound has a row of joints that binds more than terminals"
    from_sights = frame == SIGHT
    partner = cones.partner[from_sights]
    if not _whole(partner, bound.shape[1]):
        yield f"cones.partner is none of the {bound.shape[1]} sights"
    elif np.any(bound[from_sights].sum(axis=1) != 1) or np.any(bound[from_sights, partner.astype(int)]):
        yield "cones.bound has a row about a sight that does not bind exactly one other"


def _nests(cones: "Constraints") -> Iterator[str]:
    """Check that rows are numbered into entries, and entries into constraints."""
    row = np.arange(len(cones.frame))
    for name in ("entry", "group"):
        first = getattr(cones, name)
        if not (_whole(first, len(row)) and np.all(first <= row)):
            yield f"cones.{name} is not the first row of each"
            return
        if np.any(first[first.astype(int)] != first):
            yield f"cones.{name} is not the first row of each"
    if np.any(cones.group[cones.entry.astype(int)] != cones.group):
        yield "cones.entry has rows of several groups"


def _whole(numbers: np.ndarray, count: int) -> bool:
    """Tell whether all numbers are whole, at least zero and below a count."""
    return bool(np.all((numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < count)))


def _path(row: int, path: "DirectionPath", last: float) -> Iterator[str]:
    """Of an axis that moves, in a trajectory that ends at `last` s."""
    name = f"cones.paths[{row}]"
    times, arrays = np.asarray(path.times, np.float64), {"samples": path.samples, "slopes": path.slopes}
    shapes = [f for part, array in arrays.items() for f in _shape(f"{name}.{part}", array, (times.size, 3))]
    if times.ndim != 1 or times.size < 2:
        shapes.append(f"{name}.times has the shape {times.shape} and not (samples,)")
    unclear = [f for part in ("times", *arrays) for f in _finite(f"{name}.{part}", getattr(path, part))]
    if shapes or unclear:
        yield from (*shapes, *unclear)
        return
    yield from _unit(f"{name}.samples", path.samples)
    if not np.all(np.diff(times) > 0):
        yield f"{name}.times do not rise"
    if not (times[0] <= 0 and last <= times[-1]):
        yield f"{name} is known from {times[0]:g} to {times[-1]:g} s, and the trajectory ends at {last:g} s"


def _spacecraft_numbers(spacecraft: "Spacecraft") -> Iterator[str]:
    yield from _positive("spacecraft.rate_limit", spacecraft.rate_limit)
    yield from _positive("spacecraft.acceleration_limit", spacecraft.acceleration_limit)
    for name in ("jerk_limit", "torque_limit", "wheel_momentum_limit"):
        limit = getattr(spacecraft, name)
        if limit is not None:
            if np.shape(limit) not in ((), (3,)):
                yield from _shape(f"spacecraft.{name}", limit, (3,))
            yield from _positive(f"spacecraft.{name}", limit)
            if name != "jerk_limit" and spacecraft.inertia is None:
                yield f"spacecraft.{name} cannot be checked without spacecraft.inertia"
    if spacecraft.inertia is not None:
        yield from _shape("spacecraft.inertia", spacecraft.inertia, (3, 3))
        yield from _finite("spacecraft.inertia", spacecraft.inertia)
    for terminal in spacecraft.terminals:
        yield from _finite(f"the mount of {terminal.name}", terminal.mount)
        for name in ("yaw_limit", "pitch_limit", "rate_limit", "acceleration_limit"):
            yield from _positive(f"{name} of {terminal.name}", getattr(terminal, name))
    for instrument in spacecraft.instruments:
        yield from _unit(f"the boresight of {instrument.name}", instrument.boresight)


def _end_shapes(name: str, end: EndState, joints: int) -> Iterator[str]:
    yield from _shape(f"{name}.attitude", end.attitude, (3, 3))
    yield from _shape(f"{name}.joints", end.joints, (joints,))
    if end.angular_velocity is not None:
        yield from _shape(f"{name}.angular_velocity", end.angular_velocity, (3,))
    if end.joint_rates is not None:
        yield from _shape(f"{name}.joint_rates", end.joint_rates, (joints,))


def _end_numbers(name: str, end: EndState) -> Iterator[str]:
    yield from _rotation(f"{name}.attitude", np.asarray(end.attitude, np.float64))
    for key in ("joints", "angular_velocity", "joint_rates"):
        value = getattr(end, key)
        if value is not None:
            yield from _finite(f"{name}.{key}", value)
