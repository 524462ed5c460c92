"""The planning problems of a switch of a shell's topology, one a satellite.

At the start a satellite's terminals point along its links before the switch; the goal is the links after it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.constellation.shell import Shell
from jaxplan.model.scenario import GivenState, Scenario, Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.arguments import several
from jaxplan.runtime.display import shown
from jaxplan.schema import ScenarioError


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
class LinkSwitch:
    """A planning problem for each of T satellites with n terminals; `link_switch` makes it.

    Attributes:
        shell: the satellites.
        spacecraft: of which kind they all are.
        time: s, of the positions.
        before: (T, n) int, the satellite that each terminal is linked to.
        after: (T, n) int, likewise after the switch.
        directions: (2, T, n, 3) unit vectors, inertial: where terminals point before and after. That is along
            the links, but for terminals that wait.
        sun_outage: (2, T, n) bool, which links lead through the Sun's cone before and after.
        sun_direction: (3,) unit vector, inertial; None where no Sun is kept out.
        sun_half_angle: rad, of its cone.
        earth_half_angle: rad, of the cone about nadir, wide enough for `drift_time`.
        drift_time: s, that a manoeuvre may take before nadir has moved by more than its cone is wider.
        attitudes: (T, 3, 3) body to inertial, at the start.
        joints: (T, 2n) rad, at the start.
    """

    shell: Shell
    spacecraft: Spacecraft
    time: float
    before: np.ndarray
    after: np.ndarray
    directions: np.ndarray
    sun_outage: np.ndarray
    sun_direction: np.ndarray | None
    sun_half_angle: float
    earth_half_angle: float
    drift_time: float
    attitudes: np.ndarray
    joints: np.ndarray

    @property
    def title(self) -> str:
        """Of which shell, and how many terminals a satellite has."""
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
        positions = self.shell.positions(self.time)
        down = -positions / np.linalg.norm(positions, axis=-1, keepdims=True)
        sun: tuple[KeepOut, ...] = ()
        if self.sun_direction is not None:
            direction, half_angle = self.sun_direction, self.sun_half_angle
            sun = (KeepOut(name="Sun", direction=direction, half_angle=half_angle, devices=names),)
        return [
            Scenario(
                name=f"satellite {number}",
                spacecraft=self.spacecraft,
                start=GivenState(rotation_vector=vectors[number], joints=self.joints[number], **still),
                goal=Targets(directions=self.directions[1, number], **still),
                keep_out=(
                    *sun,
                    KeepOut(
                        name="Earth",
                        direction=down[number],
                        half_angle=self.earth_half_angle,
                        devices=names,
                    ),
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
