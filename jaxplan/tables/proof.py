"""What is proved of a table as a reader flies it: zones, ranges and rates at every instant.

The motion between rows is that of `jaxplan.tables.interpolation`, and the prover that of plans. Where a
reader's angular velocity jumps from interval to interval nothing can be said of accelerations and torque; the
jumps are told instead. Nothing is said of wheels, since a table does not know what they hold. A table without
joints is proved for the platform and for what is fixed to it.
"""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate, Claim, certify_batch, margin_and_peaks
from jaxplan.model.epochs import seconds_between
from jaxplan.model.goals import GivenState
from jaxplan.model.limits import limits
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.time_shift import later
from jaxplan.model.timeline import Timeline
from jaxplan.planner.messages import FOR_LONGER
from jaxplan.runtime.arguments import expect_any
from jaxplan.runtime.display import aligned, as_table, shown
from jaxplan.runtime.progress import progress_bar
from jaxplan.tables.devices import OtherDevicesError
from jaxplan.tables.files import load_attitude
from jaxplan.tables.interpolation import Reading, needs, reading
from jaxplan.tables.joined_certificates import joined_proof, with_margins
from jaxplan.tables.table import HERMITE, INTERPOLATIONS, RATE, AttitudeTable
from jaxplan.tables.table_scene import as_known
from jaxplan.tables.tolerances import FORGIVE_DEG, FORGIVE_PERCENT, NOTHING, Forgiven, forgiven

TOLERANCE = np.deg2rad(1e-4)
"""rad: by which the pieces that are proved may be off a reader's motion; it is taken off margins."""
_RATE_SHARE = 1e-4  # of the least limit of a rate, by which their angular velocity may be off
_CLOCK = 1e-3  # s, by which a table may begin before the scene, as times are rounded
_AT_GOAL = np.deg2rad(0.01)  # rad, off the goal by which a last row is told to miss it
_TOGETHER = 500  # intervals of a table that are proved at once
_ANGLES, _RATES, _ACCELERATIONS = 0, 1, 2  # the power of time that limits of them fall by


@shown("certified", "faults", "min_margin deg", "worst_device", "worst_zone", "worst_time s", "interpolation")
@dataclass(frozen=True, kw_only=True, eq=False)
class TableCertificate:
    """What is proved of a table, for all times and not for its rows alone.

    Attributes:
        certified: whether everything holds that is claimed, but for what is forgiven.
        forgives: by how much the table may fall short.
        forgiven: a sentence for each thing that fails by no more than that; without them nothing fails.
        interpolation: what is done between rows, one of `jaxplan.tables.INTERPOLATIONS`.
        alternative: what some readers do instead, with which margins and ranges hold, too; None for nothing.
        rows_count: of the table.
        numbers: that the table takes.
        min_margin: rad, lower bound over all time, devices and zones; None where no zone binds a device of
            which something is known.
        worst_time: s in the scene's time, when it is smallest.
        worst_device: whose margin that is.
        worst_zone: to which zone.
        peaks: upper bounds over all time over the limit, by name, as of `jaxplan.Certificate`.
        rate_jump: rad/s, the largest jump of the platform's angular velocity from interval to interval.
        rate_jump_time: s in the scene's time, when that is.
        attitude_jump: rad, the largest jump of the attitude; zero but with "constant_rate".
        start_off: rad, from the attitude at which the scene starts to the first row.
        goal_off: rad, in the last row: the largest angle between a device and its target, as far as the table
            knows devices; or from the goal's attitude. None where it knows none that has a target, or the
            targets are not known then, or where the table is held against a timeline.
        left_out: a sentence for each thing that is not claimed.
        faults: a sentence for each thing that fails.
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
        """Tell whether the last row is more than 0.01 deg off the goal; False where that is not known.

        The proof is of zones, ranges and limits: a table that misses the goal may be certified.
        """
        return self.goal_off is not None and not self.goal_off <= _AT_GOAL

    def summary(self) -> dict[str, Any]:
        """What is proved as a dict for JSON, in the units of files."""
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
        """What is proved, as (label, value) rows for a table."""
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
    """Prove what a table keeps of a scene's zones, ranges and rates as a reader flies it, or say what fails.

    Args:
        table: a table, or the path of a file as `load_attitude` reads it, with the scene's spacecraft.
        interpolation: what the reader does between rows, one of `jaxplan.tables.INTERPOLATIONS`; None for
            what readers of the file's format do: where they differ, as those of messages with angular
            velocities do, margins and ranges are the lesser of both.
        scenario: the scene with zones and spacecraft, or a timeline, whose scene counts and not its
            activities. A table with an epoch is held against it at its times where the scene has one, too;
            else the table's first row is the scene's start.
        forgive_deg: by which margins may fall short of zero, in [0, 1]; as exports forgive unless told.
        forgive_percent: of a limit or range, by which it may be exceeded, in [0, 10]; likewise.

    Returns:
        The certificate; a motion that breaks something is no error.

    Raises:
        TypeError: if it is no table, path or scenario.
        ValueError: for a file that is no table, or one that lacks what the interpolation takes; where a zone
            that moves is not known to the end of the table; or what is to be forgiven lies outside.

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
        except OtherDevicesError as error:  # of these nothing is claimed then
            table, foreign = load_attitude(path), (str(error),)
    how = table.interpolation if interpolation is None else interpolation
    other = table.alternative if interpolation is None else None
    if how not in INTERPOLATIONS:
        raise ValueError(f"interpolation = {how!r}: must be one of {', '.join(INTERPOLATIONS)}")
    lacking = needs(table, how)
    if lacking is not None:
        raise ValueError(lacking)
    begin = _begin(table, scene)
    table = _known_part(table, scene, begin)
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
    """Prove what a table keeps of a scene, see `certify_table`.

    Args:
        table: as it was read.
        how: one of `INTERPOLATIONS`, for which the table has what is needed.
        scenario: the scene.
        begin: s, the time of the first row in the scene's time.
        forgives: by how much it may fall short.
        other: another interpolation, with which margins and ranges must hold, too; None for none.
    """
    known, scene, unproved = as_known(table, scenario)
    times = known.times - known.times[0] + begin
    joined, claim, motion = _proved(known, how, scene, times, _ACCELERATIONS)
    if other is not None:
        also, _, _ = _proved(known, other, scene, times, _ANGLES)
        joined = with_margins(joined, also, other)
    jump, jump_time = _largest_jump(motion, times)
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
        attitude_jump=_largest_miss(known) if how == RATE else 0.0,
        start_off=float(so3.distance(scenario.start.attitude, known.attitudes[0])),
        goal_off=_goal_off(scenario, known, float(times[-1])),
        left_out=(*unproved, *claim.left_out),
        faults=() if covered else joined.faults,
    )


def _proved(
    known: AttitudeTable, how: str, scene: Scenario, times: np.ndarray, most: int
) -> tuple[Certificate, "_Claimed", Reading]:
    """Prove what a table keeps with an interpolation, of limits that fall by a power of time up to `most`."""
    motion = reading(known, how, TOLERANCE, _RATE_SHARE * _least_rate(scene.spacecraft))
    claim = _Claimed.of(scene, known, how, motion, most)
    parts = [
        (number, motion.part(number, min(number + _TOGETHER, len(known.times) - 1)))
        for number in range(0, len(known.times) - 1, _TOGETHER)
    ]
    proofs = []
    with progress_bar("proving", "rows", total=len(known.times) - 1) as bar:
        for number, part in parts:
            proofs.append((times[number], certify_batch([claim.of_part(part, times[number])])[0]))
            bar.update(len(part.joint_breaks) - 1)
    stated = joined_proof(proofs)
    return replace(stated, peaks=claim.stated_peaks(stated.peaks)), claim, motion


def _begin(table: AttitudeTable, scenario: Scenario) -> float:
    """Time of the table's first row in the scene's time, s.

    Raises:
        ValueError: if that is before the scene's start; if leap seconds may lie between the two, and pyerfa
            is not installed.
    """
    if table.epoch is None or scenario.epoch is None:
        return 0.0
    begin = seconds_between(scenario.epoch, table.epoch) + float(table.times[0])
    if -_CLOCK <= begin < 0:
        return 0.0
    if begin < 0:
        raise ValueError(
            f"{table.name}: begins {-begin:.6g} s before the scene, which is of {scenario.epoch} on"
        )
    return begin


def _known_part(table: AttitudeTable, scenario: Scenario, begin: float) -> AttitudeTable:
    """A table that begins at a time, s; its end not after that of what is known, as far as times are rounded.

    Raises:
        ValueError: if a zone is not known to its end.
    """
    span = float(table.times[-1] - table.times[0])
    for zone in scenario.zones:
        path = zone.path if zone.moves else None
        known = min(zone.lasts, np.inf if path is None else float(path.times[-1]))
        if not begin + span <= known + _CLOCK:
            raise ValueError(
                f"{table.name}: ends {begin + span:.10g} s after the scene's start, and zone {zone.name} "
                f"{'moves and ' * zone.moves}is known until {known:.10g} s: {FOR_LONGER}"
            )
        span = min(span, known - begin)
    times = np.minimum(table.times, table.times[0] + span)
    return table if times[-1] == table.times[-1] or not times[-1] > times[-2] else replace(table, times=times)


def _goal_off(scenario: Scenario, table: AttitudeTable, time: float) -> float | None:
    """How far the last row is off the goal at a time of the scene, s, see `TableCertificate`."""
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


def _least_rate(craft: Spacecraft) -> float:
    """The least limit of the platform's angular velocity, rad/s."""
    least = float(np.min(craft.rate_limit))
    return least if craft.rate_norm_limit is None else min(least, float(craft.rate_norm_limit))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Claimed:
    """What is claimed of a reader's motion.

    Attributes:
        scene: whose zones and spacecraft they are.
        craft: with what the pieces are off taken off its limits of rate.
        robust: the scene's errors with what the pieces are off.
        limits: names of quantities.
        continuous: number of derivatives.
        rate_off: rad/s, taken off.
        left_out: what is not claimed, and why.
    """

    scene: Scenario
    craft: Spacecraft
    robust: Robust | None
    limits: frozenset[str]
    continuous: int
    rate_off: float
    left_out: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scenario, table: AttitudeTable, how: str, motion: Reading, most: int) -> "_Claimed":
        """The claim of a table's reading, of limits that fall by a power of time up to `most`."""
        craft, off = scene.spacecraft, motion.rate_off
        smooth = how == HERMITE and (not table.joint_names or table.joint_rates is not None)
        every = [limit.quantity for limit in limits(craft)]
        claimed = {
            quantity.name
            for quantity in every
            if quantity.power <= min(most, _ACCELERATIONS if smooth else _RATES)
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
        """The claim of a part that begins at a time of the scene, s."""
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
        """Peaks over the limits as they are stated, from those over what was left of them."""
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


def _largest_jump(motion: Reading, times: np.ndarray) -> tuple[float, float]:
    """The largest jump of angular velocity from one interval of a table to the next, rad/s, and when, s."""
    jumps = np.linalg.norm(motion.begins[1:] - motion.ends[:-1], axis=1)
    if not len(jumps):
        return 0.0, float(times[0])
    worst = int(np.argmax(jumps))
    return float(jumps[worst]), float(times[1 + worst])


def _largest_miss(table: AttitudeTable) -> float:
    """The largest angle, rad, by which constant rates from one row on miss the next."""
    assert table.angular_velocity is not None
    turns = np.diff(table.times)[:, None] * table.angular_velocity[:-1]
    reached = table.attitudes[:-1] @ so3.exp(turns)
    return float(np.max(so3.distance(reached, table.attitudes[1:])))
