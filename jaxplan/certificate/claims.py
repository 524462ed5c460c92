"""The data of a certificate: the claim about a trajectory that is to be proved, and what is proved of it."""

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

_ANGLES = frozenset(quantity.name for quantity in QUANTITIES if quantity.power == 0)


@shown("joints deg", "angular_velocity deg/s", "joint_rates deg/s", "attitude")
@dataclass(frozen=True, kw_only=True, eq=False)
class EndState:
    """The state that a trajectory must start from, or end in.

    Attributes:
        attitude: (3, 3) body to inertial.
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
        cones: all zones, padded or not.
        zone_names: names of the zones in the order of the cones' rows.
        start: the state it must start from; None for any.
        goal: the state it must end in; None for any.
        sight_names: (S,) names of all that the constraints bind: devices, axes of the body, and vectors of
            terminals' moving parts; None for general names of those that are no devices.
        robust: errors of attitude and joints for which zones and ranges must hold, and the reserve of torque;
            spacecraft and cones are without them. None for none.
        limits: names of the quantities whose limits are claimed to hold (`jaxplan.model.limits`); None for
            all that the spacecraft limits. Of a motion whose rates jump nothing can be said of torque.
        continuous: how many derivatives of attitude and joints must be continuous whatever the trajectory
            claims: one, or none of a motion whose rates jump, or minus one where the attitude does, too.
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
        """(S,) names of all that the constraints bind, general ones where `sight_names` is None."""
        if self.sight_names is not None:
            return self.sight_names
        names = self.spacecraft.device_names
        carried = (f"a vector of {names[int(terminal)]}" for terminal in self.cones.carrier)
        return (*names, *["an axis of the body"] * len(self.cones.body), *carried)

    @property
    def ends(self) -> dict[str, EndState]:
        """The wanted states by their names, "start" and "goal"."""
        return {name: end for name in ("start", "goal") if (end := getattr(self, name)) is not None}


@shown("bound deg", "device", "zone", "time s", "zones")
@dataclass(frozen=True, kw_only=True, eq=False)
class ProvedMargin:
    """How far a device stays from breaking a zone, or from breaking the last zone of a group.

    Attributes:
        zones: names; several if they are a group, of which one must hold at every instant.
        bound: rad, lower bound of the margin over all time, with what errors may take of it taken off.
        time: s, when the margin is smallest, to the resolution of the proof.
        zone: the one that decides then.
        device: name of the device that decides then, or of what else is bound.
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

    Of a trajectory that cannot be evaluated only `certified` (False) and `faults` are filled.

    Attributes:
        certified: whether everything holds.
        min_margin: rad, lower bound over all time, devices and zones (of zones in a group, that of the
            best), with what errors may take of it (`Claim.robust`) taken off; None where no zone binds a
            device.
        worst_time: s, when the margin is smallest, to the resolution of the proof; None likewise.
        worst_device: name of the device whose margin is smallest then, or of what else is bound, such as
            "axis (0, 0, 1) of the body"; None likewise.
        worst_zone: name of the zone; None likewise.
        peaks: upper bounds over all time of the largest component over its limit, of torques and joint angles
            over what errors and reserve leave of that: "angular_velocity", "angular_acceleration",
            "joint_rates", "joint_accelerations", "yaw", "pitch" and, where they are
            limited, "torque", "wheel_momentum", "jerk", of wheels "wheel_torques", "wheel_momenta", and of
            lengths of vectors "angular_velocity_norm", "angular_acceleration_norm". Those of joints are
            absent without terminals.
        peak_times: s, when each is reached.
        jumps: largest jump at any break: "attitude", "angular_velocity", "angular_acceleration",
            "angular_jerk", "joints", "joint_rates", "joint_accelerations", "joint_jerks" (rad, rad/s,
            rad/s^2, rad/s^3).
        faults: a sentence for each thing that fails.
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

    def rows(self) -> list[tuple[str, str]]:
        """What is proved, as (label, value) rows for a table."""
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
    """Return the smallest margin and all peaks of a certificate as (label, value) rows for a table.

    A joint may rest at an end of its range, which is no load: of its angle the row says how near to that it
    comes.

    Args:
        margin: rad, the smallest; None without a row of it.
        worst: device and zone whose margin that is, and when, s.
        peaks: shares of limits by name, as `Certificate.peaks`.
    """
    rows = []
    if margin is not None:
        device, zone, time = worst
        rows.append(("smallest margin", f"{np.rad2deg(margin):.3f} deg, {device} to {zone} at {time:.2f} s"))
    for name, peak in peaks.items():
        of_what = "the way to an end of its range" if name in _ANGLES else "its limit"
        rows.append((f"peak {name.replace('_', ' ')}", f"{100 * peak:.1f} % of {of_what}"))
    return rows


def faults_later(proof: Certificate, begin: float) -> list[str]:
    """Tell what could not be proved of a part of a motion with times from the start of the whole.

    Certificates of parts tell times from their own start, as "at t = 3.25 s".

    Args:
        proof: of the part.
        begin: s, of the part.
    """
    return [
        re.sub(r"at t = (\S+) s", lambda found: f"at {begin + float(found[1]):.2f} s", fault)
        for fault in proof.faults
    ]
