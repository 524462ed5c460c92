"""Motions of plans and tables compared over time: turns, differences from the first motion, and rates.

Between its rows a table moves as its readers interpolate it (`jaxplan.tables.interpolation`); rates are those
of that motion, so a jump from row to row is drawn as a vertical stroke. A table that has an epoch is placed
in time by it if a plan has one, too; otherwise its first row is at time zero, as it is where the table is
proved (`jaxplan.certify_table`).

Attitudes are compared by the rotation from the first motion to another, as a rotation vector in body axes.
Quaternions have their scalar first and turn body axes into inertial ones. J is the number of joints. Values
are in radians and seconds, the axes in degrees and seconds.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxplan.geometry import quaternion
from jaxplan.model.epochs import seconds_between
from jaxplan.model.limits import timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.limit_lines import both_sides, limit_lines
from jaxplan.plotting.style import (
    GREY,
    TEXT,
    Canvas,
    Entries,
    Look,
    curve,
    device_style,
    legend_beside,
    panels,
    plain,
    time_span,
)
from jaxplan.plotting.time_panels import BODY
from jaxplan.tables import AttitudeTable, sampled
from jaxplan.tables.table import column_name
from jaxplan.trajectory import Trajectory

_GRID_INSTANTS = 880  # times of the even grid, to which rows of tables and breaks are added
_MAX_ROWS = 20_000  # rows of a table up to which all are drawn from both sides; else the even grid alone
_HALF_STEP = 1e-3  # half the step of difference quotients for rates, in intervals of the table
_MIN_TURN = 1e-6  # rad: turns below which an axis is no axis
_FAR_LIMIT_RATIO = 1.5  # multiple of the largest magnitude beyond which a limit is written and not drawn
_RATE_ROW = 2  # index of the row of panels that shows rates


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """A trajectory or a table, whose state can be computed at any time of its span; one of both is None.

    Attributes:
        what: kind of motion, for the legend.
        first: s, when it begins.
        last: s, when it ends.
        corners: (c,) s at which its rates may jump.
        trajectory: the trajectory; None for a table.
        table: the table; None for a trajectory.
        shift: s, added to the table's times to get the time of the figure.
        columns: (J,) indices of the table's columns in the order of the spacecraft's joints; None if it lacks
            any of them.
    """

    what: str
    first: float
    last: float
    corners: np.ndarray
    trajectory: Trajectory | None = None
    table: AttitudeTable | None = None
    shift: float = 0.0
    columns: np.ndarray | None = None

    @property
    def has_joints(self) -> bool:
        """Whether the angles of its joints are known."""
        return self.table is None or self.columns is not None

    def state(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Compute the state at times (k,), s; a table is held constant beyond its ends.

        Returns:
            Quaternions (k, 4), and joints (k, J) in rad, None where they are not known.
        """
        if self.trajectory is not None:
            values = self.trajectory.sample(times)
            return np.asarray(quaternion.from_matrix(values.attitude)), values.joints
        assert self.table is not None
        own = np.clip(times - self.shift, self.table.times[0], self.table.times[-1])
        turned, joints = sampled(self.table, self.table.interpolation, own)
        return turned, None if joints is None or self.columns is None else joints[:, self.columns]

    def rates(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Compute rates at times (k,), s; those of a table by difference quotients.

        Returns:
            Angular velocity (k, 3) in rad/s, body axes, and joint rates (k, J) in rad/s, None where not
            known.
        """
        if self.trajectory is not None:
            values = self.trajectory.sample(times)
            return values.angular_velocity, values.joint_rates
        before, after = self._bracket_times(times)
        (begin, joints), (end, joints_after) = self.state(before), self.state(after)
        step = (after - before)[:, None]
        turn = quaternion.log(_shorten_turns(quaternion.product(quaternion.conjugate(begin), end)))
        moved = None if joints is None or joints_after is None else (joints_after - joints) / step
        return np.asarray(turn) / step, moved

    def _bracket_times(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return instants (k,), s, before and after times (k,), s, within the same interval of the table."""
        assert self.table is not None
        rows = self.table.times + self.shift
        own = np.clip(np.searchsorted(rows, times, side="right") - 1, 0, len(rows) - 2)
        side = _HALF_STEP * (rows[own + 1] - rows[own])
        middle = np.clip(times, rows[own] + side, rows[own + 1] - side)
        return middle - side, middle + side

    def grid(self, other: "_Motion") -> np.ndarray:
        """Return times (k,), s, at which to draw this motion beside another one.

        They are an even grid over its span, with both sides of the corners of both motions.
        """
        even = np.linspace(self.first, self.last, _GRID_INSTANTS if self.last > self.first else 1)
        corners = np.concatenate([self.corners, other.corners])
        corners = corners[(corners > self.first) & (corners < self.last)]
        return np.unique(np.concatenate([even, corners, np.nextafter(corners, -np.inf)]))


def _shorten_turns(turned: np.ndarray) -> np.ndarray:
    """Flip signs of quaternions (k, 4) so that their scalar is >= 0: turns of at most half a turn."""
    return np.where(turned[:, :1] < 0, -turned, turned)


def _to_motions(
    given: Mapping[str, Trajectory | Plan | AttitudeTable], craft: Spacecraft
) -> dict[str, _Motion]:
    """Convert trajectories, plans and tables to motions by name, in a common time.

    Time zero is the start of trajectories and plans, and for tables with an epoch the first epoch of a plan.

    Args:
        given: trajectories, plans with one, and tables.
        craft: whose joints are meant.

    Raises:
        ValueError: if leap seconds between epochs matter, and pyerfa is not installed.
    """
    epochs = [each.scenario.epoch for each in given.values() if isinstance(each, Plan)]
    zero = next((epoch for epoch in epochs if epoch is not None), None)
    return {name: _to_motion(each, craft, zero) for name, each in given.items()}


def _to_motion(
    given: Trajectory | Plan | AttitudeTable, craft: Spacecraft, zero: np.datetime64 | None
) -> _Motion:
    """Convert one of them, see `_to_motions`; `zero` is the UTC of time zero, None where it is not known."""
    if isinstance(given, AttitudeTable):
        return _table_to_motion(given, craft, zero)
    trajectory = given.trajectory if isinstance(given, Plan) else given
    assert trajectory is not None
    what = "trajectory"
    if isinstance(given, Plan):
        what = "certified plan" if given.ok else f"plan, {given.status.value}"
    return _Motion(
        what=what,
        first=0.0,
        last=trajectory.duration,
        corners=np.unique(np.concatenate([trajectory.breaks, trajectory.joint_breaks])),
        trajectory=trajectory,
    )


def _table_to_motion(table: AttitudeTable, craft: Spacecraft, zero: np.datetime64 | None) -> _Motion:
    """Convert a table, see `_to_motions`."""
    shift = -float(table.times[0])
    if zero is not None and table.epoch is not None:
        shift = seconds_between(zero, table.epoch)
    rows = table.times + shift
    names = [column_name(name) for name in table.joint_names]
    wanted = [column_name(name) for name in craft.joint_names]
    known = table.joints is not None and bool(wanted) and set(wanted) <= set(names)
    return _Motion(
        what=f"table, {len(rows)} rows, {table.interpolation.replace('_', ' ')}",
        first=float(rows[0]),
        last=float(rows[-1]),
        corners=rows if len(rows) <= _MAX_ROWS else np.zeros(0),
        table=table,
        shift=shift,
        columns=np.array([names.index(name) for name in wanted], int) if known else None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curves:
    """What is drawn of a motion, at k times.

    Attributes:
        times: (k,) s.
        turned: (k, 3) rad, rotation vector from the first attitude of the first motion, continuous.
        off: (k, 3) rad, rotation vector from the first motion's attitude to its own; NaN outside the span of
            the first motion.
        spin: (k, 3) rad/s, angular velocity in body axes.
        joints: (3, k, J) angles, differences from the first motion, rad, and rates, rad/s; NaN where not
            known.
    """

    times: np.ndarray
    turned: np.ndarray
    off: np.ndarray
    spin: np.ndarray
    joints: np.ndarray

    @classmethod
    def of(cls, motion: _Motion, first: _Motion, joint_count: int) -> "_Curves":
        """Sample a motion and its difference from the first motion."""
        times = motion.grid(first)
        attitude, joints = motion.state(times)
        spin, joint_rates = motion.rates(times)
        begin = first.state(np.array([first.first]))[0]
        there = (times >= first.first) & (times <= first.last)
        of_first, joints_of_first = first.state(np.clip(times, first.first, first.last))
        off = np.array(_rotations_between(of_first, attitude))
        off[~there] = np.nan
        unknown = np.full((len(times), joint_count), np.nan)
        apart = unknown
        if joints is not None and joints_of_first is not None:
            apart = np.where(there[:, None], joints - joints_of_first, np.nan)
        return cls(
            times=times,
            turned=_unwrap_rotations(_rotations_between(begin, attitude)),
            off=off,
            spin=spin,
            joints=np.stack(
                [
                    unknown if joints is None else joints,
                    apart,
                    unknown if joint_rates is None else joint_rates,
                ]
            ),
        )


def _rotations_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return rotation vectors (k, 3), rad, in body axes, from attitudes `one` to attitudes `other`, (k, 4).

    They take the shorter way, of half a turn at most.
    """
    return np.asarray(quaternion.log(_shorten_turns(quaternion.product(quaternion.conjugate(one), other))))


def _unwrap_rotations(turned: np.ndarray) -> np.ndarray:
    """Return rotation vectors (k, 3), rad, of the same rotations, without jumps after half a turn."""
    found = turned.copy()
    for row in range(1, len(found)):
        before = found[row - 1]
        angle = float(np.linalg.norm(found[row]))
        along = (
            found[row] / angle
            if angle > _MIN_TURN
            else before / max(float(np.linalg.norm(before)), _MIN_TURN)
        )
        turns = np.round((float(before @ along) - angle) / (2 * np.pi))
        found[row] += 2 * np.pi * turns * along
    return found


def against(
    given: Mapping[str, Trajectory | Plan | AttitudeTable],
    craft: Spacecraft,
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Draw motions with tables among them; arguments and result are those of `trajectory_columns.compare`."""
    motions = _to_motions(given, craft)
    named = next(iter(motions))
    first = motions[named]
    count = craft.joint_count
    curves = {name: _Curves.of(motion, first, count) for name, motion in motions.items()}
    titles = [*BODY]
    spin = np.asarray(np.broadcast_to(craft.rate_limit, 3), float)
    values = {name: np.stack([own.turned, own.off, own.spin]) for name, own in curves.items()}  # (3, k, 3)
    if count and any(motion.has_joints for motion in motions.values()):
        limits = timed_limits(craft)[1][0].bound
        joint = _most_different_joint(list(curves.values()), limits)
        titles.append(craft.joint_names[joint])
        values = {name: np.dstack([own, curves[name].joints[..., joint]]) for name, own in values.items()}
        spin = np.append(spin, limits[joint])
    across = len(titles)
    every = panels(ax, 3 * across, (2.7 * across + 2.4, 6.2), columns=across, alone=across - 3)
    styles: list[Look] = [{**device_style(number), "linewidth": 1.4} for number in range(len(motions))]
    limited: Entries = []
    for axes, (row, column) in zip(every, np.ndindex(3, across), strict=True):
        for name, look in zip(motions, styles, strict=True):
            own = np.rad2deg(values[name][row, :, column])
            if np.any(np.isfinite(own)):
                curve(axes, curves[name].times, own, **look)
        if row == _RATE_ROW:
            columns = slice(0, 3) if column < 3 else slice(3, 4)
            highest = max(np.max(_largest_magnitudes(own[row, :, columns])) for own in values.values())
            ends = both_sides(np.rad2deg(spin[column, None]))
            limited = (
                limit_lines(axes, ends, [{"color": GREY}], np.rad2deg(highest), far=_FAR_LIMIT_RATIO)
                or limited
            )
    labels = ("turned from the start\n(deg)", f"off {named}\n(deg)", "rate\n(deg/s)")
    for label, axes in zip(labels, every[::across], strict=True):
        plain(axes.set_ylabel(label, fontsize=TEXT))
    for axes in every[3:across]:  # that of the joint
        axes.set_ylabel("angle (deg)", fontsize=TEXT)
    end = max(float(own.times[-1]) for own in curves.values())
    for column, title in enumerate(titles):
        plain(every[column].set_title(title, fontsize=TEXT))
        time_span(every[column::across], end)
    if legend:
        entries: Entries = [
            (Line2D([], [], **look), f"{name}\n({motion.what})")
            for (name, motion), look in zip(motions.items(), styles, strict=True)
        ]
        legend_beside(every[across - 1], [*entries, *limited])
    return every


def _most_different_joint(curves: list[_Curves], limits: np.ndarray) -> int:
    """Return the index of the joint that differs most from the first motion.

    If none differs it is the joint that is fastest in relation to its limit, of `limits` (J,) in rad/s.
    """
    off = np.max([_largest_magnitudes(own.joints[1]) for own in curves], axis=0)
    if not np.max(off, initial=0.0) > 0:
        off = np.max([_largest_magnitudes(own.joints[2]) for own in curves], axis=0) / limits
    return int(np.argmax(off))


def _largest_magnitudes(values: np.ndarray) -> np.ndarray:
    """Return the largest magnitudes (J,) of values (k, J), ignoring NaN; zero where all are NaN."""
    return np.asarray(np.max(np.nan_to_num(np.abs(values)), axis=0))
