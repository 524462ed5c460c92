"""Motions of plans and of tables over time: joints, how far each is off the first, and rates.

A table moves between its rows as its readers fly it (`jaxplan.tables.interpolation`), and rates are those of
that motion, so that jumps from row to row are strokes. A table with an epoch stands at its times where the
first plan has one, too; else its first row is time zero, as where it is proved (`jaxplan.certify_table`).

Attitudes are compared by the rotation from the first motion to another, as a rotation vector in body axes.
Inside are radians and seconds, on the axes degrees and seconds.
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

_INSTANTS = 880  # times of the grid, besides rows and breaks
_MOST_ROWS = 20_000  # of a table that are drawn, with both sides each; of more the grid alone
_SIDE = 1e-3  # of an interval, by which a rate is taken beside an instant
_STILL = 1e-6  # rad: turns below which an axis is no axis
_FAR = 1.5  # multiple of the highest value beyond which a limit is written and not drawn
_RATE = 2  # number of the row of rates


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """A motion that can be asked for its state at any time of its span.

    Attributes:
        what: it is, for the legend.
        first: s, its begin.
        last: s, its end.
        corners: (c,) s at which its rates may jump.
        trajectory: that it is; None of a table.
        table: that it is, with times from its epoch; None of a trajectory.
        shift: s, to be added to a table's times.
        columns: (J,) numbers of the table's columns of the joints; None where it has none.
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
        """Whether its joints are known."""
        return self.table is None or self.columns is not None

    def state(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Quaternions (k, 4) and joints (k, J) rad, None where they are not known, at times (k,) s."""
        if self.trajectory is not None:
            values = self.trajectory.sample(times)
            return np.asarray(quaternion.from_matrix(values.attitude)), values.joints
        assert self.table is not None
        own = np.clip(times - self.shift, self.table.times[0], self.table.times[-1])
        turned, joints = sampled(self.table, self.table.interpolation, own)
        return turned, None if joints is None or self.columns is None else joints[:, self.columns]

    def rates(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Angular velocity (k, 3) rad/s in body axes, and rates of joints (k, J) rad/s, at times (k,) s."""
        if self.trajectory is not None:
            values = self.trajectory.sample(times)
            return values.angular_velocity, values.joint_rates
        before, after = self._sides(times)
        (begin, joints), (end, joints_after) = self.state(before), self.state(after)
        step = (after - before)[:, None]
        turn = quaternion.log(_shorter(quaternion.product(quaternion.conjugate(begin), end)))
        moved = None if joints is None or joints_after is None else (joints_after - joints) / step
        return np.asarray(turn) / step, moved

    def _sides(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Instants (k,) s to either side, in the same interval of the table."""
        assert self.table is not None
        rows = self.table.times + self.shift
        own = np.clip(np.searchsorted(rows, times, side="right") - 1, 0, len(rows) - 2)
        side = _SIDE * (rows[own + 1] - rows[own])
        middle = np.clip(times, rows[own] + side, rows[own + 1] - side)
        return middle - side, middle + side

    def grid(self, other: "_Motion") -> np.ndarray:
        """Times (k,) s to draw it at: a grid, with both sides of its corners, and those of another."""
        even = np.linspace(self.first, self.last, _INSTANTS if self.last > self.first else 1)
        corners = np.concatenate([self.corners, other.corners])
        corners = corners[(corners > self.first) & (corners < self.last)]
        return np.unique(np.concatenate([even, corners, np.nextafter(corners, -np.inf)]))


def _shorter(turned: np.ndarray) -> np.ndarray:
    """Quaternions (k, 4) of the same rotations, of half a turn at most."""
    return np.where(turned[:, :1] < 0, -turned, turned)


def _motions(given: Mapping[str, Trajectory | Plan | AttitudeTable], craft: Spacecraft) -> dict[str, _Motion]:
    """Motions by name, in one time.

    Args:
        given: trajectories, plans with one, and tables.
        craft: whose joints are meant.

    Raises:
        ValueError: if there are leap seconds between epochs, and pyerfa is not installed.
    """
    epochs = [each.scenario.epoch for each in given.values() if isinstance(each, Plan)]
    zero = next((epoch for epoch in epochs if epoch is not None), None)
    return {name: _motion_of(each, craft, zero) for name, each in given.items()}


def _motion_of(
    given: Trajectory | Plan | AttitudeTable, craft: Spacecraft, zero: np.datetime64 | None
) -> _Motion:
    """One motion, see `_motions`; `zero` is the UTC of time zero, None where it is not known."""
    if isinstance(given, AttitudeTable):
        return _of_table(given, craft, zero)
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


def _of_table(table: AttitudeTable, craft: Spacecraft, zero: np.datetime64 | None) -> _Motion:
    """The motion of a table."""
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
        corners=rows if len(rows) <= _MOST_ROWS else np.zeros(0),
        table=table,
        shift=shift,
        columns=np.array([names.index(name) for name in wanted], int) if known else None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curves:
    """What is drawn of a motion.

    Attributes:
        times: (k,) s.
        turned: (k, 3) rad, rotation from the first attitude of the first motion, continuous.
        off: (k, 3) rad, rotation from the first motion's attitude to its own; NaN outside of that's span.
        spin: (k, 3) rad/s.
        joints: (3, k, J) likewise, angles, how far they are off, and rates; NaN where they are not known.
    """

    times: np.ndarray
    turned: np.ndarray
    off: np.ndarray
    spin: np.ndarray
    joints: np.ndarray

    @classmethod
    def of(cls, motion: _Motion, first: _Motion, joint_count: int) -> "_Curves":
        """Sample a motion beside the first one."""
        times = motion.grid(first)
        attitude, joints = motion.state(times)
        spin, joint_rates = motion.rates(times)
        begin = first.state(np.array([first.first]))[0]
        there = (times >= first.first) & (times <= first.last)
        of_first, joints_of_first = first.state(np.clip(times, first.first, first.last))
        off = np.array(_difference(of_first, attitude))
        off[~there] = np.nan
        unknown = np.full((len(times), joint_count), np.nan)
        apart = unknown
        if joints is not None and joints_of_first is not None:
            apart = np.where(there[:, None], joints - joints_of_first, np.nan)
        return cls(
            times=times,
            turned=_continuous(_difference(begin, attitude)),
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


def _difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Rotation vectors (k, 3) rad in body axes from attitudes to others, the shorter way."""
    return np.asarray(quaternion.log(_shorter(quaternion.product(quaternion.conjugate(one), other))))


def _continuous(turned: np.ndarray) -> np.ndarray:
    """The same rotations with vectors that do not turn over where they pass half a turn, (k, 3) rad."""
    found = turned.copy()
    for row in range(1, len(found)):
        before = found[row - 1]
        angle = float(np.linalg.norm(found[row]))
        along = found[row] / angle if angle > _STILL else before / max(float(np.linalg.norm(before)), _STILL)
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
    """Draw motions with tables among them; see `jaxplan.plotting.trajectory_columns.compare`."""
    motions = _motions(given, craft)
    named = next(iter(motions))
    first = motions[named]
    count = craft.joint_count
    curves = {name: _Curves.of(motion, first, count) for name, motion in motions.items()}
    titles = [*BODY]
    spin = np.asarray(np.broadcast_to(craft.rate_limit, 3), float)
    values = {name: np.stack([own.turned, own.off, own.spin]) for name, own in curves.items()}  # (3, k, 3)
    if count and any(motion.has_joints for motion in motions.values()):
        limits = timed_limits(craft)[1][0].bound
        joint = _most_off(list(curves.values()), limits)
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
        if row == _RATE:
            columns = slice(0, 3) if column < 3 else slice(3, 4)
            highest = max(np.max(_largest(own[row, :, columns])) for own in values.values())
            ends = both_sides(np.rad2deg(spin[column, None]))
            limited = limit_lines(axes, ends, [{"color": GREY}], np.rad2deg(highest), far=_FAR) or limited
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


def _most_off(curves: list[_Curves], limits: np.ndarray) -> int:
    """Number of the joint that is farthest off in any motion; if none is off, the fastest for its limit."""
    off = np.max([_largest(own.joints[1]) for own in curves], axis=0)
    if not np.max(off, initial=0.0) > 0:
        off = np.max([_largest(own.joints[2]) for own in curves], axis=0) / limits
    return int(np.argmax(off))


def _largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitudes (J,) of values (k, J) that are known; zero where none is."""
    return np.asarray(np.max(np.nan_to_num(np.abs(values)), axis=0))
