"""Walker shells: satellites evenly spread over evenly spread circular orbits of one altitude and inclination.

In the field's notation ``i:T/P/F`` a shell has T satellites in P planes of inclination i (deg). Each plane
has ``S = T / P`` slots, evenly spread. A satellite is ``F * 360 / T`` deg further along its orbit than the
one in the same slot of the plane to the west. Ascending nodes spread over the whole equator in a delta
pattern and over half of it in a star, where the first plane and the last one move in opposite directions.

Satellites are numbered plane by plane, from west to east, and in a plane slot by slot in the direction of
flight. Lengths are in km, angles in rad, times in s; the frame is that of `jaxplan.sky.orbits`.
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
from jaxplan.sky import orbits

PATTERNS = ("delta", "star")
HIGHEST = 1e6  # km, greatest altitude of a shell; beyond, the Earth keeps no satellites
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
    """A Walker shell of ``total`` = T satellites; `walker` makes it.

    Attributes:
        inclination: rad.
        total: number of satellites, T.
        planes: number of planes, P.
        phasing: F, from 0 to P - 1.
        altitude: km above the equatorial radius.
        pattern: "delta" or "star".
        epoch_angle: rad, argument of latitude of satellite 0 at time zero; its node is at right ascension 0.
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
        """``i:T/P/F``, the inclination in degrees."""
        return f"{math.degrees(self.inclination):.6g}:{self.total}/{self.planes}/{self.phasing}"

    @property
    def name(self) -> str:
        """Notation and altitude, and the pattern where it is not a delta."""
        star = "" if self.pattern == "delta" else f" ({self.pattern})"
        return f"{self.notation} at {self.altitude:g} km{star}"

    @property
    def plane(self) -> np.ndarray:
        """Plane (T,) of each satellite."""
        return np.arange(self.total) // self.slots

    @property
    def slot(self) -> np.ndarray:
        """Slot (T,) of each satellite in its plane."""
        return np.arange(self.total) % self.slots

    @property
    def node_spacing(self) -> float:
        """Angle between the ascending nodes of neighbouring planes, rad."""
        return (2 if self.pattern == "delta" else 1) * math.pi / self.planes

    @property
    def nodes(self) -> np.ndarray:
        """Right ascensions (T,) of the ascending nodes, rad."""
        return self.node_spacing * self.plane

    @property
    def latitudes(self) -> np.ndarray:
        """Arguments of latitude (T,) at time zero, rad."""
        return self.epoch_angle + 2 * math.pi * (
            self.slot / self.slots + self.phasing * self.plane / self.total
        )

    @property
    def radius(self) -> float:
        """Radius of the orbits, km."""
        return orbits.EARTH_RADIUS + self.altitude

    @property
    def mean_motion(self) -> float:
        """Mean motion along the orbits, rad/s."""
        return math.sqrt(orbits.EARTH_MU / self.radius) / self.radius

    @property
    def period(self) -> float:
        """Period of one revolution, s."""
        return 2 * math.pi / self.mean_motion

    def positions(self, time: float = 0.0) -> np.ndarray:
        """Inertial positions (T, 3) at a time in s, km."""
        return self.states(time)[0]

    def velocities(self, time: float = 0.0) -> np.ndarray:
        """Inertial velocities (T, 3) at a time in s, km/s."""
        return self.states(time)[1]

    def nadir(self, time: float = 0.0) -> np.ndarray:
        """Inertial unit vectors (T, 3) from the satellites to the Earth's centre at a time in s."""
        positions = self.positions(time)
        return np.asarray(-positions / np.linalg.norm(positions, axis=-1, keepdims=True))

    def states(self, time: float = 0.0) -> np.ndarray:
        """Positions and velocities (2, T, 3) at a time in s, km and km/s."""
        after = number("time", time, "a number of s")
        if not math.isfinite(after):
            raise ValueError(f"time = {after}: must be finite")
        with jax.enable_x64(True):
            latitudes = np.asarray(self.latitudes)
            return np.array(_states(self.altitude, self.inclination, self.nodes, latitudes, after))

    def neighbours(self, plane_step: int, slot_step: int) -> np.ndarray:
        """Each satellite's neighbour some planes to the east and some slots ahead.

        Args:
            plane_step: planes to the east, negative to the west.
            slot_step: slots ahead, negative for behind.

        Returns:
            (T,) int numbers of the neighbours. East of a delta's last plane is its first, with F more slots
            ahead, so that a step always leads to the same place relative to a satellite's own. A star has
            nothing beyond its outer planes: -1.
        """
        around, plane = np.divmod(self.plane + plane_step, self.planes)
        found = plane * self.slots + (self.slot + slot_step + around * self.phasing) % self.slots
        return np.where((around == 0) | (self.pattern == "delta"), found, -1)

    def nearest_slot_steps(self) -> np.ndarray:
        """Steps (2,) ahead to the nearest and the second nearest satellite of the plane to the east.

        Near is what is least far away on the average of an orbit, which is closed: with a node further on by
        D and an argument of latitude by d, the mean cosine of the angle between two satellites is
        ``(cos d (cos D (1 + cos^2 i) + sin^2 i) - 2 sin d sin D cos i) / 2``.
        """
        cosine, turn = math.cos(self.inclination), self.node_spacing
        across = math.cos(turn) * (1 + cosine**2) + math.sin(self.inclination) ** 2
        best = -math.atan2(2 * math.sin(turn) * cosine, across)  # the phase at which that is largest
        steps = np.arange(self.slots)
        phases = 2 * math.pi * (steps / self.slots + self.phasing / self.total)
        off = np.abs(np.remainder(phases - best + math.pi, 2 * math.pi) - math.pi)
        steps = np.where(steps > self.slots // 2, steps - self.slots, steps)
        nearest = steps[np.argsort(np.round(off, 12), kind="stable")[:2]]
        return np.resize(nearest, 2)  # a plane may have a single satellite


def walker(notation: str, altitude: float, *, pattern: str = "delta", epoch_angle: float = 0.0) -> Shell:
    """Make a Walker shell from the field's notation.

    Args:
        notation: ``i:T/P/F`` with the inclination in degrees, such as "53:1584/72/39".
        altitude: km above the equatorial radius.
        pattern: "delta" or "star".
        epoch_angle: rad, argument of latitude of satellite 0 at time zero.

    Raises:
        ScenarioError: (a ValueError) for what is no shell; all faults are named.

    Example:
        >>> shell = jp.walker("53:1584/72/39", 550.0)
        >>> shell.positions().shape
        (1584, 3)
    """
    found = _NOTATION.fullmatch(str(notation))
    if found is None:
        faults = [f'notation = {notation!r}: must be "i:T/P/F", such as "53:1584/72/39"']
    else:
        faults = _wrong_numbers(found.groups(), notation)
    if not is_number(altitude) or not 0 < altitude <= HIGHEST:
        faults.append(f"altitude = {altitude!r}: must be a number of km in (0, {HIGHEST:g}]")
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


def _wrong_numbers(texts: tuple[str, ...], notation: str) -> list[str]:
    """Messages on what is wrong with the texts of inclination, total, planes and phasing; perhaps none."""
    try:
        inclination = float(texts[0])
    except ValueError:  # more than one point
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
    """A list of one message if a value is no number in [low, high], in the unit; else an empty one."""
    if is_number(value) and low <= value <= high:
        return []
    return [f"{name} = {value!r}: must be a number of {unit} in [{low:g}, {high:g}]"]


def is_number(value: object) -> TypeGuard[float]:
    """True for real numbers, truth values excepted."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


@quick_jit
def _states(altitude: Array, inclination: Array, nodes: Array, latitudes: Array, time: Array) -> Array:
    """Inertial positions, km, and velocities, km/s: (2, T, 3); arguments are those of `orbits.position`."""
    elements = (altitude, inclination, nodes, latitudes, time)
    return jax.numpy.stack([orbits.position(*elements), orbits.velocity(*elements)])
