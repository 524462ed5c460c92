"""The instants at which a file has samples: in equal steps, or as far apart as interpolation allows.

A day of long tracks and short slews needs few instants in the former and many in the latter. They are chosen
so that interpolation between neighbours stays within a tolerance of the motion. All usual readers are
considered: for the attitude, and for the frame of each device relative to the body, a turn about one axis
(CSPICE, STK) and quaternions with linear components (CCSDS's LINEAR, tables); for joints, linear angles; and
for Basilisk the attitude by linear modified Rodrigues parameters. Errors are measured in the middle of each
interval, where that of an acceleration is largest, at two places nearer to its ends, where that of linear
components is, and at four instants of every piece of the trajectory within it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from jaxplan.exporting.flight import APART, Flight
from jaxplan.exporting.sampled import device_frames
from jaxplan.geometry import quaternion
from jaxplan.runtime.arguments import show
from jaxplan.tables.interpolation import linear_between, rodrigues_between, turned_between

MOST_SAMPLES = 10_000_000
"""Most samples of a file."""
LONGEST_STEP = 60.0
"""s: samples are no further apart, for readers who interpolate otherwise or draw."""
TOLERANCES_DEG = (1e-6, 1.0)
"""deg: least and greatest tolerance. Pieces of a trajectory may be 1e-8 rad apart where they meet."""
_TOLERANCE_SHARE = 0.85  # of the tolerance: what measured errors may reach, since larger ones may lie between
_INTERVALS_PER_WINDOW = 16  # of at most LONGEST_STEP, divided together; more would take more memory
_MOST_PARTS = 8  # into which an interval is divided at once, so that a slew in it does not refine a track
# Where in an interval errors are measured, such that no number of whole turns has zero error at all of them.
_PROBE_SHARES = np.array([0.2289, 0.5, 0.7873])
_PROBES_PER_INTERVAL = 15  # instants at which errors of a sparse table are measured, evenly spread
_GRID_PLACES = 16_384  # places between two boundaries at which a sparse table may have its rows
_TIME_DIGITS = 6  # decimals of a second to which chosen instants are rounded


def step_fault(step: object) -> str | None:
    """Return what is wrong with a step in seconds; None if nothing is."""
    if isinstance(step, bool) or not isinstance(step, int | float | np.integer | np.floating):
        return f"step_s = {show(step)}: must be a number of seconds, or 'sparsest'"
    if not APART <= step < np.inf:
        return f"step_s = {step}: must lie in [{APART:g}, inf)"
    return None


def tolerance_fault(tolerance: object) -> str | None:
    """Return what is wrong with a tolerance in degrees; None if nothing is."""
    least, most = TOLERANCES_DEG
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float | np.integer | np.floating):
        return f"tolerance_deg = {show(tolerance)}: must be a number of degrees"
    if not least <= tolerance <= most:
        return f"tolerance_deg = {tolerance}: must lie in [{least:g}, {most:g}]"
    return None


def steady_instants(boundaries: np.ndarray, step: float) -> np.ndarray:
    """Return times (k,) s: all boundaries, and the multiples of a step that are not close to one.

    Args:
        boundaries: (b,) s, rising from 0 to the duration.
        step: s.

    Raises:
        ValueError: if they would be more than `MOST_SAMPLES`.
    """
    duration = float(boundaries[-1])
    if not duration / step < MOST_SAMPLES:
        raise ValueError(
            f"step_s = {step:g}: must be more than {duration / MOST_SAMPLES:.3g} for a manoeuvre of "
            f"{duration:.2f} s, since a file holds at most {MOST_SAMPLES} samples"
        )
    grid = step * np.arange(int(duration / step) + 1)
    apart = max(1e-3 * min(step, duration), APART)
    after = np.searchsorted(boundaries, grid)
    near = np.minimum(
        np.abs(grid - boundaries[np.minimum(after, len(boundaries) - 1)]),
        np.abs(grid - boundaries[np.maximum(after - 1, 0)]),
    )
    return np.union1d(grid[(near >= apart) & (grid < duration)], boundaries)


def chosen_instants(flight: Flight, tolerance: float, *, rodrigues: bool = False) -> np.ndarray:
    """Return times (k,) s between which linear interpolation is off by less than a tolerance; see the module.

    Args:
        flight: the motion; all ends of its segments are among the times.
        tolerance: rad.
        rodrigues: whether to consider also the interpolation of attitudes in Basilisk.

    Raises:
        ValueError: if they would be more than `MOST_SAMPLES`.
    """
    boundaries = flight.boundaries
    starts = [
        np.linspace(begin, end, int(np.ceil((end - begin) / LONGEST_STEP)) + 1)[:-1]
        for begin, end in pairwise(boundaries)
    ]
    nodes = np.append(np.concatenate(starts), boundaries[-1])
    witnesses = _piece_instants(flight)
    limit = _TOLERANCE_SHARE * tolerance
    found: list[np.ndarray] = []
    for first in range(0, len(nodes) - 1, _INTERVALS_PER_WINDOW):
        window = nodes[first : first + _INTERVALS_PER_WINDOW + 1]
        inside = witnesses[slice(*np.searchsorted(witnesses, window[[0, -1]]))]
        found.append(_divide_intervals(_Readers(flight, rodrigues), window, inside, limit))
        if sum(map(len, found)) >= MOST_SAMPLES:
            raise ValueError(
                f"tolerance_deg = {np.rad2deg(tolerance):g}: must be larger for a motion of "
                f"{boundaries[-1]:.2f} s, since a file holds at most {MOST_SAMPLES} samples"
            )
    # ends of segments stay as they are
    tidy = np.round(np.concatenate(found), _TIME_DIGITS)
    after = np.minimum(np.searchsorted(boundaries, tidy), len(boundaries) - 1)
    near = np.minimum(np.abs(tidy - boundaries[after]), np.abs(tidy - boundaries[np.maximum(after - 1, 0)]))
    return np.union1d(tidy[near > APART], boundaries)


def sparsest_instants(flight: Flight, tolerance: float, *, rodrigues: bool = False) -> np.ndarray:
    """Return times (k,) s as `chosen_instants` does, but each as late as the one before it allows.

    Since errors grow with the length of an interval, fewer would not do, of those on a grid of `_GRID_PLACES`
    places between two boundaries. Each time takes a search, so this is for single manoeuvres. Arguments are
    those of `chosen_instants`.
    """
    boundaries, limit = flight.boundaries, _TOLERANCE_SHARE * tolerance
    readers, found = _Readers(flight, rodrigues), [boundaries[:1]]
    for begin, end in pairwise(boundaries):
        grid = np.linspace(begin, end, _GRID_PLACES + 1)
        attitudes, joints = readers.poses(grid)
        furthest = max(1, int(LONGEST_STEP / (grid[1] - grid[0])))

        def good(left: int, right: int, a: np.ndarray = attitudes, j: np.ndarray = joints) -> bool:
            own = np.unique(np.linspace(left, right, _PROBES_PER_INTERVAL + 2).astype(int)[1:-1])
            share = ((own - left) / (right - left))[:, None]
            return bool(
                np.all(
                    readers.off(a[[left]], a[[right]], j[[left]], j[[right]], share, a[own], j[own]) <= limit
                )
            )

        place, step = 0, 16
        while place < _GRID_PLACES:
            most = min(_GRID_PLACES - place, furthest)
            step = _longest_step(partial(good, place), place, min(step, most), most)
            place += step
            found.append(grid[[place]])
    return np.concatenate(found)


def _longest_step(good: Callable[[int], bool], place: int, guess: int, most: int) -> int:
    """Return the largest step, from 1 to `most`, that is good.

    Args:
        good: whether the step to a place is good; assumed true up to some place and false beyond.
        place: from where the step begins.
        guess: a first guess of the step.
        most: the largest step allowed.
    """
    low, high = 1, guess
    while high < most and good(place + high):
        low, high = high, min(2 * high, most)
    if high == most and good(place + most):
        return most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if good(place + middle) else (low, middle)
    return low


def _piece_instants(flight: Flight) -> np.ndarray:
    """Return four instants of each piece of the trajectory, s, rising; the first of each is its start."""
    breaks = np.union1d(flight.trajectory.breaks, flight.trajectory.joint_breaks)
    within = breaks[:-1, None] + np.diff(breaks)[:, None] * np.append(0.0, _PROBE_SHARES)
    return np.asarray(within.reshape(-1))


def _divide_intervals(
    readers: "_Readers", nodes: np.ndarray, witnesses: np.ndarray, limit: float
) -> np.ndarray:
    """Divide intervals until errors of interpolation are within a limit; return their starts (k,) s, rising.

    Args:
        readers: which compute the errors.
        nodes: (n + 1,) s, ends of the intervals to divide.
        witnesses: (w,) s, rising: instants at which errors are measured besides those within each interval.
        limit: rad.
    """
    left, right = nodes[:-1], nodes[1:]
    done = []
    while len(left):
        inner = left[:, None] + (right - left)[:, None] * _PROBE_SHARES
        owner = np.searchsorted(left, witnesses, side="right") - 1
        owned = (owner >= 0) & (witnesses < right[owner])
        witnesses, owner = witnesses[owned], owner[owned]
        times = np.concatenate([inner.reshape(-1), witnesses])
        owner = np.concatenate([np.repeat(np.arange(len(left)), len(_PROBE_SHARES)), owner])
        worst = np.zeros(len(left))
        np.maximum.at(worst, owner, readers.errors(left, right, owner, times))
        wrong = (worst > limit) & (right - left > 10 * APART)  # a jump between pieces cannot be divided
        done.append(left[~wrong])
        parts = np.clip(np.ceil(np.sqrt(worst[wrong] / limit)), 2, _MOST_PARTS).astype(int)
        place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        width = np.repeat((right - left)[wrong] / parts, parts)
        begin, last = np.repeat(left[wrong], parts), place == np.repeat(parts, parts) - 1
        end = np.where(last, np.repeat(right[wrong], parts), begin + (place + 1) * width)
        left, right = begin + place * width, end
    return np.sort(np.concatenate(done))


@dataclass(frozen=True)
class _Readers:
    """Errors of readers' interpolation between two instants of a flight.

    Attributes:
        flight: the motion.
        rodrigues: whether to consider also the interpolation of attitudes in Basilisk.
    """

    flight: Flight
    rodrigues: bool

    def errors(self, left: np.ndarray, right: np.ndarray, owner: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the largest errors (k,) rad at given times of interpolation between the ends of intervals.

        Args:
            left: (n,) s, starts of intervals.
            right: (n,) s, their ends.
            owner: (k,) int, the interval that each time is in.
            times: (k,) s.
        """
        share = ((times - left[owner]) / (right - left)[owner])[:, None]
        starts, start_joints = self.poses(left)
        ends, end_joints = self.poses(right)
        truth, joints = self.poses(times)
        return self.off(
            starts[owner], ends[owner], start_joints[owner], end_joints[owner], share, truth, joints
        )

    def off(
        self,
        begin: np.ndarray,
        end: np.ndarray,
        begin_joints: np.ndarray,
        end_joints: np.ndarray,
        share: np.ndarray,
        truth: np.ndarray,
        joints: np.ndarray,
    ) -> np.ndarray:
        """Return the largest errors (k,) rad of interpolation between poses of body, g devices and J joints.

        Args:
            begin: (k, 1 + g, 4) quaternions at the starts of intervals.
            end: (k, 1 + g, 4) quaternions at their ends.
            begin_joints: (k, J) rad at the starts.
            end_joints: (k, J) rad at the ends.
            share: (k, 1) places in the intervals, from 0 to 1.
            truth: (k, 1 + g, 4) true quaternions there.
            joints: (k, J) rad, true joints there.
        """
        end = np.where(np.sum(begin * end, axis=-1, keepdims=True) < 0, -end, end)
        guesses = [(rule(begin, end, share[..., None]), truth) for rule in (turned_between, linear_between)]
        if self.rodrigues:
            guesses.append((rodrigues_between(begin[:, 0], end[:, 0], share), truth[:, 0]))
        off = [_angles_between(guess, true).reshape(len(share), -1).max(axis=1) for guess, true in guesses]
        if joints.shape[1]:
            linear = begin_joints + share * (end_joints - begin_joints)
            off.append(np.abs(linear - joints).max(axis=1))
        return np.asarray(np.max(off, axis=0))

    def poses(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return poses at times (k,) s: quaternions (k, 1 + g, 4) of body and devices, joints (k, J) rad."""
        values, craft = self.flight.trajectory.sample(times), self.flight.spacecraft
        devices = [device_frames(craft, values.joints, number) for number in range(craft.gimbals.count)]
        return np.asarray(
            quaternion.from_matrix(np.stack([values.attitude, *devices], axis=1))
        ), values.joints


def _angles_between(guess: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return angles (...) rad between attitudes given by unit quaternions (..., 4) of any sign."""
    apart = np.minimum(np.linalg.norm(guess - truth, axis=-1), np.linalg.norm(guess + truth, axis=-1))
    return np.asarray(4 * np.arcsin(np.clip(apart / 2, 0, 1)))
