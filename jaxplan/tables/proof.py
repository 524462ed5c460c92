"""Proof of what a table keeps when a reader interpolates it: zones, ranges and rates at every instant.

The motion between rows is that of `jaxplan.tables.interpolation`, and the prover is that of plans. Where a
reader's angular velocity jumps between intervals nothing can be proved of accelerations and torque; the jumps
are reported instead. Nothing is proved of wheels, since a table does not tell what they hold. A table without
joints is proved for the platform and for what is fixed to it.
"""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate, Claim, certify_batch, margin_and_peaks
from jaxplan.model.activities import Timeline
from jaxplan.model.epochs import seconds_between
from jaxplan.model.goals import GivenState
from jaxplan.model.limits import limits
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.time_shift import later
from jaxplan.planner.messages import FOR_LONGER
from jaxplan.runtime.arguments import expect_any
from jaxplan.runtime.display import aligned, as_table, shown
from jaxplan.runtime.progress import progress_bar
from jaxplan.tables.devices import OtherDevicesError
from jaxplan.tables.files import load_attitude
from jaxplan.tables.interpolation import Reading, needs, reading
from jaxplan.tables.joined_certificates import joined_proof, with_margins
from jaxplan.tables.table import HERMITE, INTERPOLATIONS, RATE, AttitudeTable, as_known
from jaxplan.tables.tolerances import FORGIVE_DEG, FORGIVE_PERCENT, NOTHING, Forgiven, forgiven

TOLERANCE = np.deg2rad(1e-4)
"""rad: by which the pieces that are proved may be off a reader's motion; it is taken off margins."""
_RELATIVE_RATE_TOLERANCE = 1e-4  # of the least limit of a rate, by which their angular velocity may be off
_CLOCK_TOLERANCE = 1e-3  # s, by which a table may begin before the scene, as times are rounded
_GOAL_TOLERANCE = np.deg2rad(0.01)  # rad: a last row farther off the goal is reported to miss it
_INTERVALS_PER_BATCH = 500  # intervals of a table that are proved at once
_ANGLE_ORDER, _RATE_ORDER, _ACCELERATION_ORDER = 0, 1, 2  # number of time derivatives: `Quantity.power`


@shown("certified", "faults", "min_margin deg", "worst_device", "worst_zone", "worst_time s", "interpolation")
@dataclass(frozen=True, kw_only=True, eq=False)
class TableCertificate:
    """What is proved of a table for all times, not for its rows alone.

    Attributes:
        certified: whether everything that is claimed holds, apart from what is forgiven.
        forgives: by how much the table may fall short.
        forgiven: a sentence for each thing that fails, where all fail by no more than that; else empty.
        interpolation: what is done between rows, one of `jaxplan.tables.INTERPOLATIONS`.
        alternative: what some readers do instead, with which margins and ranges hold, too; None for nothing.
        rows_count: number of rows.
        numbers: how many numbers the table holds, times included.
        min_margin: rad, lower bound over all time, devices and zones, positive where zones are kept; None, as
            the next three, where no zone binds a device that the table tells about.
        worst_time: s in the scene's time, when the margin is smallest.
        worst_device: device with that margin.
        worst_zone: zone that it comes closest to breaking.
        peaks: upper bounds over all time of quantities over limits, by name, as of `jaxplan.Certificate`.
        rate_jump: rad/s, the largest jump of the platform's angular velocity between intervals.
        rate_jump_time: s in the scene's time, when that is.
        attitude_jump: rad, the largest jump of the attitude; zero except with "constant_rate".
        start_off: rad, angle between the attitude at which the scene starts and the first row.
        goal_off: rad, of the last row: the largest angle between a device and its target, or the angle to the
            goal's attitude. None where the table tells about no device with a target, where targets are not
            known then, or for a timeline.
        left_out: a sentence for each thing that is not claimed.
        faults: a sentence for each thing that fails and is not forgiven.
    """

    certified: bool
    forgives: Forgiven = NOTHING
    forgiven: tuple[str, ...] = ()
    interpolation: str
    alternative: str | None = None
    rows_count: int
    numbers: int
    min_margin: float | None = None
    worst_time: float | None = None
    worst_device: str | None = None
    worst_zone: str | None = None
    peaks: dict[str, float] = field(default_factory=dict)
    rate_jump: float = 0.0
    rate_jump_time: float = 0.0
    attitude_jump: float = 0.0
    start_off: float = 0.0
    goal_off: float | None = None
    left_out: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def misses_goal(self) -> bool:
        """Whether the last row is more than 0.01 deg off the goal; False where that is not known.

        The proof is of zones, ranges and limits: a table that misses the goal may be certified.
        """
        return self.goal_off is not None and not self.goal_off <= _GOAL_TOLERANCE

    def summary(self) -> dict[str, Any]:
        """Return what is proved as a dict for JSON, in deg, s and percent, units being part of the keys."""
        margin = self.min_margin
        return {
            "certified": self.certified,
            "forgives_deg": self.forgives.deg,
            "forgives_percent": self.forgives.percent,
            "forgiven": list(self.forgiven),
            "interpolation": self.interpolation,
            "alternative": self.alternative,
            "rows": self.rows_count,
            "numbers": self.numbers,
            "faults": list(self.faults),
            "not_claimed": list(self.left_out),
            "min_margin_deg": None if margin is None else float(np.rad2deg(margin)),
            "worst_device": self.worst_device,
            "worst_zone": self.worst_zone,
            "worst_time_s": self.worst_time,
            "peaks": dict(self.peaks),
            "rate_jump_deg_s": float(np.rad2deg(self.rate_jump)),
            "rate_jump_time_s": self.rate_jump_time,
            "attitude_jump_deg": float(np.rad2deg(self.attitude_jump)),
            "start_off_deg": float(np.rad2deg(self.start_off)),
            "goal_off_deg": None if self.goal_off is None else float(np.rad2deg(self.goal_off)),
            "misses_goal": self.misses_goal,
        }

    def rows(self) -> list[tuple[str, str]]:
        """Return what is proved as (label, value) pairs for a table."""
        how = f"with {self.interpolation.replace('_', ' ')} between {self.rows_count} rows"
        if self.alternative is not None:
            how += f", zones with {self.alternative.replace('_', ' ')}, too"
        known = f"yes, at every instant {how}" if self.certified else f"no: not certified {how}"
        if self.forgiven:
            known = f"within what is forgiven, at every instant {how}"
        rows = [("certified", known), *(("", fault) for fault in self.faults)]
        if self.misses_goal and self.goal_off is not None:
            off = f"{np.rad2deg(self.goal_off):.4g} deg"
            rows.append(("misses the goal", f"by {off} in its last row, of which the proof says nothing"))
        used = "" if self.forgiven or not self.certified or self.forgives == NOTHING else "; none was needed"
        rows.append(("forgives", f"{self.forgives.words}{used}"))
        rows += [("", f"forgiven: {fault}") for fault in self.forgiven]
        worst = (self.worst_device, self.worst_zone, self.worst_time)
        rows += margin_and_peaks(self.min_margin, worst, self.peaks)
        jump = f"{np.rad2deg(self.rate_jump):.4g} deg/s at {self.rate_jump_time:.2f} s"
        rows.append(("largest jump of rate", jump))
        if self.attitude_jump > 0:
            rows.append(("largest jump of attitude", f"{np.rad2deg(self.attitude_jump):.4g} deg"))
        rows.append(("first row off the start", f"{np.rad2deg(self.start_off):.4g} deg"))
        if self.goal_off is not None:
            rows.append(("last row off the goal", f"{np.rad2deg(self.goal_off):.4g} deg"))
        rows.append(("numbers", f"{self.numbers}"))
        labels = ["not claimed", *[""] * len(self.left_out)]
        return rows + list(zip(labels, self.left_out, strict=False))

    def __str__(self) -> str:
        return "\n".join(aligned(self.rows()))

    def _repr_html_(self) -> str:
        return as_table("Certificate of a table", self.rows())


def certify_table(
    table: AttitudeTable | str | os.PathLike[str],
    interpolation: str | None,
    scenario: Scenario | Timeline,
    *,
    forgive_deg: float = FORGIVE_DEG,
    forgive_percent: float = FORGIVE_PERCENT,
) -> TableCertificate:
    """Prove what a table keeps of a scene's zones, ranges and rates as a reader uses it, or say what fails.

    Args:
        table: a table, or the path of a file for `load_attitude`, read with the scene's spacecraft.
        interpolation: what the reader does between rows, one of `jaxplan.tables.INTERPOLATIONS`; None for
            what readers of the file's format do. If they differ, margins and ranges are the worse of both.
        scenario: the scene with zones and spacecraft, or a timeline, of which only the scene counts. If both
            the table and the scene have an epoch, rows are compared with the scene at their times; else the
            table's first row is at the scene's start.
        forgive_deg: deg, by which margins may fall short of zero, in [0, 1].
        forgive_percent: percent of a limit or range by which it may be exceeded, in [0, 10].

    Returns:
        The certificate; a motion that breaks something raises nothing.

    Raises:
        TypeError: if it is no table, path or scenario.
        ValueError: if it is no table, lacks what the interpolation needs, or begins before the scene; if a
            zone is not known until the table ends; if what to forgive is out of range.

    Example:
        >>> print(jp.certify_table("slew.aem", "slerp", jp.load_scenario("scene.toml")))
    """
    expect_any("scenario", scenario, (Scenario, Timeline), "a Scenario or a Timeline")
    scene = scenario.scene if isinstance(scenario, Timeline) else scenario
    forgives = forgiven(forgive_deg, forgive_percent)
    foreign: tuple[str, ...] = ()
    if not isinstance(table, AttitudeTable):
        path = table
        try:
            table = load_attitude(path, scene.spacecraft)
        except OtherDevicesError as error:  # then nothing is claimed of devices with joints
            table, foreign = load_attitude(path), (str(error),)
    how = table.interpolation if interpolation is None else interpolation
    other = table.alternative if interpolation is None else None
    if how not in INTERPOLATIONS:
        raise ValueError(f"interpolation = {how!r}: must be one of {', '.join(INTERPOLATIONS)}")
    lacking = needs(table, how)
    if lacking is not None:
        raise ValueError(lacking)
    begin = _first_row_time(table, scene)
    table = _clip_to_known_zones(table, scene, begin)
    found = certify_rows(table, how, scene, begin, forgives, other=other)
    goal_off = found.goal_off if scene is scenario else None
    return replace(found, goal_off=goal_off, left_out=(*found.left_out, *foreign))


def certify_rows(
    table: AttitudeTable,
    how: str,
    scenario: Scenario,
    begin: float,
    forgives: Forgiven,
    *,
    other: str | None = None,
) -> TableCertificate:
    """Prove what a table keeps of a scene; see `certify_table`.

    Args:
        table: as it was read.
        how: one of `INTERPOLATIONS`, for which the table has what is needed.
        scenario: the scene.
        begin: s, the first row in the scene's time.
        forgives: by how much the table may fall short.
        other: another interpolation, for which margins and ranges must hold, too; None for none.
    """
    known, scene, unproved = as_known(table, scenario)
    times = known.times - known.times[0] + begin
    joined, claim, motion = _prove_reading(known, how, scene, times, _ACCELERATION_ORDER)
    if other is not None:
        also, _, _ = _prove_reading(known, other, scene, times, _ANGLE_ORDER)
        joined = with_margins(joined, also, other)
    jump, jump_time = _largest_rate_jump(motion, times)
    covered = bool(joined.faults) and forgives.covers(joined, claim.continuous)
    return TableCertificate(
        certified=joined.certified or covered,
        forgives=forgives,
        forgiven=joined.faults if covered else (),
        interpolation=how,
        alternative=other,
        rows_count=len(known.times),
        numbers=table.numbers,
        min_margin=joined.min_margin,
        worst_time=joined.worst_time,
        worst_device=joined.worst_device,
        worst_zone=joined.worst_zone,
        peaks=joined.peaks,
        rate_jump=jump,
        rate_jump_time=jump_time,
        attitude_jump=_largest_attitude_jump(known) if how == RATE else 0.0,
        start_off=float(so3.distance(scenario.start.attitude, known.attitudes[0])),
        goal_off=_goal_off(scenario, known, float(times[-1])),
        left_out=(*unproved, *claim.left_out),
        faults=() if covered else joined.faults,
    )


def _prove_reading(
    known: AttitudeTable, how: str, scene: Scenario, times: np.ndarray, most: int
) -> tuple[Certificate, "_TableClaim", Reading]:
    """Prove what a table with rows at `times` keeps, without limits of more than `most` time derivatives."""
    motion = reading(known, how, TOLERANCE, _RELATIVE_RATE_TOLERANCE * _least_rate_limit(scene.spacecraft))
    claim = _TableClaim.of(scene, known, how, motion, most)
    parts = [
        (number, motion.part(number, min(number + _INTERVALS_PER_BATCH, len(known.times) - 1)))
        for number in range(0, len(known.times) - 1, _INTERVALS_PER_BATCH)
    ]
    proofs = []
    with progress_bar("proving", "rows", total=len(known.times) - 1) as bar:
        for number, part in parts:
            proofs.append((times[number], certify_batch([claim.of_part(part, times[number])])[0]))
            bar.update(len(part.joint_breaks) - 1)
    stated = joined_proof(proofs)
    return replace(stated, peaks=claim.stated_peaks(stated.peaks)), claim, motion


def _first_row_time(table: AttitudeTable, scenario: Scenario) -> float:
    """Return the time of the table's first row in the scene's time, s; zero where either has no epoch.

    Raises:
        ValueError: if it is before the scene's start; if leap seconds may lie between without pyerfa.
    """
    if table.epoch is None or scenario.epoch is None:
        return 0.0
    begin = seconds_between(scenario.epoch, table.epoch) + float(table.times[0])
    if -_CLOCK_TOLERANCE <= begin < 0:
        return 0.0
    if begin < 0:
        raise ValueError(
            f"{table.name}: begins {-begin:.6g} s before the scene, which is of {scenario.epoch} on"
        )
    return begin


def _clip_to_known_zones(table: AttitudeTable, scenario: Scenario, begin: float) -> AttitudeTable:
    """Return the table with its end moved, by rounding at most, to where all zones are known.

    Raises:
        ValueError: if a zone is not known until the table ends.
    """
    span = float(table.times[-1] - table.times[0])
    for zone in scenario.zones:
        path = zone.path if zone.moves else None
        known = min(zone.lasts, np.inf if path is None else float(path.times[-1]))
        if not begin + span <= known + _CLOCK_TOLERANCE:
            raise ValueError(
                f"{table.name}: ends {begin + span:.10g} s after the scene's start, and zone {zone.name} "
                f"{'moves and ' * zone.moves}is known until {known:.10g} s: {FOR_LONGER}"
            )
        span = min(span, known - begin)
    times = np.minimum(table.times, table.times[0] + span)
    return table if times[-1] == table.times[-1] or not times[-1] > times[-2] else replace(table, times=times)


def _goal_off(scenario: Scenario, table: AttitudeTable, time: float) -> float | None:
    """Return `TableCertificate.goal_off` of the last row, which is at `time` s in the scene."""
    asked, craft = scenario.goal, scenario.spacecraft
    if isinstance(asked, GivenState):
        return float(so3.distance(asked.attitude, table.attitudes[-1]))
    whole = table.joints is not None or not craft.joint_count
    joints = np.zeros(craft.joint_count) if table.joints is None else table.joints[-1]
    beams = np.asarray(craft.boresights(table.attitudes[-1], joints))
    numbers = np.array(asked.numbers(craft), int)
    known = whole | (numbers >= craft.gimbals.count)
    there = all(path.covers(time) for path in asked.paths)
    if not (there and np.any(known)):
        return None
    apart = np.linalg.norm(beams[numbers] - np.asarray(asked.at(time).directions), axis=-1)
    return float(np.max(2 * np.arcsin(np.clip(apart[known] / 2, 0, 1))))


def _least_rate_limit(craft: Spacecraft) -> float:
    """Return the least limit of the platform's angular velocity, of an axis or of its length, rad/s."""
    least = float(np.min(craft.rate_limit))
    return least if craft.rate_norm_limit is None else min(least, float(craft.rate_norm_limit))


@dataclass(frozen=True, kw_only=True, eq=False)
class _TableClaim:
    """What is claimed of a reader's motion.

    Attributes:
        scene: the scene with zones and spacecraft.
        craft: the spacecraft with limits of rate lowered by `rate_off`.
        robust: the scene's errors, with `Reading.off` added to that of the attitude; None for none.
        limits: names of the quantities whose limits are claimed.
        continuous: number of derivatives that must be continuous; -1 where attitudes may jump.
        rate_off: rad/s, by which the angular velocity of the pieces may be off.
        left_out: sentences on what is not claimed, and why.
    """

    scene: Scenario
    craft: Spacecraft
    robust: Robust | None
    limits: frozenset[str]
    continuous: int
    rate_off: float
    left_out: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scenario, table: AttitudeTable, how: str, motion: Reading, most: int) -> "_TableClaim":
        """Return the claim for a reader's motion, without limits of more than `most` time derivatives."""
        craft, off = scene.spacecraft, motion.rate_off
        smooth = how == HERMITE and (not table.joint_names or table.joint_rates is not None)
        every = [limit.quantity for limit in limits(craft)]
        claimed = {
            quantity.name
            for quantity in every
            if quantity.power <= min(most, _ACCELERATION_ORDER if smooth else _RATE_ORDER)
            and (smooth or not quantity.by_inertia)
            and not quantity.of_wheels
        }
        left = [quantity for quantity in every if quantity.name not in claimed]
        jumping = ", ".join(each.name.replace("_", " ") for each in left if not each.of_wheels)
        reason = "accelerations jump" if smooth else "rates jump"
        of_wheels = ", ".join(each.name.replace("_", " ") for each in left if each.of_wheels)
        told = [f"{jumping}: {reason} from row to row"] if jumping else []
        if of_wheels:
            told.append(f"{of_wheels}: what wheels hold at a row depends on all that came before")
        robust = scene.robust
        if motion.off > 0:
            own = robust or Robust()
            robust = replace(own, attitude_error=float(own.attitude_error) + motion.off)
        return cls(
            scene=scene,
            craft=replace(
                craft,
                rate_limit=np.asarray(craft.rate_limit, float) - off,
                rate_norm_limit=None if craft.rate_norm_limit is None else float(craft.rate_norm_limit) - off,
            ),
            robust=robust,
            limits=frozenset(claimed),
            continuous=1 if smooth else (-1 if how == RATE else 0),
            rate_off=off,
            left_out=tuple(told),
        )

    def of_part(self, part: Reading, begin: float) -> Claim:
        """Return the claim for a part that begins at a time in the scene, s."""
        moved = replace(later(self.scene, begin, float(part.breaks[-1])), spacecraft=self.craft)
        stated = moved.stated
        return Claim(
            trajectory=part,
            spacecraft=self.craft,
            cones=stated,
            zone_names=[moved.zones[zone].name for zone in stated.zone if zone >= 0],
            sight_names=moved.sight_names,
            robust=self.robust,
            limits=self.limits,
            continuous=self.continuous,
        )

    def stated_peaks(self, peaks: dict[str, float]) -> dict[str, float]:
        """Convert peaks over the lowered limits of rates into peaks over the limits that the scene states."""
        found = dict(peaks)
        whole = float(np.min(self.scene.spacecraft.rate_limit))
        for name, stated in (
            ("angular_velocity", whole),
            ("angular_velocity_norm", self.scene.spacecraft.rate_norm_limit),
        ):
            if name in found and stated is not None:
                share = self.rate_off / float(stated)
                found[name] = found[name] * (1 - share) + share
        return found


def _largest_rate_jump(motion: Reading, times: np.ndarray) -> tuple[float, float]:
    """Return the largest jump of angular velocity between intervals, rad/s, and its time, s."""
    jumps = np.linalg.norm(motion.begins[1:] - motion.ends[:-1], axis=1)
    if not len(jumps):
        return 0.0, float(times[0])
    worst = int(np.argmax(jumps))
    return float(jumps[worst]), float(times[1 + worst])


def _largest_attitude_jump(table: AttitudeTable) -> float:
    """Return the largest angle, rad, by which the constant rate of one row misses the next row."""
    assert table.angular_velocity is not None
    turns = np.diff(table.times)[:, None] * table.angular_velocity[:-1]
    reached = table.attitudes[:-1] @ so3.exp(turns)
    return float(np.max(so3.distance(reached, table.attitudes[1:])))
