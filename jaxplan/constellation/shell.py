"""Walker shells: satellites evenly spread over evenly spread circular orbits of one altitude and inclination.

In the usual notation ``i:T/P/F`` a shell has T satellites in P planes of inclination i (deg); F is the
phasing. Each plane has ``S = T / P`` slots, evenly spread. A satellite is ``F * 360 / T`` deg further along
its orbit than the one in the same slot of the plane to the west. The ascending nodes spread over the whole
equator in a "delta" pattern and over half of it in a "star", where the first and the last plane move in
opposite directions.

Satellites are numbered from 0, plane by plane from west to east, and within a plane slot by slot in the
direction of flight. Lengths are in km, angles in rad, times in s; the inertial frame is that of
`jaxplan.sky.orbits`.
"""

import math
import re
from dataclasses import dataclass
from typing import TypeGuard

import jax
import numpy as np
from jax import Array

from jaxplan.runtime.arguments import number
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.schema import ScenarioError
from jaxplan.sky import frames, orbits

PATTERNS = ("delta", "star")
MOST = 10**6  # largest number of satellites of a shell
_NOTATION = re.compile(r"\s*([0-9.]+)\s*:\s*([0-9]+)\s*/\s*([0-9]+)\s*/\s*([0-9]+)\s*")


@shown(
    "total",
    "planes",
    "slots",
    "inclination deg",
    "altitude km",
    "period s",
    "pattern",
    "epoch_angle deg",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Shell:
    """A Walker shell of T satellites; `walker` makes it.

    Attributes:
        inclination: rad.
        total: number of satellites, T.
        planes: number of planes, P.
        phasing: F, from 0 to P - 1.
        altitude: km above the equatorial radius.
        pattern: "delta" or "star".
        epoch_angle: rad, argument of latitude of satellite 0 at time zero; its ascending node is at right
            ascension 0.
    """

    inclination: float
    total: int
    planes: int
    phasing: int
    altitude: float
    pattern: str = "delta"
    epoch_angle: float = 0.0

    @property
    def slots(self) -> int:
        """Number of satellites in a plane, S."""
        return self.total // self.planes

    @property
    def notation(self) -> str:
        """The notation ``i:T/P/F``, with the inclination in degrees."""
        return f"{math.degrees(self.inclination):.6g}:{self.total}/{self.planes}/{self.phasing}"

    @property
    def name(self) -> str:
        """Notation and altitude, and the pattern where it is not a delta."""
        star = "" if self.pattern == "delta" else f" ({self.pattern})"
        return f"{self.notation} at {self.altitude:g} km{star}"

    @property
    def plane(self) -> np.ndarray:
        """Number of the plane (T,) that each satellite is in, from 0."""
        return np.arange(self.total) // self.slots

    @property
    def slot(self) -> np.ndarray:
        """Number of the slot (T,) that each satellite has in its plane, from 0."""
        return np.arange(self.total) % self.slots

    @property
    def node_spacing(self) -> float:
        """Angle between the ascending nodes of neighbouring planes, rad."""
        return (2 if self.pattern == "delta" else 1) * math.pi / self.planes

    @property
    def nodes(self) -> np.ndarray:
        """Right ascension (T,) of each satellite's ascending node, rad."""
        return self.node_spacing * self.plane

    @property
    def latitudes(self) -> np.ndarray:
        """Argument of latitude (T,) of each satellite at time zero, rad: angle from its ascending node."""
        return self.epoch_angle + 2 * math.pi * (
            self.slot / self.slots + self.phasing * self.plane / self.total
        )

    @property
    def radius(self) -> float:
        """Radius of the orbits, from the Earth's centre, km."""
        return frames.EARTH_RADIUS + self.altitude

    @property
    def mean_motion(self) -> float:
        """Mean motion along the orbits, rad/s."""
        return math.sqrt(frames.EARTH_MU / self.radius) / self.radius

    @property
    def period(self) -> float:
        """Period of one revolution, s."""
        return 2 * math.pi / self.mean_motion

    def positions(self, time: float = 0.0) -> np.ndarray:
        """Inertial positions (T, 3) in km at a time in s."""
        return self.states(time)[0]

    def velocities(self, time: float = 0.0) -> np.ndarray:
        """Inertial velocities (T, 3) in km/s at a time in s."""
        return self.states(time)[1]

    def nadir(self, time: float = 0.0) -> np.ndarray:
        """Inertial unit vectors (T, 3) from the satellites to the Earth's centre at a time in s."""
        positions = self.positions(time)
        return np.asarray(-positions / np.linalg.norm(positions, axis=-1, keepdims=True))

    def states(self, time: float = 0.0) -> np.ndarray:
        """Inertial positions (km) and velocities (km/s) at a time in s, stacked as (2, T, 3).

        Raises:
            ValueError: for a time that is not a finite number.
        """
        after = number("time", time, "a number of s")
        if not math.isfinite(after):
            raise ValueError(f"time = {after}: must be finite")
        with jax.enable_x64(True):
            latitudes = np.asarray(self.latitudes)
            return np.array(_orbit_states(self.altitude, self.inclination, self.nodes, latitudes, after))

    def neighbours(self, plane_step: int, slot_step: int) -> np.ndarray:
        """Find for each satellite the one that is some planes to the east and some slots ahead.

        Args:
            plane_step: number of planes to the east, negative to the west.
            slot_step: number of slots ahead, negative for behind.

        Returns:
            (T,) int, the number of each satellite's neighbour. East of a delta's last plane comes its first,
            with F added to the slot, so that a step always leads to the same place relative to a satellite's
            own. A star has no planes beyond its outer ones: -1 there.
        """
        around, plane = np.divmod(self.plane + plane_step, self.planes)
        found = plane * self.slots + (self.slot + slot_step + around * self.phasing) % self.slots
        return np.where((around == 0) | (self.pattern == "delta"), found, -1)

    def nearest_slot_steps(self) -> np.ndarray:
        """Find the slots of the two nearest satellites of the plane to the east.

        Near means a small distance on the average of an orbit: where the node is further east by D and the
        argument of latitude is greater by d, the mean cosine of the angle between two satellites is
        ``(cos d (cos D (1 + cos^2 i) + sin^2 i) - 2 sin d sin D cos i) / 2``.

        Returns:
            (2,) int, steps ahead to the nearest and the second nearest, negative for behind, as `neighbours`
            takes them; the same step twice where a plane has a single satellite.
        """
        cosine, turn = math.cos(self.inclination), self.node_spacing
        across = math.cos(turn) * (1 + cosine**2) + math.sin(self.inclination) ** 2
        best = -math.atan2(2 * math.sin(turn) * cosine, across)  # phase at which the mean cosine is largest
        steps = np.arange(self.slots)
        phases = 2 * math.pi * (steps / self.slots + self.phasing / self.total)
        off = np.abs(np.remainder(phases - best + math.pi, 2 * math.pi) - math.pi)
        steps = np.where(steps > self.slots // 2, steps - self.slots, steps)
        nearest = steps[np.argsort(np.round(off, 12), kind="stable")[:2]]
        return np.resize(nearest, 2)  # repeated where a plane has a single satellite


def walker(notation: str, altitude: float, *, pattern: str = "delta", epoch_angle: float = 0.0) -> Shell:
    """Make a Walker shell from the usual notation.

    Args:
        notation: ``i:T/P/F`` with the inclination in degrees, such as "53:1584/72/39".
        altitude: km above the equatorial radius, in (0, 150000].
        pattern: "delta" or "star".
        epoch_angle: rad, argument of latitude of satellite 0 at time zero.

    Raises:
        ScenarioError: (a ValueError) for values that make no shell; all faults are named.

    Example:
        >>> shell = jp.walker("53:1584/72/39", 550.0)
        >>> shell.positions().shape
        (1584, 3)
    """
    found = _NOTATION.fullmatch(str(notation))
    if found is None:
        faults = [f'notation = {notation!r}: must be "i:T/P/F", such as "53:1584/72/39"']
    else:
        faults = _number_faults(found.groups(), notation)
    if not is_number(altitude) or not 0 < altitude <= orbits.HIGHEST_ALTITUDE:
        faults.append(f"altitude = {altitude!r}: must be a number of km in (0, {orbits.HIGHEST_ALTITUDE:g}]")
    if pattern not in PATTERNS:
        faults.append(f"pattern = {pattern!r}: must be {' or '.join(map(repr, PATTERNS))}")
    faults += out_of_range("epoch_angle", epoch_angle, "rad", -1e6, 1e6)
    if faults or found is None:
        raise ScenarioError(faults, "the shell")
    inclination, *counts = found.groups()
    total, planes, phasing = map(int, counts)
    return Shell(
        inclination=math.radians(float(inclination)),
        total=total,
        planes=planes,
        phasing=phasing,
        altitude=float(altitude),
        pattern=pattern,
        epoch_angle=float(epoch_angle),
    )


def _number_faults(texts: tuple[str, ...], notation: str) -> list[str]:
    """Check the four numbers of a notation; returns a message for each that is wrong.

    Args:
        texts: inclination, total, planes and phasing as texts of digits.
        notation: the whole text, for messages.
    """
    try:
        inclination = float(texts[0])
    except ValueError:  # more than one decimal point
        inclination = math.nan
    total, planes, phasing = map(int, texts[1:])
    wanted = {
        "i must be a number of degrees in [0, 180]": 0 <= inclination <= 180,
        f"T must lie in [1, {MOST}]": 1 <= total <= MOST,
        f"P must divide T = {total}": planes >= 1 and total % planes == 0,
        f"F must lie in [0, P - 1] = [0, {planes - 1}]": phasing < max(planes, 1),
    }
    return [f"notation = {notation!r}: {what}" for what, right in wanted.items() if not right]


def out_of_range(name: str, value: object, unit: str, low: float, high: float) -> list[str]:
    """Check that a value is a number in [low, high]; returns a list of one message if not, else an empty one.

    `name` and `unit`, which is empty for fractions, are for the message only.
    """
    if is_number(value) and low <= value <= high:
        return []
    measured = f" of {unit}" if unit else ""
    return [f"{name} = {value!r}: must be a number{measured} in [{low:g}, {high:g}]"]


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether a value is a real number; booleans do not count as numbers."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


@quick_jit
def _orbit_states(altitude: Array, inclination: Array, nodes: Array, latitudes: Array, time: Array) -> Array:
    """Inertial positions, km, and velocities, km/s, as (2, T, 3); arguments as in `orbits.position`."""
    elements = (altitude, inclination, nodes, latitudes, time)
    return jax.numpy.stack([orbits.position(*elements), orbits.velocity(*elements)])
