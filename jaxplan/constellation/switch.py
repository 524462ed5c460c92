"""The planning problems of a switch: a shell changes its links once, which is a problem for each satellite.

At the start a satellite's terminals point along its links before the switch, in the attitude nearest to the
nominal one that allows it; the goal is the links after the switch. No terminal may look into the Sun's
keep-out cone nor into the Earth's. The Earth's cone is about nadir. It covers the Earth with the air below
`lowest_altitude`, which at orbit radius r takes a half angle of ``asin((R + lowest_altitude) / r)``, R being
the Earth's radius; and it is wider by the angle that nadir moves within `drift_time`.

Lines of sight and zones are those of one instant, kept fixed in the inertial frame. Over a manoeuvre they
turn at the satellite's mean motion, 0.06 deg/s at 550 km: the Earth's cone is wider for that, and terminals
follow their links once they point at them.

A satellite's local frame has x ahead, in the direction of flight, y to the left and z up, away from the
Earth. The attitude that has the body's axes there is the nominal one.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxplan import so3
from jaxplan.constellation.links import WHEN, Surroundings, checked_topology, default_topologies
from jaxplan.constellation.shell import Shell, out_of_range
from jaxplan.goal import decompose
from jaxplan.goal.multistart import nearest_attitudes
from jaxplan.model.devices import Terminal
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.arguments import as_floats, expect, several
from jaxplan.runtime.display import shown
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import checked_spacecraft
from jaxplan.sky.frames import EARTH_RADIUS

_SIDE_MOUNTS = {3: (("cross", 90.0),), 4: (("right", -90.0), ("left", 90.0))}  # deg about z, from x ahead


def relay_spacecraft(terminals: int = 3) -> Spacecraft:
    """Make a relay satellite with a terminal to the front, one to the back, and one or two to its sides.

    Each terminal turns by 80 deg to either side and by 30 deg up and down, at up to 6 deg/s and 4 deg/s^2.
    The platform turns at up to 1 deg/s and 0.5 deg/s^2.

    Args:
        terminals: 3 for "fore", "aft" and "cross", the latter to the left; 4 for "fore", "aft", "right" and
            "left".

    Raises:
        ValueError: for another number.
    """
    if terminals not in _SIDE_MOUNTS:
        raise ValueError(f"terminals = {terminals!r}: must be 3 or 4")
    mounts = (("fore", 0.0), ("aft", 180.0), *_SIDE_MOUNTS[terminals])
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=name,
                mount=math.radians(mount),
                yaw_limit=math.radians(80.0),
                pitch_limit=math.radians(30.0),
                rate_limit=math.radians(6.0),
                acceleration_limit=math.radians(4.0),
            )
            for name, mount in mounts
        ),
        rate_limit=math.radians(1.0),
        acceleration_limit=math.radians(0.5),
    )


def nominal_attitudes(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Compute the attitudes with the body's x axis ahead and its z axis up, away from the Earth.

    Args:
        positions: (N, 3) inertial, any unit.
        velocities: (N, 3) inertial, on circular orbits, any unit.

    Returns:
        (N, 3, 3) rotation matrices, body to inertial.
    """
    up = positions / np.linalg.norm(positions, axis=-1, keepdims=True)
    ahead = velocities / np.linalg.norm(velocities, axis=-1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=-1)


@shown(
    "time s",
    "sun_outage",
    "sun_direction",
    "sun_half_angle deg",
    "earth_half_angle deg",
    "drift_time s",
    heading="Switch of the {0.title}",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class LinkSwitch(Surroundings):
    """A planning problem for each of T satellites with n terminals; `link_switch` makes it.

    It has the attributes of `Surroundings`, and these:

    Attributes:
        spacecraft: the devices and limits that all satellites have.
        before: (T, n) int, the satellite that each terminal is linked to before the switch.
        after: (T, n) int, the same after the switch.
        directions: (2, T, n, 3) inertial unit vectors in which terminals point before and after: along their
            links, but for those that wait outside the Sun's cone.
        sun_outage: (2, T, n) bool, which links before and after lead through the Sun's cone, or within
            `CLEARANCE` of it.
        attitudes: (T, 3, 3) rotation matrices at the start, body to inertial.
        joints: (T, 2n + d) rad at the start: all terminals' yaws, all pitches, and the angles of the d
            drives, which are zero, or the nearest angle in range.
    """

    spacecraft: Spacecraft
    before: np.ndarray
    after: np.ndarray
    directions: np.ndarray
    sun_outage: np.ndarray
    attitudes: np.ndarray
    joints: np.ndarray

    @property
    def title(self) -> str:
        """Title: the shell and the number of terminals."""
        return f"links of {self.shell.name}, {len(self.spacecraft.terminals)} terminals a satellite"

    def scenarios(self, satellites: Iterable[int] | None = None) -> list[Scenario]:
        """Make the planning problems, a scenario at rest at both ends for each satellite.

        Args:
            satellites: numbers of the satellites; None for all.

        Returns:
            The scenarios, in the order of `satellites`.

        Raises:
            ScenarioError: if there is no such satellite, or one is given twice.
        """
        chosen = self.chosen(satellites)
        vectors = so3.log(self.attitudes)
        names = tuple(terminal.name for terminal in self.spacecraft.terminals)
        still: dict[str, Any] = {
            "angular_velocity": np.zeros(3),
            "joint_rates": np.zeros(self.spacecraft.joint_count),
        }
        zone = partial(KeepOut, devices=names)
        down = self.shell.nadir(self.time)
        sun: list[KeepOut] = []
        if self.sun_direction is not None:
            sun = [zone(name="Sun", direction=self.sun_direction, half_angle=self.sun_half_angle)]
        return [
            Scenario(
                name=f"satellite {number}",
                spacecraft=self.spacecraft,
                start=GivenState(rotation_vector=vectors[number], joints=self.joints[number], **still),
                goal=Targets(directions=self.directions[1, number], **still),
                keep_out=(
                    *sun,
                    zone(name="Earth", direction=down[number], half_angle=self.earth_half_angle),
                ),
            )
            for number in chosen
        ]

    def scenario(self, satellite: int) -> Scenario:
        """Make the planning problem of one satellite, to be planned by itself.

        Raises:
            ScenarioError: if there is no such satellite.
        """
        return self.scenarios([satellite])[0]

    def chosen(self, satellites: Iterable[int] | None) -> list[int]:
        """Check satellite numbers and return them, or all for None; see `chosen_satellites`."""
        return chosen_satellites(self.shell, satellites)


def chosen_satellites(shell: Shell, satellites: Iterable[int] | None) -> list[int]:
    """Check the satellite numbers that a caller gives, and return them as a list; None stands for all.

    Raises:
        ScenarioError: if a number is no satellite's, one is given twice, or none is given.
    """
    if satellites is None:
        return list(range(shell.total))
    numbers = list(several("satellites", satellites, "numbers of satellites"))
    total = shell.total
    faults = []
    for place, number in enumerate(numbers):
        whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
        if not whole or not 0 <= number < total:
            faults.append(f"satellites[{place}] = {number!r}: must be an integer in [0, {total - 1}]")
    if not numbers:
        faults.append("satellites is empty: there is nothing to plan")
    elif not faults and len(set(numbers)) < len(numbers):
        faults.append("satellites: each may come once")
    if faults:
        raise ScenarioError(faults, "the satellites")
    return [int(number) for number in numbers]


SUN_OUTAGES = ("wait", "keep")


def link_switch(
    shell: Shell,
    *,
    spacecraft: Spacecraft | None = None,
    before: ArrayLike | None = None,
    after: ArrayLike | None = None,
    sun_direction: ArrayLike | None = None,
    sun_half_angle: float = math.radians(10.0),
    sun_outage: str = "wait",
    lowest_altitude: float = 80.0,
    drift_time: float = 90.0,
    time: float = 0.0,
) -> LinkSwitch:
    """Make the planning problems of a switch of a shell's topology, one for each satellite.

    Args:
        shell: the T satellites, from `walker`.
        spacecraft: what each of them is; None for `relay_spacecraft`, a platform with three terminals.
        before: (T, n) int, the satellite that each terminal is linked to; None for the default, see
            `default_topologies`: the two neighbours in the plane, and one or two in the planes beside.
        after: (T, n) int, the same after the switch; None for the default: the terminals in the plane keep
            their links, the others change to the other side or to the next nearest satellite.
        sun_direction: (3,) inertial unit vector toward the Sun; None for no keep-out cone of the Sun.
        sun_half_angle: rad, of the Sun's keep-out cone for all terminals, in [1e-6, 1.5].
        sun_outage: what becomes of links that lead through the Sun's cone, or within 1 deg of it. "wait":
            they are out, and their terminals wait 1 deg outside the cone, as close to the link as possible.
            "keep": they are required like others, so that planning ends with INVALID_START or INVALID_GOAL.
        lowest_altitude: km, in [0, 1000], below which no point of a link may lie; the Earth's keep-out cone
            covers what is below it.
        drift_time: s, in [0, 3600]: the Earth's cone is wider by the angle that nadir moves in this time. The
            summary of plans says how many manoeuvres take longer.
        time: s, when the switch is.

    Returns:
        The switch, with the state found at which each satellite starts.

    Raises:
        ScenarioError: (a ValueError) for values out of range, for links through the Earth, its air or its
            cone, which are named, and for a satellite whose terminals cannot point at all its links at once.

    Example:
        >>> shell = jp.walker("53:1584/72/39", 550.0)
        >>> switch = jp.link_switch(shell, sun_direction=[0.0, 0.9174771, 0.3977885])
        >>> plan = jp.plan(switch.scenario(17))
    """
    expect("shell", shell, Shell, 'jp.walker makes one, such as jp.walker("53:1584/72/39", 550.0)')
    craft = relay_spacecraft() if spacecraft is None else checked_spacecraft(spacecraft)
    around = _make_surroundings(
        shell, sun_direction, sun_half_angle, sun_outage, lowest_altitude, drift_time, time
    )
    topologies = _check_topologies(shell, len(craft.terminals), before, after)
    names = [terminal.name for terminal in craft.terminals]
    links: list[np.ndarray] = []
    faults: list[str] = []
    for when, topology in zip(WHEN, topologies, strict=True):
        seen, wrong = around.links(topology, when, names)
        links.append(seen)
        faults += wrong
    if faults:
        raise ScenarioError(faults, f"the shell {shell.name}")
    directions = np.stack(links)
    out = around.in_the_sun(directions)
    if sun_outage == "wait":
        directions[out] = around.waiting(directions, out)
    attitudes, joints = _find_starts(craft, nominal_attitudes(*shell.states(time)), directions[0])
    return LinkSwitch(
        **vars(around),
        spacecraft=craft,
        before=topologies[0],
        after=topologies[1],
        directions=directions,
        sun_outage=out,
        attitudes=attitudes,
        joints=joints,
    )


def _make_surroundings(
    shell: Shell,
    sun_direction: ArrayLike | None,
    sun_half_angle: float,
    sun_outage: str,
    lowest_altitude: float,
    drift_time: float,
    time: float,
) -> Surroundings:
    """Check the arguments of `link_switch` of the same names, and make the `Surroundings` of them.

    Raises:
        ScenarioError: for values out of range.
    """
    faults = [
        *out_of_range("sun_half_angle", sun_half_angle, "rad", 1e-6, 1.5),
        *out_of_range("lowest_altitude", lowest_altitude, "km", 0.0, 1000.0),
        *out_of_range("drift_time", drift_time, "s", 0.0, 3600.0),
        *out_of_range("time", time, "s", -1e9, 1e9),
    ]
    sun = None if sun_direction is None else as_floats(sun_direction)
    if sun_direction is not None and not (
        sun is not None and sun.shape == (3,) and abs(np.linalg.norm(sun) - 1) <= 1e-3
    ):
        given = f" = {sun.tolist()}" if sun is not None and sun.size else ""
        faults.append(f"sun_direction{given}: must be a unit vector (3,) of numbers, to 1e-3")
    if sun_outage not in SUN_OUTAGES:
        faults.append(f"sun_outage = {sun_outage!r}: must be {' or '.join(map(repr, SUN_OUTAGES))}")
    if not faults and lowest_altitude >= shell.altitude:
        faults.append(
            f"lowest_altitude = {lowest_altitude:g}: must be below the shell's, {shell.altitude:g} km"
        )
    if faults:
        raise ScenarioError(faults, "the switch")
    limb = math.asin((EARTH_RADIUS + lowest_altitude) / shell.radius)
    return Surroundings(
        shell=shell,
        time=float(time),
        sun_direction=None if sun is None else sun / np.linalg.norm(sun),
        sun_half_angle=float(sun_half_angle),
        lowest_altitude=float(lowest_altitude),
        earth_half_angle=limb + shell.mean_motion * drift_time,
        drift_time=float(drift_time),
    )


def _check_topologies(
    shell: Shell, terminals: int, before: ArrayLike | None, after: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the topologies (T, n) before and after, checked; the default is used for one that is None."""
    default = default_topologies(shell, terminals) if before is None or after is None else None
    given = [
        default[place] if value is None and default else checked_topology(value, when, shell, terminals)
        for place, (value, when) in enumerate(zip((before, after), WHEN, strict=True))
    ]
    return given[0], given[1]


def _find_starts(
    craft: Spacecraft, nominal: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the satellites' states at the start: terminals along their links, attitudes near the nominal ones.

    Args:
        craft: the spacecraft, the same for all.
        nominal: (T, 3, 3) nominal attitudes, body to inertial.
        directions: (T, n, 3) inertial unit vectors in which terminals point before the switch.

    Returns:
        Attitudes (T, 3, 3), body to inertial, and joints (T, 2n + d) in rad, those of the d drives at zero or
        the nearest angle in range.

    Raises:
        ScenarioError: if a satellite has no such state.
    """
    attitudes, joints, found = nearest_attitudes(craft, nominal, directions)
    still: dict[str, Any] = {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(craft.joint_count)}
    nowhere = tabulate((), (), craft)
    for number in np.flatnonzero(~found):
        targets = Targets(directions=directions[number], **still)
        answer = decompose(craft, nominal[number], targets, nowhere, max_goals=1)
        if not answer.goals:
            # it is None only without terminals, when there is always a goal
            assert answer.worst_aim is not None
            terminal, angle = answer.worst_aim
            fault = (
                f"satellite {number}: no attitude lets its terminals point along its links before "
                f"the switch; at best {craft.terminals[terminal].name} {('yaw', 'pitch')[angle]} is "
                f"{np.rad2deg(answer.aim_excess):.3g} deg beyond its limit"
            )
            raise ScenarioError([fault], "the starts")
        attitudes[number], joints[number] = answer.goals[0].attitude, answer.goals[0].joints
    return attitudes, joints
