"""What the figures show, as plain numbers: a plan's motion on a dense grid, its boresights and its margins.

Radians and seconds; boresights are inertial unit vectors, devices in the order terminals, instruments. All of
it is plain numpy, so no number of devices, nodes or zones has anything compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxplan import so3
from jaxplan.geometry.directions import separation
from jaxplan.moving import DirectionPath
from jaxplan.zones import KeepIn, KeepOut

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario
    from jaxplan.trajectory.curve import Samples

INSTANTS = 1024  # of the grid; the paper's manoeuvres have 14 to 50 nodes


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A trajectory on a grid of times.

    Attributes:
        times: (k,) s; a single one if the manoeuvre takes no time.
        values: the trajectory there.
        boresights: (k, D, 3).
        node_times: (m + 1,) s.
    """

    times: np.ndarray
    values: "Samples"
    boresights: np.ndarray
    node_times: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin:
    """Margin of a device to a zone, or to a group of them, over time.

    Attributes:
        device: number of the device.
        zone: name of the zone or of the group.
        values: (k,) rad, >= 0 is clear; NaN while the group's best zone does not bind the device.
    """

    device: int
    zone: str
    values: np.ndarray


def motion(plan: "Plan") -> Motion:
    """A plan's trajectory on the grid.

    Raises:
        ValueError: if the plan has no trajectory.
    """
    trajectory = plan.trajectory
    if trajectory is None:
        ending = ": ".join(filter(None, [plan.status.name, plan.message]))
        raise ValueError(
            f"the plan of {plan.scenario.name!r} has no trajectory to draw; it ended as {ending}"
        )
    times = np.linspace(0.0, trajectory.duration, INSTANTS if trajectory.duration > 0 else 1)
    values = trajectory.sample(times)
    return Motion(
        times=times,
        values=values,
        boresights=plan.scenario.spacecraft.boresights(values.attitude, values.joints),
        node_times=np.asarray(trajectory.node_times),
    )


def path_boresights(plan: "Plan", points_an_edge: int = 24) -> np.ndarray:
    """Boresights along a plan's path: geodesics of the platform with linear joints.

    Args:
        plan: with a path.
        points_an_edge: how finely each edge is drawn.

    Returns:
        (k, D, 3); a single instant of a path of one node.
    """
    path = plan.path
    assert path is not None
    attitudes, joints = path.attitudes, path.joints
    if path.edges:
        places = np.linspace(0, path.edges, points_an_edge * path.edges + 1)
        edge = np.minimum(places.astype(int), path.edges - 1)
        part = places - edge
        attitudes = so3.geodesic(attitudes[edge], attitudes[edge + 1], part)
        joints = joints[edge] + part[:, None] * (joints[edge + 1] - joints[edge])
    return np.asarray(plan.scenario.spacecraft.boresights(attitudes, joints))


def margins(scenario: "Scenario", directions: np.ndarray, times: np.ndarray | None = None) -> list[Margin]:
    """Margins of every device to every constraint that binds it, equations (11) and (12).

    Zones of a group count as the best of them: at every instant the one whose worst device has most margin.
    So the smallest of all margins at an instant is that of the scene.

    Args:
        scenario: whose zones are meant; one that moves is taken where it is at each instant.
        directions: (k, D, 3) boresights.
        times: (k,) s, of them; only zones that move ask for it.
    """
    names = scenario.spacecraft.device_names
    result = [
        margin for zone in scenario.keep_out for margin in _zone_margins(zone, names, directions, times)
    ]
    groups: dict[str, list[KeepIn]] = {}
    for zone in scenario.keep_in:
        if zone.any_of is None:
            result += _zone_margins(zone, names, directions, times)
        else:
            groups.setdefault(zone.any_of, []).append(zone)
    for name, zones in groups.items():
        result += _group_margins(name, zones, names, directions, times)
    return result


def _zone_margins(
    zone: KeepOut | KeepIn, names: Sequence[str], directions: np.ndarray, times: np.ndarray | None
) -> list[Margin]:
    axis = zone.direction
    if isinstance(axis, DirectionPath):
        assert times is not None
        axis = axis.at(times)[:, None]
    angles = separation(directions, axis)
    values = zone.half_angle - angles if isinstance(zone, KeepIn) else angles - zone.half_angle
    bound = [number for number, name in enumerate(names) if not zone.devices or name in zone.devices]
    return [Margin(device=number, zone=zone.name, values=values[:, number]) for number in bound]


def _group_margins(
    group: str,
    zones: Sequence[KeepIn],
    names: Sequence[str],
    directions: np.ndarray,
    times: np.ndarray | None,
) -> list[Margin]:
    table = np.full((len(zones), *directions.shape[:2]), np.nan)
    for row, zone in zip(table, zones, strict=True):
        for margin in _zone_margins(zone, names, directions, times):
            row[:, margin.device] = margin.values
    worst = np.min(np.where(np.isnan(table), np.inf, table), axis=2)
    best = table[np.argmax(worst, axis=0), np.arange(table.shape[1])]
    bound = [number for number in range(len(names)) if not np.all(np.isnan(best[:, number]))]
    return [Margin(device=number, zone=group, values=best[:, number]) for number in bound]
