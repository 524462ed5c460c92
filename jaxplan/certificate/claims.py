"""Data of a certificate: what is claimed about a trajectory, and what was proved of it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxplan.certificate.motion import Trajectory
from jaxplan.model.constraints import Constraints
from jaxplan.model.limits import QUANTITIES
from jaxplan.model.robust import Robust
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import aligned, as_table, shown

_ANGLE_QUANTITIES = frozenset(quantity.name for quantity in QUANTITIES if quantity.power == 0)


@shown("joints deg", "angular_velocity deg/s", "joint_rates deg/s", "attitude")
@dataclass(frozen=True, kw_only=True, eq=False)
class EndState:
    """The state that a trajectory must start from or end in, of n terminals and d drives.

    Attributes:
        attitude: (3, 3) rotation matrix, body to inertial.
        joints: (2n + d,) rad, all yaws, all pitches, all drives.
        angular_velocity: (3,) rad/s, body axes; None for rest.
        joint_rates: (2n + d,) rad/s; None for rest.
    """

    attitude: np.ndarray
    joints: np.ndarray
    angular_velocity: np.ndarray | None = None
    joint_rates: np.ndarray | None = None


@shown("trajectory", "spacecraft", "zone_names", "start", "goal")
@dataclass(frozen=True, kw_only=True, eq=False)
class Claim:
    """The claim that a trajectory keeps all limits and zones and leads from one state to another.

    Attributes:
        trajectory: the manoeuvre.
        spacecraft: its devices and limits.
        cones: all pointing constraints, padded with empty rows or not.
        zone_names: a name for each row of `cones` that is not padding, in their order.
        start: the state it must start from; None for any.
        goal: the state it must end in; None for any.
        sight_names: (S,) names of all sights (directions that the constraints bind): devices, axes of the
            body, and vectors of terminals' moving parts. None for the devices' names and general names for
            the rest.
        robust: errors of attitude and joints under which zones and ranges must hold, and percentages of
            torque and wheel momentum kept in reserve; they are not yet taken off in `spacecraft` and `cones`.
            None for no errors and reserves.
        limits: names of the quantities whose limits are claimed to hold (`jaxplan.model.limits`); None for
            all that the spacecraft limits. Nothing can be claimed of the torque of a motion whose rates jump.
        continuous: number of derivatives of attitude and joints that must be continuous whatever the
            trajectory itself claims: 1 normally, 0 for a motion whose rates jump, -1 where even the attitude
            may jump.
    """

    trajectory: Trajectory
    spacecraft: Spacecraft
    cones: Constraints
    zone_names: Sequence[str]
    start: EndState | None = None
    goal: EndState | None = None
    sight_names: Sequence[str] | None = None
    robust: Robust | None = None
    limits: frozenset[str] | None = None
    continuous: int = 1

    @property
    def sights(self) -> Sequence[str]:
        """(S,) names of all sights; those that are no devices have general names if none are given."""
        if self.sight_names is not None:
            return self.sight_names
        names = self.spacecraft.device_names
        carried = (f"a vector of {names[int(terminal)]}" for terminal in self.cones.carrier)
        return (*names, *["an axis of the body"] * len(self.cones.body), *carried)

    @property
    def ends(self) -> dict[str, EndState]:
        """The states wanted at the ends by name, "start" and "goal"; those that are None are left out."""
        return {name: end for name in ("start", "goal") if (end := getattr(self, name)) is not None}


@shown("bound deg", "device", "zone", "time s", "zones")
@dataclass(frozen=True, kw_only=True, eq=False)
class ProvedMargin:
    """How far a device stays from breaking a zone, or all zones of a group of which one must hold.

    Attributes:
        zones: names of the zone, or of all zones of the group.
        bound: rad, proved lower bound of the margin over all time, less what errors (`Claim.robust`) may
            take; positive where the zone is kept.
        time: s, when the margin is smallest, to the resolution of the proof.
        zone: name of the zone that decides the margin then.
        device: name of the device, axis or vector that decides the margin then.
    """

    zones: tuple[str, ...]
    bound: float
    time: float
    zone: str
    device: str


@shown("certified", "faults", "min_margin deg", "worst_device", "worst_zone", "worst_time s", "evaluations")
@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """What is proved of a trajectory, for all times and not for samples alone.

    For a trajectory that cannot be evaluated `faults` says why, and margins, peaks and jumps stay empty.

    Attributes:
        certified: whether everything that was claimed is proved.
        min_margin: rad, lower bound of the margin over all time, sights and zones (in a group of zones, the
            best one counts), less what errors may take (`Claim.robust`); positive where zones are kept. None
            where no zone binds anything.
        worst_time: s, when the margin is smallest, to the resolution of the proof; None like `min_margin`.
        worst_device: name of the device whose margin is smallest then, or of another sight, such as "axis
            (0, 0, 1) of the body"; None like `min_margin`.
        worst_zone: name of the zone; None like `min_margin`.
        peaks: by name of a quantity, an upper bound over all time of its largest component over its limit
            (for torques, momenta and joint angles over what errors and reserve leave of the limit; for angles
            measured from the middle of the range): those of `jaxplan.model.limits` that are limited and
            claimed, such as "angular_velocity", "joint_rates", "yaw", "torque" or "wheel_momenta". Those of
            joints the spacecraft does not have are absent.
        peak_times: s, when each peak is reached.
        jumps: largest jump at any break of "attitude", "angular_velocity", "angular_acceleration",
            "angular_jerk", "joints", "joint_rates", "joint_accelerations", "joint_jerks" (rad, rad/s,
            rad/s^2, rad/s^3).
        faults: a sentence for each thing that fails; empty where certified.
        evaluations: number of instants at which the trajectory was evaluated.
    """

    certified: bool
    min_margin: float | None = None
    worst_time: float | None = None
    worst_device: str | None = None
    worst_zone: str | None = None
    peaks: dict[str, float] = field(default_factory=dict)
    peak_times: dict[str, float] = field(default_factory=dict)
    jumps: dict[str, float] = field(default_factory=dict)
    faults: tuple[str, ...]
    evaluations: int = 0

    @property
    def evaluated(self) -> bool:
        """Whether the trajectory was evaluated; if not, what was claimed has faults that no setting mends."""
        return self.evaluations > 0

    def rows(self) -> list[tuple[str, str]]:
        """Return what is proved as (label, value) pairs for a table."""
        rows = [("certified", "yes, at every instant" if self.certified else "no: not certified")]
        rows += [("", fault) for fault in self.faults]
        worst = (self.worst_device, self.worst_zone, self.worst_time)
        return rows + margin_and_peaks(self.min_margin, worst, self.peaks)

    def __str__(self) -> str:
        return "\n".join(aligned(self.rows()))

    def _repr_html_(self) -> str:
        return as_table("Certificate", self.rows())


def margin_and_peaks(
    margin: float | None, worst: tuple[str | None, str | None, float | None], peaks: Mapping[str, float]
) -> list[tuple[str, str]]:
    """Format the smallest margin and all peaks of a certificate as (label, value) pairs for a table.

    A joint may rest at an end of its range, which is no load. So the peak of a joint angle is given as a
    percentage of the way from the middle of its range to an end.

    Args:
        margin: rad, the smallest; None to leave out its row.
        worst: device and zone with that margin, and its time, s.
        peaks: largest values over limits by name, as in `Certificate.peaks`.
    """
    rows = []
    if margin is not None:
        device, zone, time = worst
        rows.append(("smallest margin", f"{np.rad2deg(margin):.3f} deg, {device} to {zone} at {time:.2f} s"))
    for name, peak in peaks.items():
        of_what = "the way to an end of its range" if name in _ANGLE_QUANTITIES else "its limit"
        rows.append((f"peak {name.replace('_', ' ')}", f"{100 * peak:.1f} % of {of_what}"))
    return rows


def faults_later(proof: Certificate, begin: float) -> list[str]:
    """Return the faults of a part's certificate with times counted from the start of the whole motion.

    Sentences of the part count time from its own start, as in "at t = 3.25 s".

    Args:
        proof: certificate of the part.
        begin: s, start of the part within the whole motion.
    """
    return [
        re.sub(r"at t = (\S+) s", lambda found: f"at {begin + float(found[1]):.2f} s", fault)
        for fault in proof.faults
    ]
