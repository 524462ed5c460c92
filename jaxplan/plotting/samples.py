"""What the figures show, as plain numbers: a plan's motion on a dense grid, its boresights and its margins.

Radians and seconds; boresights are inertial unit vectors, devices in the order terminals, instruments. All of
it is plain numpy, so no number of devices, nodes or zones has anything compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxplan.moving import DirectionPath
from jaxplan.zones import KeepIn, KeepOut

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario
    from jaxplan.spacecraft import Spacecraft
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
        boresights=boresights(plan.scenario.spacecraft, values.attitude, values.joints),
        node_times=np.asarray(trajectory.node_times),
    )


def boresights(spacecraft: "Spacecraft", attitude: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Directions of all devices, equations (11) to (13).

    Args:
        spacecraft: that carries them.
        attitude: (..., 3, 3) body to inertial.
        joints: (..., 2n) rad.

    Returns:
        (..., D, 3) inertial unit vectors.
    """
    yaw, pitch = np.split(joints, 2, axis=-1)
    azimuth, level = yaw + spacecraft.mounts, np.cos(pitch)
    moving = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(pitch)], axis=-1)
    fixed = spacecraft.fixed_boresights
    body = np.concatenate([moving, np.broadcast_to(fixed, (*joints.shape[:-1], *fixed.shape))], axis=-2)
    return np.asarray(body @ np.swapaxes(attitude, -1, -2))


def path_boresights(plan: "Plan", points_an_edge: int = 24) -> np.ndarray:
    """Boresights along a plan's path: geodesics of the platform with linear joints.

    Args:
        plan: with a path.
        points_an_edge: how finely each edge is drawn.

    Returns:
        (k, D, 3); a single instant of a path of one node.
    """
    from scipy.spatial.transform import Rotation, Slerp

    path = plan.path
    assert path is not None
    attitudes, joints = path.attitudes, path.joints
    if path.edges:
        nodes = np.arange(path.edges + 1)
        places = np.linspace(0, path.edges, points_an_edge * path.edges + 1)
        attitudes = Slerp(nodes, Rotation.from_matrix(attitudes))(places).as_matrix()
        columns = [np.interp(places, nodes, column) for column in joints.T]
        joints = np.stack(columns, axis=-1) if columns else np.zeros((len(places), 0))
    return boresights(plan.scenario.spacecraft, attitudes, joints)


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
    angles = _separation(directions, axis)
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


def _separation(directions: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Angles between directions (k, D, 3) and an axis, (3,) or (k, 1, 3), rad; exact near 0 and pi."""
    along = directions @ axis if axis.ndim == 1 else np.sum(directions * axis, axis=-1)
    return np.arctan2(np.linalg.norm(np.cross(directions, axis), axis=-1), along)
