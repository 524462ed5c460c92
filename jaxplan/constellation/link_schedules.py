"""Schedules of links: which satellite each terminal of a shell points at, step by step over hours or a day.

Time is divided into steps, during each of which a satellite's links stay as they are. They follow from the
mesh of the shell (`Mesh`), or the caller gives them. A link is *out* for a whole step if at some time in it
its direction, seen from either end, is inside the keep-out cone of Sun, Moon or Earth, or outside by less
than `CLEARANCE`. This is checked at instants at most 10 s apart, between which directions in low orbit turn
by less than `CLEARANCE`.

Orbits have the elements of `jaxplan.sky.CircularOrbit`, about the axes of the Geocentric Celestial Reference
System. Sun and Moon move as time goes on. Times are seconds after the epoch.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.constellation.links import CLEARANCE, LEFT, NOBODY, RIGHT, SIDES, Mesh, crossing_latitude
from jaxplan.constellation.shell import Shell, out_of_range
from jaxplan.constellation.switch import chosen_satellites, relay_spacecraft
from jaxplan.model.epochs import parse_epoch
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import checked_spacecraft
from jaxplan.sky.frames import EARTH_RADIUS

LONGEST = 86400.0  # s, longest duration of a schedule
_MAX_CHECK_INTERVAL = 10.0  # s, longest time between the instants at which links are checked
_MAX_STEPS = 100_000
_CROSSING_MARGIN = math.radians(5.0)  # rad by which links between planes end below the crossing latitude
_ERROR_SOURCE = "the schedule"

Topology = Callable[[float], Any] | tuple[Any, Any]
"""Whom terminals are for: a function of a time, s, to (T, n); or times (K,) s and an array (K, T, n)."""


@shown()
@dataclass(frozen=True, kw_only=True)
class Span:
    """A time over which a satellite's links stay as they are.

    Attributes:
        start: s.
        end: s.
        links: for each terminal the number of the satellite that it points at, `NOBODY` (-1) for none.
    """

    start: float
    end: float
    links: tuple[int, ...]

    @property
    def name(self) -> str:
        """Name of the activity that follows these links."""
        return f"links from {self.start:g} s"


@shown("spacecraft", "epoch", "until s", "changes", "outages", heading="Schedule of links of {0.shell.name}")
@dataclass(frozen=True, kw_only=True, eq=False)
class LinkSchedule:
    """The links of T satellites with n terminals over K time steps; `link_schedule` makes it.

    Attributes:
        shell: the satellites; its time zero is the epoch.
        spacecraft: the devices and limits that all satellites have.
        epoch: UTC of time zero.
        times: (K,) s, starts of the steps; the first is zero.
        until: s, end of the last step.
        topology: (K, T, n) int, the satellite that each terminal points at; -1 for none, or where a link is
            out.
        cones: half angle in rad of each body's keep-out cone, by the body's name ("sun", "moon", "earth").
        outages: seconds for which links are out because of each body, summed over all terminals, by its name.
    """

    shell: Shell
    spacecraft: Spacecraft
    epoch: np.datetime64
    times: np.ndarray
    until: float
    topology: np.ndarray
    cones: Mapping[str, float]
    outages: Mapping[str, float]

    @property
    def ends(self) -> np.ndarray:
        """Ends (K,) of the steps, s."""
        return np.append(self.times[1:], self.until)

    @property
    def changes(self) -> int:
        """How often a satellite's links change from one step to the next, summed over all satellites."""
        return int(np.sum(np.any(self.topology[1:] != self.topology[:-1], axis=2)))

    def spans(self, satellite: int) -> list[Span]:
        """Return the times between changes of a satellite's links, in order and without gaps.

        Raises:
            ScenarioError: if there is no such satellite.
        """
        (number,) = self.chosen([satellite])
        own = self.topology[:, number]
        first = np.flatnonzero(np.append(True, np.any(own[1:] != own[:-1], axis=1)))
        edges = [*self.times[first].tolist(), self.until]
        return [
            Span(start=start, end=end, links=tuple(own[step].tolist()))
            for step, start, end in zip(first, edges[:-1], edges[1:], strict=True)
        ]

    def chosen(self, satellites: Iterable[int] | None) -> list[int]:
        """Check satellite numbers and return them, or all for None; see `chosen_satellites`."""
        return chosen_satellites(self.shell, satellites)


def link_schedule(
    shell: Shell,
    *,
    epoch: str | np.datetime64,
    duration_s: float,
    step_s: float = 60.0,
    spacecraft: Spacecraft | None = None,
    sides: Sequence[str] | None = None,
    topology: Topology | None = None,
    highest_latitude: float | None = None,
    hysteresis: float = 0.1,
    sun_half_angle: float | None = math.radians(10.0),
    moon_half_angle: float | None = None,
    lowest_altitude: float = 80.0,
) -> LinkSchedule:
    """Make the schedule of a shell's links over hours or a day.

    Args:
        shell: the satellites, from `walker`; its time zero is the epoch.
        epoch: UTC of the start.
        duration_s: s, in [1, 86400].
        step_s: s over which links stay as they are, in [1, 86400]; each slew must be done within one step.
        spacecraft: what each satellite is; None for `relay_spacecraft` with four terminals.
        sides: the side that each terminal serves, of "fore", "aft", "right" and "left". Each side comes at
            most once, and right and left come together. None for the first two of these with two terminals,
            and for all four with four. Not used where `topology` is given.
        topology: links that replace those to neighbours: a function of a time in s, called at the start of
            each step, that returns integers (T, n), the number of a satellite for each terminal and -1 for
            none; or a pair of times (K,) in s, rising from zero, and integers (K, T, n). None for the links
            of `links.Mesh`.
        highest_latitude: rad, in (0, pi / 2], beyond which there are no links to other planes; None for 5 deg
            below where planes cross.
        hysteresis: fraction, in [0, 0.9], by which another satellite must be nearer for a link to change to
            it.
        sun_half_angle: rad, of the Sun's keep-out cone for all terminals, in [1e-6, 1.5]; None for no such
            cone.
        moon_half_angle: likewise of the Moon's.
        lowest_altitude: km, in [0, 1000]: the Earth's keep-out cone just covers a sphere up to this altitude.

    Returns:
        The schedule; links that are out are removed from it.

    Raises:
        ScenarioError: (a ValueError) for values out of range, and for a topology of another shape or type, or
            with numbers that no satellite has.
        ImportError: without the extra ``orbit``, which computes where Sun and Moon are.

    Example:
        >>> shell = jp.walker("53:1584/72/39", 550.0)
        >>> schedule = jp.link_schedule(shell, epoch="2026-06-20T09:30:00", duration_s=shell.period)
        >>> jp.plan_fleet(schedule, "fleet", workers=2)
    """
    expect("shell", shell, Shell, 'jp.walker makes one, such as jp.walker("53:1584/72/39", 550.0)')
    craft = relay_spacecraft(4) if spacecraft is None else checked_spacecraft(spacecraft)
    half_angles = {"sun": sun_half_angle, "moon": moon_half_angle}
    faults = [
        *out_of_range("duration_s", duration_s, "s", 1.0, LONGEST),
        *out_of_range("step_s", step_s, "s", 1.0, LONGEST),
        *out_of_range("hysteresis", hysteresis, "", 0.0, 0.9),
        *out_of_range("lowest_altitude", lowest_altitude, "km", 0.0, 1000.0),
    ]
    if highest_latitude is not None:
        faults += out_of_range("highest_latitude", highest_latitude, "rad", 1e-6, math.pi / 2)
    for body, half_angle in half_angles.items():
        if half_angle is not None:
            faults += out_of_range(f"{body}_half_angle", half_angle, "rad", 1e-6, 1.5)
    if not faults and lowest_altitude >= shell.altitude:
        faults.append(
            f"lowest_altitude = {lowest_altitude:g}: must be below the shell's, {shell.altitude:g} km"
        )
    start = parse_epoch(epoch)
    known = _check_sides(craft, sides) if topology is None else ()
    if isinstance(known, str):
        faults.append(known)
    if faults:
        raise ScenarioError(faults, _ERROR_SOURCE)
    times = np.arange(0.0, float(duration_s), float(step_s))
    if topology is None:
        crossing = max(crossing_latitude(shell) - _CROSSING_MARGIN, 0.0)
        highest = crossing if highest_latitude is None else float(highest_latitude)
        mesh = Mesh(shell=shell, sides=tuple(known), highest_latitude=highest, hysteresis=float(hysteresis))
        kind = _number_type(shell)
        tables = np.stack([mesh.at(time).astype(kind) for time in times.tolist()])
    else:
        times, tables = _check_topology(topology, times, float(duration_s), shell, len(craft.terminals))
    limb = math.asin((EARTH_RADIUS + lowest_altitude) / shell.radius)
    cones = {body: float(angle) for body, angle in half_angles.items() if angle is not None}
    cones["earth"] = limb
    ends = np.append(times[1:], float(duration_s))
    clear, outages = _remove_outages(tables, times, ends, shell, start, cones)
    return LinkSchedule(
        shell=shell,
        spacecraft=craft,
        epoch=start,
        times=times,
        until=float(duration_s),
        topology=clear.astype(_number_type(shell), copy=False),
        cones=cones,
        outages=outages,
    )


def _number_type(shell: Shell) -> np.dtype[Any]:
    """The smallest integer type that holds all satellite numbers, and `NOBODY`."""
    return np.min_scalar_type(-shell.total)


def _check_sides(craft: Spacecraft, sides: Sequence[str] | None) -> tuple[str, ...] | str:
    """Check the sides that the terminals serve; None stands for the usual ones.

    Returns:
        A tuple with one side for each terminal, or else a message that says what is wrong.
    """
    count = len(craft.terminals)
    if count > len(SIDES):
        return f"the spacecraft has {count} terminals, and there are only {len(SIDES)} sides: give a topology"
    if sides is None:
        if count in (2, 4):
            return SIDES[:count]
        return f"the spacecraft has {count} terminals: with other than 2 or 4, give sides, or a topology"
    given: object = sides  # it may be anything at run time
    if not isinstance(given, Sequence) or isinstance(given, str) or not set(given) <= set(SIDES):
        return f"sides = {sides!r}: must be names of {', '.join(SIDES)}"
    if len(sides) != count or len(set(sides)) < count:
        return f"sides = {tuple(sides)!r}: must be as many as terminals, {count}, and each may come once"
    if (RIGHT in sides) != (LEFT in sides):
        return (
            f"sides = {tuple(sides)!r}: a link from {RIGHT} leads to another's {LEFT}, so give both or none"
        )
    return tuple(sides)


def _check_topology(
    topology: Topology, steps: np.ndarray, until: float, shell: Shell, terminals: int
) -> tuple[np.ndarray, np.ndarray]:
    """Check a topology that the caller gives, and turn it into arrays.

    Args:
        topology: a function of time, or a pair of times and links.
        steps: s, starts of the steps at which a function is called; not used for a pair.
        until: s, end of the schedule, before which all times must be.
        shell: the T satellites.
        terminals: number of each satellite's terminals, n.

    Returns:
        Starts (K,) of the steps in s, and links (K, T, n).

    Raises:
        ScenarioError: for another shape or type, a number that no satellite has, or a link to oneself.
    """
    if callable(topology):
        times, tables = steps, [topology(time) for time in steps.tolist()]
    else:
        given: object = topology  # it may be anything at run time
        if not isinstance(given, tuple | list) or len(given) != 2:
            kind = type(given).__name__
            fault = f"topology must be a function of a time, or a pair (times, links), not a {kind}"
            raise ScenarioError([fault], _ERROR_SOURCE)
        times, tables = _check_times(given[0], until), given[1]
    wanted = (len(times), shell.total, terminals)
    try:
        links = np.asarray(tables)
    except ValueError:  # rows of different lengths
        links = np.zeros(0)
    if links.shape != wanted or not np.issubdtype(links.dtype, np.integer):
        fault = f"topology has links of shape {links.shape} and type {links.dtype}: must be integers {wanted}"
        raise ScenarioError([fault], _ERROR_SOURCE)
    itself = links == np.arange(shell.total)[:, None]
    wrong = np.argwhere((links < NOBODY) | (links >= shell.total) | itself)
    if len(wrong):
        step, row, column = wrong[0].tolist()
        place = f"topology[{step}, {row}, {column}] = {links[step, row, column]}"
        why = f"must lie in [-1, {shell.total - 1}]"
        if itself[step, row, column]:
            why = "is the satellite itself"
        raise ScenarioError([f"{place}: {why}"], _ERROR_SOURCE)
    return times, links


def _check_times(value: object, until: float) -> np.ndarray:
    """Check the starts of steps that the caller gives, and return them as an array (K,) in s.

    Raises:
        ScenarioError: unless they rise from 0 to below `until` (s), and are at most 100 000.
    """
    try:
        times = np.asarray(value, float)
    except (TypeError, ValueError):
        times = np.zeros(0)
    right = times.ndim == 1 and len(times) > 0 and times[0] == 0 and times[-1] < until
    if not right or not np.all(np.diff(times) > 0) or len(times) > _MAX_STEPS:
        fault = f"topology has times that do not rise from 0 to below {until:g} s, one for each step"
        raise ScenarioError([fault], _ERROR_SOURCE)
    return times


def _remove_outages(
    tables: np.ndarray,
    times: np.ndarray,
    ends: np.ndarray,
    shell: Shell,
    epoch: np.datetime64,
    cones: Mapping[str, float],
) -> tuple[np.ndarray, dict[str, float]]:
    """Remove the links that are out, and count for how long they are.

    Args:
        tables: (K, T, n) links; not changed.
        times: (K,) s, starts of the steps.
        ends: (K,) s, their ends.
        shell: the satellites.
        epoch: UTC of time zero.
        cones: half angle in rad of each body's keep-out cone, by its name.

    Returns:
        The links (K, T, n) with `NOBODY` where they are out; and for each body the seconds for which links
        are out because of it, summed over terminals. A link that several bodies block counts for each of
        them.
    """
    found = tables.copy()
    outages = dict.fromkeys(cones, 0.0)
    for step, (start, end) in enumerate(zip(times.tolist(), ends.tolist(), strict=True)):
        instants = np.linspace(start, end, math.ceil((end - start) / _MAX_CHECK_INTERVAL) + 1)
        satellite, terminal = np.nonzero(tables[step] >= 0)
        ends_of = np.sort([satellite, tables[step][satellite, terminal]], axis=0)
        keys, pair = np.unique(ends_of[0] * shell.total + ends_of[1], return_inverse=True)
        places = np.stack([shell.positions(time) for time in instants.tolist()])  # (m, T, 3)
        here, there = (places[:, each] for each in np.divmod(keys, shell.total))
        way = there - here
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        for body, half_angle in cones.items():
            centre = sky.positions(body, epoch=epoch, times=instants)[:, None]
            most = math.cos(half_angle + CLEARANCE)
            inside = np.zeros(len(keys), bool)
            for own, sign in ((here, 1.0), (there, -1.0)):
                toward = centre - own
                along = np.einsum("mkc,mkc->mk", way, toward)
                inside |= np.any(sign * along > most * np.linalg.norm(toward, axis=-1), axis=0)
            blocked = inside[pair]
            found[step, satellite[blocked], terminal[blocked]] = NOBODY
            outages[body] += float(np.sum(blocked)) * (end - start)
    return found, outages
