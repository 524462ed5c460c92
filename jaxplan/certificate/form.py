"""Checks that a claim can be evaluated at all: shapes, finite numbers, rotations, rising breaks.

The checks are made in three stages, each of which relies on the ones before: that shapes are right; that
every number is finite; that the numbers are such as they must be (rotations, unit vectors, rising times, and
so on). `faults` returns the sentences of the first stage that finds anything.
"""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

from jaxplan.certificate import inertia, tube
from jaxplan.certificate.claims import Claim
from jaxplan.certificate.motion import Trajectory
from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.model.directions import DirectionPath
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import ALLOCATIONS

_ROTATION_TOLERANCE = 1e-9  # largest entry of |R^T R - 1| that a rotation matrix may have
_UNIT_TOLERANCE = 1e-6  # by how much the length of a direction may miss one; they are normalised before use
_END_TIME_TOLERANCE = 1e-12  # of the duration: by how much the last breaks of platform and joints may differ

_CHART_SHAPES = {"attitude": (3, 3), "start": (), "rate": (3,)}  # shapes of what each chart has

Data = TypeVar("Data", bound=Any)


def _collect_arrays(data: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a dataclass by field name, in float64, without static fields, None and paths."""
    fields = dataclasses.fields(data)
    names = (f.name for f in fields if not f.metadata.get("static") and f.name != "paths")
    given = ((name, getattr(data, name)) for name in names)
    return {name: np.asarray(array, np.float64) for name, array in given if array is not None}


def plain(data: Data) -> Data:
    """Return a copy of a trajectory or of constraints with all arrays as float64 numpy arrays; paths stay."""
    return dataclasses.replace(data, **_collect_arrays(data))


def is_static(trajectory: Trajectory) -> bool:
    """Tell whether the trajectory is a state without duration: breaks and joint breaks are both [0, 0]."""
    return all(np.array_equal(breaks, [0, 0]) for breaks in (trajectory.breaks, trajectory.joint_breaks))


def held(trajectory: Data) -> Data:
    """Return a copy of a trajectory without duration in which its state is kept for one second."""
    second = np.array([0.0, 1.0])
    return dataclasses.replace(trajectory, breaks=second, joint_breaks=second)


def faults(claim: Claim, trajectory: Trajectory, cones: Constraints) -> list[str]:
    """Return a sentence for every fault found by the first stage that finds any; none if all is well.

    Args:
        claim: what is claimed.
        trajectory: the claim's trajectory, as `plain` returns it.
        cones: the claim's constraints, as `plain` returns them.
    """
    craft, ends = claim.spacecraft, claim.ends
    moving = {f"cones.paths[{row}]": path for row, path in enumerate(cones.paths) if path is not None}
    parts = {"trajectory": trajectory, "cones": cones} | moving | ends
    given = {
        f"{part}.{name}": array
        for part, data in parts.items()
        for name, array in _collect_arrays(data).items()
    }
    if craft.inertia is not None:
        given["spacecraft.inertia"] = np.asarray(craft.inertia, np.float64)
    found = list(_shape_faults(given, claim, cones))
    if found:
        return found
    still = np.ones(len(cones.axis), bool)
    still[[row for row, path in enumerate(cones.paths) if path is not None]] = False
    given["cones.axis"] = cones.axis[still]
    unclear = _failing_names(given, lambda array: bool(np.isfinite(array).all()))
    if unclear:
        return [f"{name} is not finite" for name in unclear]
    attitudes = {name: array for name, array in given.items() if name.endswith("attitude")}
    directions = {name: given[name] for name in ("cones.axis", "cones.body", "cones.carried")}
    directions |= {f"{name}.samples": given[f"{name}.samples"] for name in moving}
    wrong = [
        *(
            f"{name} is no rotation matrix to {_ROTATION_TOLERANCE:g}"
            for name in _failing_names(attitudes, _are_rotations, 3, 3)
        ),
        *(
            f"{name} is no unit vector to {_UNIT_TOLERANCE:g}"
            for name in _failing_names(directions, _are_unit_vectors, 3)
        ),
        *_trajectory_faults(trajectory),
        *_cone_faults(cones, still, len(claim.zone_names), craft),
        *_spacecraft_faults(craft),
        *(
            fault
            for name, path in moving.items()
            for fault in _path_faults(name, path, trajectory.breaks[-1])
        ),
    ]
    return wrong or list(tube.faults(claim.robust, craft, cones, list(claim.zone_names)))


def _shape_faults(given: dict[str, np.ndarray], claim: Claim, cones: Constraints) -> Iterator[str]:
    """Yield a sentence for each array of wrong shape; a curve needs a piece and a coefficient at least.

    Args:
        given: float64 arrays by name, such as "trajectory.breaks".
        claim: what is claimed.
        cones: its constraints.
    """
    rows, joints = cones.half_angle.size, claim.spacecraft.joint_count
    body, carried = (len(np.atleast_1d(vectors)) for vectors in (cones.body, cones.carried))
    sights = len(claim.spacecraft.device_names) + body + carried
    by_moments = np.ndim(given.get("spacecraft.inertia", 0.0)) == 1
    shapes: dict[str, tuple[int, ...]] = {"spacecraft.inertia": (3,) if by_moments else (3, 3)}
    for prefix, components in (("trajectory.", 3), ("trajectory.joint_", joints)):
        pieces = max(given[f"{prefix}breaks"].size - 1, 1)
        length = max((1, *given[f"{prefix}coefficients"].shape[1:2]))
        shapes |= {f"{prefix}breaks": (pieces + 1,), f"{prefix}coefficients": (pieces, length, components)}
    pieces = max(given["trajectory.breaks"].size - 1, 1)
    shapes |= {f"trajectory.chart_{name}": (pieces, *tail) for name, tail in _CHART_SHAPES.items()}
    shapes |= {
        f"cones.{name}": (rows,) for name in ("frame", "partner", "half_angle", "side", "entry", "group")
    }
    shapes |= {"cones.axis": (rows, 3), "cones.bound": (rows, sights), "cones.body": (body, 3)}
    shapes |= {"cones.carrier": (carried,), "cones.carried": (carried, 3)}
    for row in range(len(cones.paths)):
        samples = max(given.get(f"cones.paths[{row}].times", np.zeros(0)).size, 2)
        of_path = {"times": (samples,), "samples": (samples, 3), "slopes": (samples, 3)}
        shapes |= {f"cones.paths[{row}].{name}": shape for name, shape in of_path.items()}
    of_end = {"attitude": (3, 3), "joints": (joints,), "angular_velocity": (3,), "joint_rates": (joints,)}
    shapes |= {f"{end}.{name}": shape for end in claim.ends for name, shape in of_end.items()}
    for name, shape in shapes.items():
        if name in given and given[name].shape != shape:
            yield f"{name} has the shape {given[name].shape} and not {shape}"
    if len(cones.paths) > rows:
        yield f"cones.paths has {len(cones.paths)} axes for {rows} rows"
    if claim.sight_names is not None and len(claim.sight_names) != sights:
        yield f"sight_names has {len(claim.sight_names)} names for {sights} sights"


def _failing_names(
    arrays: dict[str, np.ndarray], good: Callable[[np.ndarray], bool], *tail: int
) -> list[str]:
    """Return the names of the arrays (..., *tail) for which `good` is False; all are first tried in one."""
    if good(np.concatenate([array.reshape(-1, *tail) for array in arrays.values()])):
        return []
    return [name for name, array in arrays.items() if not good(array)]


def _are_rotations(matrices: np.ndarray) -> bool:
    """Whether all matrices (..., 3, 3) are rotations, R^T R the identity within `_ROTATION_TOLERANCE`."""
    off = np.abs(np.swapaxes(matrices, -1, -2) @ matrices - np.eye(3))
    return bool((off <= _ROTATION_TOLERANCE).all() and (np.linalg.det(matrices) > 0).all())


def _are_unit_vectors(vectors: np.ndarray) -> bool:
    """Tell whether the lengths of all vectors (..., 3) differ from one by at most `_UNIT_TOLERANCE`."""
    return bool((np.abs(np.linalg.norm(vectors, axis=-1) - 1) <= _UNIT_TOLERANCE).all())


def _are_orthonormal(first: np.ndarray, second: np.ndarray) -> bool:
    """Tell whether two vectors (3,) are unit vectors at right angles, both to within `_UNIT_TOLERANCE`."""
    return (
        _are_unit_vectors(first)
        and _are_unit_vectors(second)
        and bool(abs(np.dot(first, second)) <= _UNIT_TOLERANCE)
    )


def _trajectory_faults(trajectory: Trajectory) -> Iterator[str]:
    """Yield the faults of a trajectory's breaks; without duration, it must also be constant."""
    ends = trajectory.breaks[[0, -1]]
    if ends[0] != 0:
        yield f"trajectory.breaks start at {ends[0]:g} s and not at 0"
    # The two may differ by rounding; both curves go on beyond their last break.
    if not (np.abs(trajectory.joint_breaks[[0, -1]] - ends) <= _END_TIME_TOLERANCE * ends[1]).all():
        yield "trajectory.joint_breaks do not start and end with trajectory.breaks"
    if is_static(trajectory):
        moving = (trajectory.chart_rate, trajectory.coefficients[:, 1:], trajectory.joint_coefficients[:, 1:])
        if any(array.any() for array in moving):
            yield "the trajectory has no duration and yet is not constant"
        return
    for name in ("breaks", "joint_breaks"):
        if not (np.diff(getattr(trajectory, name)) > 0).all():
            yield f"trajectory.{name} do not rise"


def _cone_faults(cones: Constraints, still: np.ndarray, zones: int, craft: Spacecraft) -> Iterator[str]:
    """Yield the faults of the numbers of constraints, and of what their rows bind.

    Args:
        cones: the constraints in float64, Z rows.
        still: (Z,) bool, whether the axis of each row stands still.
        zones: number of rows that have a name; the rows after them must bind nothing.
        craft: the spacecraft.
    """
    terminals, gimbals = len(craft.terminals), len(craft.terminals) + len(craft.drives)
    frame, bound = cones.frame, cones.bound != 0
    of_joints, of_sights = frame == JOINTS, frame == SIGHT
    partner, sights = cones.partner[of_sights], bound.shape[1]
    partners_exist = _are_indices(partner, sights)
    row = np.arange(len(frame))
    numbered = {
        name: _are_indices(first, len(row))
        and (first <= row).all()
        and (first[first.astype(int)] == first).all()
        for name, first in (("entry", cones.entry), ("group", cones.group))
    }
    holds = {
        "half_angle is not between 0 and 180 deg": (
            of_joints | ((cones.half_angle > 0) & (cones.half_angle < np.pi))
        ).all(),
        "side is neither +1 nor -1": (np.abs(cones.side) == 1).all(),
        f"bound has zones that bind devices beyond the {zones} that have a name": not bound[zones:].any(),
        "axis of a row of joints is not of yaw and pitch alone": not cones.axis[of_joints, 2:].any(),
        "frame is none of the four that there are": _are_indices(frame, 4),
        f"carrier is none of the {gimbals} devices with joints": _are_indices(cones.carrier, gimbals),
        "paths has an axis that moves and is not inertial": not (~still & (frame != INERTIAL)).any(),
        "bound has a row of joints that binds more than terminals": not bound[of_joints, terminals:].any(),
        f"partner is none of the {sights} sights": partners_exist,
        "bound has a row about a sight that does not bind exactly one other": not partners_exist
        or ((bound[of_sights].sum(axis=1) == 1).all() and not bound[of_sights, partner.astype(int)].any()),
        **{f"{name} is not the first row of each": holds for name, holds in numbered.items()},
        "entry has rows of several groups": not all(numbered.values())
        or (cones.group[cones.entry.astype(int)] == cones.group).all(),
    }
    yield from (f"cones.{fault}" for fault, good in holds.items() if not good)


def _are_indices(numbers: np.ndarray, count: int) -> bool:
    """Tell whether all numbers are integers from 0 to `count` - 1."""
    return bool(((numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < count)).all())


def _path_faults(name: str, path: DirectionPath, last: float) -> Iterator[str]:
    """Yield the faults of the times of a moving axis; it must be known from 0 to `last` s."""
    times = np.asarray(path.times, np.float64)
    if not (np.diff(times) > 0).all():
        yield f"{name}.times do not rise"
    if not (times[0] <= 0 and last <= times[-1]):
        yield f"{name} is known from {times[0]:g} to {times[-1]:g} s, and the trajectory ends at {last:g} s"


def _spacecraft_faults(spacecraft: Spacecraft) -> Iterator[str]:
    """Yield the faults of a spacecraft's limits, mountings, joint ranges, boresights, wheels and inertias."""
    positive = []
    of_axes = "rate_limit", "acceleration_limit", "jerk_limit", "torque_limit", "wheel_momentum_limit"
    for name in (*of_axes, "rate_norm_limit", "acceleration_norm_limit"):
        limit = getattr(spacecraft, name)
        if limit is not None:
            positive.append((f"spacecraft.{name}", limit))
            if np.shape(limit) not in ((), (3,) if name in of_axes else ()):
                wanted = "(3,)" if name in of_axes else "()"
                yield f"spacecraft.{name} has the shape {np.shape(limit)} and not {wanted}"
            if name in ("torque_limit", "wheel_momentum_limit") and spacecraft.inertia is None:
                yield f"spacecraft.{name} cannot be checked without spacecraft.inertia"
    yield from _wheel_faults(spacecraft)
    yield from _stage_faults(spacecraft)
    for terminal in spacecraft.terminals:
        mounting = terminal.mounting
        if mounting is None:
            if terminal.mount is None or not np.isfinite(terminal.mount).all():
                yield f"the mount of {terminal.name} is not finite"
        elif not _are_orthonormal(mounting.yaw_axis, mounting.boresight):
            yield (
                f"the mount of {terminal.name} is no pair of unit vectors at right angles, "
                f"to {_UNIT_TOLERANCE:g}"
            )
        for name in ("yaw_limit", "yaw_range", "pitch_limit", "pitch_range"):
            given = getattr(terminal, name)  # finite or not, joint_ranges cuts the pitch's below 90 deg
            if given is not None and not np.isfinite(given).all():
                yield f"{name} of {terminal.name} is not finite"
    for drive in spacecraft.drives:
        if not (_are_unit_vectors(drive.axis) and _are_unit_vectors(drive.boresight)):
            yield f"axis or boresight of {drive.name} is no unit vector to {_UNIT_TOLERANCE:g}"
        elif not np.linalg.norm(np.cross(drive.axis, drive.boresight)) > _UNIT_TOLERANCE:
            yield f"the boresight of {drive.name} lies along its axis"
    for name, (low, high), rate, acceleration in zip(
        spacecraft.joint_names,
        spacecraft.joint_ranges,
        spacecraft.joint_rate_limits,
        spacecraft.joint_acceleration_limits,
        strict=True,
    ):
        positive += [(f"rate limit of {name}", rate), (f"acceleration limit of {name}", acceleration)]
        if not (np.isfinite([low, high]).all() and low < high):
            yield f"the range of {name} is [{low:g}, {high:g}] and not of two rising numbers"
    for name, value in positive:
        numbers = [value] if isinstance(value, float) else np.ravel(value).tolist()
        if not all(0 < number < np.inf for number in numbers):
            yield f"{name} = {', '.join(f'{number:g}' for number in numbers)} is not positive and finite"
    for instrument in spacecraft.instruments:
        if not _are_unit_vectors(instrument.boresight):
            yield f"the boresight of {instrument.name} is no unit vector to {_UNIT_TOLERANCE:g}"


def _stage_faults(spacecraft: Spacecraft) -> Iterator[str]:
    """Yield the faults of inertias of stages, the parts that joints turn (see `inertia`)."""
    named = [
        (f"{name} of {device.name}", getattr(device, name))
        for devices, names in (
            (spacecraft.terminals, ("yaw_inertia", "pitch_inertia")),
            (spacecraft.drives, ("inertia",)),
        )
        for device in devices
        for name in names
    ]
    given = [(name, np.asarray(own, np.float64)) for name, own in named if own is not None]
    faults = [f"{name} is no inertia" for name, own in given if not _is_inertia(own)]
    yield from faults
    if given and not faults and spacecraft.inertia is not None:
        left = inertia.left(spacecraft)  # not finite where a mount is not
        if not np.isfinite(left).all() or not np.linalg.eigvalsh((left + left.T) / 2)[0] > 0:
            yield "spacecraft.inertia is not more than the inertias of what its joints turn"


def _is_inertia(given: np.ndarray) -> bool:
    """Tell whether an array is an inertia: a positive definite symmetric (3, 3), or positive moments (3,)."""
    if given.shape not in ((3,), (3, 3)) or not np.isfinite(given).all():
        return False
    own = inertia.matrix(given)
    symmetric = np.abs(own - own.T).max() <= _UNIT_TOLERANCE * np.abs(own).max()
    return bool(symmetric and np.linalg.eigvalsh((own + own.T) / 2)[0] > 0)


def _wheel_faults(spacecraft: Spacecraft) -> Iterator[str]:
    """Yield the faults of a spacecraft's reaction wheels: their numbers, axes and allocation."""
    wheels = spacecraft.wheels
    if spacecraft.allocation not in ALLOCATIONS:
        yield f"spacecraft.allocation = {spacecraft.allocation!r} is not known"
    for wheel in wheels:
        numbers = np.array([wheel.torque, wheel.momentum, wheel.stored], np.float64)
        if not (np.shape(wheel.axis) == (3,) and _are_unit_vectors(np.asarray(wheel.axis, np.float64))):
            yield f"the axis of {wheel.name} is no unit vector to {_UNIT_TOLERANCE:g}"
            return
        if not (np.isfinite(numbers).all() and (numbers[:2] > 0).all()):
            yield f"torque or momentum of {wheel.name} is not positive and finite, or what it stores is not"
    if wheels and spacecraft.inertia is None:
        yield "spacecraft.wheels cannot be checked without spacecraft.inertia"
    if wheels and np.linalg.matrix_rank(np.array([wheel.axis for wheel in wheels], np.float64)) < 3:
        yield "the axes of spacecraft.wheels do not span space"
