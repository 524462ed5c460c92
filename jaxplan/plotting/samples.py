"""What the figures show, as plain numbers: a plan's motion on a dense grid, its boresights and its margins.

Radians and seconds; boresights are inertial unit vectors, devices in the order terminals, instruments. All of
it is plain numpy, so no number of devices, nodes or zones has anything compiled.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from jaxplan import so3
from jaxplan.model.constraints import chosen_entries, state_margins
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.plotting.style import expect_plan
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
    values: Samples
    boresights: np.ndarray
    node_times: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin:
    """Margin of a device to a zone, or to a group of them, over time.

    Attributes:
        device: number of the device, or beyond these of a further direction that zones bind.
        zone: name of the zone or of the group.
        values: (k,) rad, >= 0 is clear; NaN while the group's best zone does not bind the device.
    """

    device: int
    zone: str
    values: np.ndarray


def motion(plan: Plan) -> Motion:
    """A plan's trajectory on the grid.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory.
    """
    trajectory = expect_plan(plan).trajectory
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


def path_boresights(plan: Plan, points_an_edge: int = 24) -> np.ndarray:
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


def margins(scenario: Scenario, moves: Motion) -> list[Margin]:
    """Margins of all that is bound to every constraint that binds it, equations (11) and (12).

    A group counts as the best of its entries: at every instant the one whose worst member has most margin.
    So the smallest of all margins at an instant is that of the scene.

    Args:
        scenario: whose zones are meant; one that moves is taken where it is at each instant.
        moves: the motion.
    """
    rows, craft, values = scenario.constraints, scenario.spacecraft, moves.values
    sights = rows.sights(craft.mounts, craft.fixed_boresights)
    table = state_margins(rows, sights, values.attitude, values.joints, moves.times)  # (k, Z, S)
    chosen = chosen_entries(rows, np.min(table, axis=-1, initial=np.inf)) == rows.entry  # (k, Z)
    table = np.where(chosen[..., None] & rows.bound, table, np.nan)
    single, found = rows.single, []
    for leader in np.unique(rows.group[rows.zone >= 0]):
        zone = scenario.zones[rows.zone[leader]]
        members = [[row] for row in np.flatnonzero(rows.group == leader)]
        if not single[leader]:
            members = [list(chain(*members))]
        for own in members:
            for sight in np.flatnonzero(np.any(rows.bound[own], axis=0)):
                least = np.fmin.reduce(table[:, own, sight], axis=1)
                name = zone.name if single[leader] else str(zone.any_of)
                if not np.all(np.isnan(least)):  # of an entry that is never the best
                    found.append(Margin(device=int(sight), zone=name, values=least))
    return found
