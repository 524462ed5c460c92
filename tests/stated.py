"""Margins of a trajectory to constraints as they are stated, on dense samples: numpy and scipy alone.

Nothing of it goes through the table of rows. Devices are turned about their axes, one after the other, and
the trajectory is evaluated from its definition.
"""

import numpy as np
from manoeuvres import attitudes_of, holding, joints_of
from moving_scenes import seen
from scipy.spatial.transform import Rotation

from jaxplan.model.directions import DirectionPath
from jaxplan.model.zones import JointBound, KeepIn

SAMPLES = 5_003


def least_margin(scenario, trajectory, count=SAMPLES):
    """The smallest margin, rad, of all constraints at all samples; NaN if any is none."""
    time = np.linspace(0.0, trajectory.duration, count)
    return float(np.min([np.inf, *np.ravel(list(stated_margins(scenario, trajectory, time).values()))]))


def stated_margins(scenario, trajectory, time):
    """Margin (k,) of every constraint at times (k,) s, by the name of its zone or group."""
    attitudes = attitudes_of(trajectory, time, holding(trajectory.breaks, time))
    return state_margins(scenario, attitudes, joints_of(trajectory, time, orders=1)[0], time)


def state_margins(scenario, attitudes, joints, time):
    """The same of states: attitudes (k, 3, 3), joints (k, 2n), times (k,) s."""
    groups = {}
    for zone in (*scenario.keep_out, *scenario.keep_in, *scenario.joint_bounds):
        name, entry = zone.name if zone.any_of is None else zone.any_of, zone.entry or zone.name
        margin = _margin(scenario.spacecraft, zone, attitudes, joints, time)
        groups.setdefault(name, {}).setdefault(entry, []).append(margin)
    return {
        name: np.max([np.min(members, axis=0) for members in entries.values()], axis=0)
        for name, entries in groups.items()
    }


def _margin(craft, zone, attitudes, joints, time):
    """(k,) margin to one zone, of what it binds that is worst."""
    if isinstance(zone, JointBound):
        number = [terminal.name for terminal in craft.terminals].index(zone.device)
        yaw, pitch = joints[:, number], joints[:, len(craft.terminals) + number]
        return zone.normal[0] * yaw + zone.normal[1] * pitch - zone.least
    turn = Rotation.from_matrix(attitudes)
    if zone.axis_device is not None:
        axis = turn.apply(_in_body(craft, zone.axis_device, [1.0, 0.0, 0.0], joints))
    elif zone.axis_body is not None:
        axis = turn.apply(np.asarray(zone.axis_body))
    elif isinstance(zone.direction, DirectionPath):
        axis = seen(zone.direction, time)
    else:
        axis = np.tile(zone.direction, (len(joints), 1))
    names = zone.devices if zone.devices or zone.vectors else craft.device_names
    bound = [_in_body(craft, name, [1.0, 0.0, 0.0], joints) for name in names]
    bound += [_in_body(craft, vector.to, vector.along, joints) for vector in zone.vectors]
    own = np.array([turn.apply(vectors) for vectors in bound])
    apart = np.arctan2(np.linalg.norm(np.cross(own, axis), axis=-1), np.sum(own * axis, axis=-1))
    inside = isinstance(zone, KeepIn)
    return np.min(zone.half_angle - apart if inside else apart - zone.half_angle, axis=0)


def _in_body(craft, name, along, joints):
    """(k, 3) body axes: a vector that a terminal carries, an instrument's boresight, or one of the body."""
    for number, terminal in enumerate(craft.terminals):
        if terminal.name == name:
            yaw, pitch = joints[:, number] + terminal.mount, joints[:, len(craft.terminals) + number]
            return Rotation.from_euler("ZY", np.stack([yaw, -pitch], axis=1)).apply(along)
    fixed = {instrument.name: instrument.boresight for instrument in craft.instruments}
    return np.tile(along if name is None else fixed[name], (len(joints), 1))
