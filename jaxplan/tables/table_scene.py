"""What a table tells about a scene: all, or without joints the platform and what is fixed to it."""

from dataclasses import replace
from typing import Any

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.tables.table import AttitudeTable


def as_known(table: AttitudeTable, scene: Scenario) -> tuple[AttitudeTable, Scenario, list[str]]:
    """Reduce a scene to what a table tells about, and put the table's joints in the scene's order.

    Args:
        table: as it was read.
        scene: the scene that the table is compared with.

    Returns:
        The table, the scene, and a sentence for each thing that the table does not tell about.

    Raises:
        ValueError: if the table has some of the scene's joints and not the others.
    """
    names = scene.spacecraft.joint_names
    if table.joints is not None and names:
        return table.of(scene.spacecraft), scene, []
    bare = replace(table, joints=None, joint_rates=None, joint_names=(), spacecraft=None)
    if not names:
        return bare, scene, []
    craft = scene.spacecraft
    moving = craft.device_names[: craft.gimbals.count]
    rest = replace(craft, terminals=(), drives=())
    left, dropped = _restrict_zones(scene, rest)
    found = [f"{', '.join(moving)}: the table has no joints, so what they point at is not known"]
    if dropped:
        found.append(f"zones of these devices alone: {', '.join(dropped)}")
    no_joints = replace(scene.start, joints=np.zeros(0), joint_rates=np.zeros(0))
    return bare, replace(left, spacecraft=rest, start=no_joints, goal=no_joints), found


def _restrict_zones(scene: Scenario, rest: Spacecraft) -> tuple[Scenario, list[str]]:
    """Return a scene whose zones bind only what the spacecraft `rest` has, and names of zones dropped.

    A whole group of zones is dropped where one of its zones binds a device that `rest` does not have.
    """
    known, gone = set(rest.device_names), set[str]()
    every: tuple[Any, ...] = (*scene.keep_out, *scene.keep_in, *scene.joint_bounds)
    kept: dict[str, list[Any]] = {"keep_out": [], "keep_in": []}
    unsure = {zone.any_of for zone in every if zone.any_of is not None and not _binds_only(zone, known)}
    for kind, zones in kept.items():
        for zone in getattr(scene, kind):
            names = tuple(name for name in zone.devices if name in known)
            vectors = tuple(vector for vector in zone.vectors if vector.to is None)
            fixed = zone.axis_device is None or zone.axis_device in known
            bound = (zone.binds_all and known) or names or vectors
            if not fixed or not bound or zone.any_of in unsure - {None}:
                gone.add(zone.name)
            else:
                zones.append(replace(zone, devices=names, vectors=vectors))
    gone |= {zone.name for zone in scene.joint_bounds}
    changed = replace(
        scene, keep_out=tuple(kept["keep_out"]), keep_in=tuple(kept["keep_in"]), joint_bounds=()
    )
    return changed, [zone.name for zone in every if zone.name in gone]


def _binds_only(zone: Any, known: set[str]) -> bool:
    """Tell whether a zone of a group binds only devices named in `known`, and axes of the body."""
    devices = getattr(zone, "devices", None)
    if devices is None:  # a bound of joints
        return False
    axis = getattr(zone, "axis_device", None)
    vectors = getattr(zone, "vectors", ())
    return (
        not getattr(zone, "binds_all", False)
        and set(devices) <= known
        and (axis is None or axis in known)
        and all(vector.to is None for vector in vectors)
    )
