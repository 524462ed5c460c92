"""The planning problems of a switch of a shell's topology, one a satellite, and what its satellites are.

At the start a satellite's terminals point along its links before the switch; the goal is the links after it.
Where a satellite looks is said in its local frame: x ahead, in the direction of flight, y to the left, z up.
An attitude that has the body's axes there is the nominal one.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.constellation.links import Surroundings
from jaxplan.model.scenario import GivenState, Scenario, Targets
from jaxplan.model.spacecraft import Spacecraft, Terminal
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.arguments import several
from jaxplan.runtime.display import shown
from jaxplan.schema import ScenarioError


def relay_spacecraft() -> Spacecraft:
    """A platform with a terminal to the front, one to the back, and one to its left side for cross links.

    Each turns by 80 deg to either side and by 30 deg up and down, at up to 6 deg/s and 4 deg/s^2. The
    platform turns at up to 1 deg/s and 0.5 deg/s^2.
    """
    terminals = (("fore", 0.0), ("aft", 180.0), ("cross", 90.0))
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
            for name, mount in terminals
        ),
        rate_limit=math.radians(1.0),
        acceleration_limit=math.radians(0.5),
    )


def nominal_attitudes(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Attitudes with the body's x axis ahead and its z axis up.

    Args:
        positions: (N, 3) inertial.
        velocities: (N, 3) of circular orbits.

    Returns:
        (N, 3, 3) body to inertial.
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

    Attributes, beside those of `Surroundings`:
        spacecraft: of which kind they all are.
        before: (T, n) int, the satellite that each terminal is linked to.
        after: (T, n) int, the same after the switch.
        directions: (2, T, n, 3) unit vectors, inertial: where terminals point before and after. That is along
            the links, but for terminals that wait.
        sun_outage: (2, T, n) bool, which links lead through the Sun's cone before and after.
        attitudes: (T, 3, 3) body to inertial, at the start.
        joints: (T, 2n) rad, at the start.
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
        """Title with the shell and the number of terminals."""
        return f"links of {self.shell.name}, {len(self.spacecraft.terminals)} terminals a satellite"

    def scenarios(self, satellites: Iterable[int] | None = None) -> list[Scenario]:
        """The planning problems.

        Args:
            satellites: numbers of those that are wanted; None for all.

        Raises:
            ScenarioError: if there is no such satellite, or one comes twice.
        """
        chosen = self.chosen(satellites)
        vectors = so3.log(self.attitudes)
        names = tuple(terminal.name for terminal in self.spacecraft.terminals)
        still: dict[str, Any] = {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(2 * len(names))}
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
        """The planning problem of one satellite, to be planned by itself.

        Raises:
            ScenarioError: if there is no such satellite.
        """
        return self.scenarios([satellite])[0]

    def chosen(self, satellites: Iterable[int] | None) -> list[int]:
        """Numbers of satellites, checked; all of them for None."""
        if satellites is None:
            return list(range(self.shell.total))
        numbers = list(several("satellites", satellites, "numbers of satellites"))
        total = self.shell.total
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
