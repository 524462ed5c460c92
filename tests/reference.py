"""Directions, motions and margins in plain numpy and scipy, from their definitions.

Nothing here is shared with the package. Angles in rad, times in s, attitudes body to inertial; ``craft`` is
whatever has ``gimbals``, with ``frames`` (n + d, 3, 3) and ``tilts`` (d,), and ``fixed_boresights`` (i, 3): a
spacecraft, or a scene of the search. There are D = n + d + i devices, terminals, drives and instruments;
joints are all yaws, all pitches, and the angles of all drives.
"""

from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from jaxplan.model.devices import Drive, Instrument, Terminal
from jaxplan.model.directions import DirectionPath
from jaxplan.model.zones import JointBound, KeepIn, KeepOut

# Weights of the values at -4 h ... 4 h for the first and the second derivative, of order 8.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


COMPARISONS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal}


def assert_each(values, comparison, bounds, about=""):
    """Every value compares so with its bound, as no NaN does; the message shows the first that do not."""
    values, bounds = np.broadcast_arrays(values, bounds)
    places = np.argwhere(~COMPARISONS[comparison](values, bounds))
    shown = "".join(f"\n{at}: {values[tuple(at)]} against {bounds[tuple(at)]}" for at in places[:5])
    assert not shown, f"{about} {len(places)} of {values.size} are not {comparison} their bounds:{shown}"


def unit(vectors):
    """Vectors (..., 3) of length one."""
    vectors = np.asarray(vectors)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_units(rng, *shape):
    """(*shape, 3) directions, uniform on the sphere."""
    return unit(rng.standard_normal((*shape, 3)))


def direction(azimuth, elevation=0.0):
    """(..., 3) unit vectors."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def angle(first, second):
    """(...,) between vectors (..., 3), to rounding everywhere."""
    first, second = np.broadcast_arrays(first, second)
    return np.arctan2(np.linalg.norm(np.cross(first, second), axis=-1), np.sum(first * second, axis=-1))


def gimbal_angles(gimbals, joints):
    """Azimuth and elevation (..., n + d) in the axes of each gimbal, of joints (..., 2n + d)."""
    joints, drives = np.asarray(joints), len(gimbals.tilts)
    count = len(gimbals.frames) - drives
    yaws, pitches, angles = np.split(joints, [count, 2 * count], axis=-1)
    tilts = np.broadcast_to(gimbals.tilts, angles.shape)
    return np.concatenate([yaws, angles], axis=-1), np.concatenate([pitches, tilts], axis=-1)


def boresights(craft, attitudes, joints):
    """(..., D, 3) inertial, by equation (13), of attitudes (..., 3, 3) and joints (..., 2n + d)."""
    azimuth, elevation = gimbal_angles(craft.gimbals, joints)
    moving = np.einsum("gij,...gj->...gi", craft.gimbals.frames, direction(azimuth, elevation))
    fixed = np.broadcast_to(craft.fixed_boresights, (*azimuth.shape[:-1], *craft.fixed_boresights.shape))
    return np.concatenate([moving, fixed], axis=-2) @ np.swapaxes(attitudes, -1, -2)


def edge_states(attitude, joints, end_attitude, end_joints, samples):
    """Attitudes (samples, 3, 3) and joints along the motion between two nodes."""
    start = Rotation.from_matrix(np.array(attitude))  # scipy wants writable arrays
    turn = (start.inv() * Rotation.from_matrix(np.array(end_attitude))).as_rotvec()
    fraction = np.linspace(0, 1, samples)[:, None]
    path = joints + fraction * (end_joints - joints).reshape(1, -1)
    return (start * Rotation.from_rotvec(fraction * turn)).as_matrix(), path


def sampled_margin(scene, attitudes, joints):
    """(k,) smallest margin over a scene's zones and groups at each state."""
    directions = boresights(scene, attitudes, joints)
    worst = np.full(len(joints), np.inf)
    for cones in (scene.cones, scene.grouped_cones):
        cosines = np.clip(np.einsum("kdi,zi->kzd", directions, cones.axis), -1, 1)
        margin = cones.side[:, None] * (np.arccos(cosines) - cones.half_angle[:, None])
        zone = np.where(cones.bound, margin, np.inf).min(axis=-1, initial=np.inf)
        for group in np.unique(cones.group):
            worst = np.minimum(worst, zone[:, cones.group == group].max(axis=1))
    return worst


def edge_margins(scene, path, samples=201):
    """(edges,) smallest margin over a scene's zones and groups along each edge of a path, sampled."""
    nodes = zip(path.attitudes, path.joints, strict=True)
    return np.array([sampled_margin(scene, *edge_states(*a, *b, samples)).min() for a, b in pairwise(nodes)])


def step_costs(scene, path):
    """(edges,) steps between the nodes of a path: the platform's, or the joint's that takes most."""
    turns = Rotation.from_matrix(np.swapaxes(path.attitudes[:-1], 1, 2) @ path.attitudes[1:]).magnitude()
    moves = np.abs(np.diff(path.joints, axis=0)) / scene.joint_steps
    return np.maximum(turns / scene.attitude_step, moves.max(axis=1, initial=0))


def assert_leads(scene, path):
    """A path leads from start to goal within the limits of joints, by single steps."""
    np.testing.assert_allclose(path.attitudes[0], scene.start_attitude, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(path.attitudes[-1], scene.goal_attitude)
    np.testing.assert_array_equal(path.joints[[0, -1]], [scene.start_joints, scene.goal_joints])
    assert_each(path.joints, ">=", scene.joint_ranges[:, 0] - 1e-12)
    assert_each(path.joints, "<=", scene.joint_ranges[:, 1] + 1e-12)
    np.testing.assert_allclose(path.edge_costs, step_costs(scene, path), rtol=0, atol=1e-9)
    assert_each(path.edge_costs, "<=", 1 + 1e-9)


# Trajectories.


def holding(breaks, time):
    """The pieces that hold times."""
    return np.clip(np.searchsorted(breaks, time, side="right") - 1, 0, len(breaks) - 2)


def attitudes_of(trajectory, time, piece=None):
    """Attitudes (k, 3, 3) from the definition of the curve; pieces that are given also beyond their ends."""
    piece = holding(trajectory.breaks, time) if piece is None else piece
    first, last = trajectory.breaks[piece], trajectory.breaks[piece + 1]
    x = 2 * (time - first) / (last - first) - 1
    coefficients = trajectory.coefficients[piece]
    b = np.einsum("kj,kjc->kc", legendre.legvander(x, coefficients.shape[1] - 1), coefficients)
    chart = (time - trajectory.chart_start[piece])[:, None] * trajectory.chart_rate[piece]
    half, base = Rotation.from_rotvec(chart / 2), Rotation.from_matrix(trajectory.chart_attitude[piece])
    return (base * half * Rotation.from_rotvec(b - chart) * half).as_matrix()


def joints_of(trajectory, time, orders=3):
    """Joints, rates and accelerations (3, k, 2n), or as many of these as are asked for."""
    breaks = trajectory.joint_breaks
    piece = holding(breaks, time)
    length = (breaks[piece + 1] - breaks[piece])[:, None]
    x = 2 * (time - breaks[piece]) / length[:, 0] - 1
    curves = []
    for order in range(orders):
        coefficients = legendre.legder(trajectory.joint_coefficients, order, axis=1)[piece]
        basis = legendre.legvander(x, coefficients.shape[1] - 1)
        curves.append(np.einsum("kj,kjc->kc", basis, coefficients) * (2 / length) ** order)
    return np.stack(curves)


def boresights_of(trajectory, craft, time):
    """Directions of all devices (k, D, 3)."""
    return boresights(craft, attitudes_of(trajectory, time), joints_of(trajectory, time, orders=1)[0])


def spin_of(trajectory, time):
    """Angular velocity, acceleration and jerk (3, k, 3), body axes, by differences of attitudes."""
    # of the narrowest piece, but no smaller than what leaves rounding alone
    step = max(0.005 * np.diff(trajectory.breaks).min(), 5e-5 * np.ptp(trajectory.breaks))
    piece = holding(trajectory.breaks, time)
    stencil = np.stack([attitudes_of(trajectory, time + i * step, piece) for i in range(-8, 9)])

    def antisymmetric(weights):
        """Of R^T R' and R^T R'': the angular velocity and its derivative, at -4 h ... 4 h."""
        slopes = np.stack([np.tensordot(weights, stencil[i : i + 9], 1) for i in range(9)])
        m = np.swapaxes(stencil[4:-4], -1, -2) @ slopes
        return np.stack([m[..., i, j] - m[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / 2

    acceleration = antisymmetric(SECOND / step**2)
    jerk = np.tensordot(FIRST / step, acceleration, 1)
    return np.stack([antisymmetric(FIRST / step)[4], acceleration[4], jerk])


# Zones.


def seen(path, time):
    """Directions (k, 3) by the definition of a path."""
    return unit(CubicSpline(path.times, path.samples)(time))


def zone_margin(zone, craft, directions, time=None):
    """(k,) margin of a zone's worst device, of directions (k, D, 3); times are for zones that move."""
    moving = isinstance(zone.direction, DirectionPath)
    axis = seen(zone.direction, time)[:, None] if moving else zone.direction
    names = zone.devices or craft.device_names
    bound = directions[:, [name in names for name in craft.device_names]]
    clear = angle(bound, axis) - zone.half_angle
    return np.min(clear if isinstance(zone, KeepOut) else -clear, axis=1)


def zone_margins(trajectory, craft, zones, time):
    """Margin (zones, k) of each zone's worst device, zones where they are at each time."""
    directions = boresights_of(trajectory, craft, time)
    return np.array([zone_margin(zone, craft, directions, time) for zone in zones])


def sampled(trajectory, craft, zones, count=6_001):
    """The same at evenly spaced times, (zones, count)."""
    return zone_margins(trajectory, craft, zones, np.linspace(0, trajectory.duration, count))


def least_margin(scenario, trajectory, count=5_003):
    """The smallest margin of all constraints at all samples; NaN if any is none."""
    time = np.linspace(0.0, trajectory.duration, count)
    return float(np.min([np.inf, *np.ravel(list(stated_margins(scenario, trajectory, time).values()))]))


def stated_margins(scenario, trajectory, time):
    """Margin (k,) of every constraint as it is stated, of whatever kind, by the name of its zone or group."""
    joints = joints_of(trajectory, time, orders=1)[0]
    return state_margins(scenario, attitudes_of(trajectory, time), joints, time)


def state_margins(scenario, attitudes, joints, time):
    """The same of states: attitudes (k, 3, 3), joints (k, J), times (k,)."""
    groups = {}
    for zone in (*scenario.keep_out, *scenario.keep_in, *scenario.joint_bounds):
        name, entry = zone.name if zone.any_of is None else zone.any_of, zone.entry or zone.name
        margin = _stated_margin(scenario.spacecraft, zone, attitudes, joints, time)
        groups.setdefault(name, {}).setdefault(entry, []).append(margin)
    margins = {
        name: np.max([np.min(members, axis=0) for members in entries.values()], axis=0)
        for name, entries in groups.items()
    }
    for terminal in scenario.spacecraft.terminals:
        own = own_joints(scenario.spacecraft, terminal.name)
        yaws = scenario.spacecraft.joint_ranges[own[0]]
        for number, corners in enumerate(terminal.mask):
            margins[f"mask {number + 1} of {terminal.name}"] = mask_margin(corners, joints[:, own], yaws)
    return margins


def outside(corners, points):
    """(k,) how far points (k, 2) are beyond the edge of a convex polygon that they are farthest beyond."""
    middle = np.mean(corners, axis=0)
    margins = []
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([there[1] - here[1], here[0] - there[0]]) / np.linalg.norm(there - here)
        normal = normal if normal @ (here - middle) > 0 else -normal
        margins.append((points - here) @ normal)
    return np.max(margins, axis=0)


def field_margins(device, parts):
    """How far directions are beyond the worst edge of a device's field, and beyond its corners.

    Args:
        device: with a field of view.
        parts: (3, k) along the boresight, along up x boresight, and along up.

    Returns:
        (k,) rad each; the first is below zero inside, the second counts from the boresight.
    """
    forward, *across = parts
    half = np.asarray(device.field_of_view) / 2
    beyond = [
        np.hypot(side, forward) * np.sin(sign * np.arctan2(side, forward) - angle)
        for side, angle in zip(across, half, strict=True)
        for sign in (1, -1)
    ]
    corner = np.arctan(np.hypot(*np.tan(half)))
    return np.arcsin(np.clip(np.max(beyond, axis=0), -1, 1)), np.arccos(np.clip(forward, -1, 1)) - corner


def _stated_margin(craft, zone, attitudes, joints, time):
    """(k,) margin to one zone, of what it binds that is worst."""
    if isinstance(zone, JointBound):
        yaw, pitch = joints[:, own_joints(craft, zone.device)].T
        return zone.normal[0] * yaw + zone.normal[1] * pitch - zone.least
    turn = Rotation.from_matrix(attitudes)
    if zone.axis_device is not None:
        axis = in_body(craft, zone.axis_device, joints)
    elif zone.axis_body is not None:
        axis = np.tile(np.asarray(zone.axis_body), (len(joints), 1))
    elif isinstance(zone.direction, DirectionPath):
        axis = turn.inv().apply(seen(zone.direction, time))
    else:
        axis = turn.inv().apply(np.asarray(zone.direction))
    inside = isinstance(zone, KeepIn)
    if (zone.inside if inside else zone.outside) is not None:
        names = zone.devices or [one.name for one in craft.devices if one.field_of_view is not None]
        found = [stated_field_margin(craft, name, joints, axis, inside) for name in names]
        return np.min(found, axis=0) - zone.half_angle
    names = zone.devices if zone.devices or zone.vectors else craft.device_names
    bound = [in_body(craft, name, joints) for name in names]
    bound += [in_body(craft, vector.to, joints, vector.along) for vector in zone.vectors]
    apart = angle(np.array(bound), axis)
    return np.min(zone.half_angle - apart if inside else apart - zone.half_angle, axis=0)


def stated_field_margin(craft, name, joints, toward, inside):
    """(k,) rad by which directions (k, 3), body axes, are beyond a field, or inside, as margins count it."""
    ahead, _, up = field_axes(craft, name, joints)
    parts = [np.sum(toward * own, axis=1) for own in (ahead, np.cross(up, ahead), up)]
    device = next(one for one in craft.devices if one.name == name)
    beyond, far = field_margins(device, parts)
    return -beyond if inside else np.maximum(beyond, far)


def field_axes(craft, name, joints):
    """Boresight, the direction across up, and up of a device's field, (k, 3) each, body axes."""
    device = next(one for one in craft.devices if one.name == name)
    ahead, left, up = (in_body(craft, name, joints, axis) for axis in np.eye(3))
    if isinstance(device, Terminal) and device.up is not None:
        up = in_body(craft, name, joints, device.up)
        left = np.cross(up, ahead)
    return ahead, left, up


# Devices, from what is said of each.


def own_joints(craft, name):
    """Numbers of the joints of a device: yaw and pitch of a terminal, the angle of a drive."""
    terminals, drives = ([one.name for one in own] for own in (craft.terminals, craft.drives))
    if name in terminals:
        return [terminals.index(name), len(terminals) + terminals.index(name)]
    return [2 * len(terminals) + drives.index(name)] if name in drives else []


def mounting(device):
    """(3, 3) body from the axes of a device at zero angles: boresight, left, up."""
    if isinstance(device, Terminal) and device.mounting is None:
        return Rotation.from_euler("z", device.mount).as_matrix()
    ahead, up = (
        (device.mounting.boresight, device.mounting.yaw_axis)
        if isinstance(device, Terminal)
        else (device.boresight, device.axis if isinstance(device, Drive) else device.up)
    )
    left = unit(np.cross(up, ahead))
    return np.stack([ahead, left, np.cross(ahead, left)], axis=1)


def in_body(craft, name, joints, along=(1.0, 0.0, 0.0)):
    """(k, 3) body axes: a vector in the axes of a device, at joints (k, J); of no device, one of the body."""
    if name is None:
        return np.tile(along, (len(joints), 1))
    device = next(one for one in craft.devices if one.name == name)
    own = joints[:, own_joints(craft, name)]
    if isinstance(device, Instrument):
        vector = device.boresight if tuple(along) == (1.0, 0.0, 0.0) else mounting(device) @ along
        return np.tile(vector, (len(joints), 1))
    if isinstance(device, Drive):
        return Rotation.from_rotvec(own * device.axis).apply(mounting(device) @ along)
    turned = Rotation.from_euler("ZY", own * [1, -1]).apply(along)
    return turned @ mounting(device).T


def field_distance(craft, name, joints, toward):
    """(k,) rad from the rectangular field of a device to directions (k, 3), body axes; below zero inside.

    Outside it is the arc to the nearest point of the four edges, which are arcs of great circles.
    """
    device = next(one for one in craft.devices if one.name == name)
    ahead, left, up = field_axes(craft, name, joints)
    across, along = np.tan(np.asarray(device.field_of_view) / 2)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    corners = np.array([unit(ahead + a * across * left + b * along * up) for a, b in signs])
    nearest, inward = np.full(len(joints), np.inf), np.full(len(joints), np.inf)
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = unit(np.cross(one, other))  # inward, as the corners go round to the left
        height = np.sum(normal * toward, axis=1)
        between = (np.sum(np.cross(normal, one) * toward, axis=1) > 0) & (
            np.sum(np.cross(other, normal) * toward, axis=1) > 0
        )
        arc = np.abs(np.arcsin(np.clip(height, -1, 1)))
        ends = np.minimum(angle(one, toward), angle(other, toward))
        nearest = np.minimum(nearest, np.where(between, arc, ends))
        inward = np.minimum(inward, height)
    return np.where(inward > 0, -nearest, nearest)


def mask_margin(corners, yaw_pitch, yaws=(-np.inf, np.inf)):
    """(k,) rad by which (yaw, pitch) is beyond the edge of a convex polygon, as met again every turn.

    What is beyond the range of yaws cannot be met.
    """
    middle, least = np.mean(corners, axis=0), np.full(len(yaw_pitch), np.inf)
    for turn in range(-3, 4):
        first, last = (end(corners[:, 0]) + 2 * np.pi * turn for end in (np.min, np.max))
        if first > yaws[1] or last < yaws[0]:
            continue
        beyond = np.full(len(yaw_pitch), -np.inf)
        for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            normal = np.array([other[1] - one[1], one[0] - other[0]]) / np.linalg.norm(other - one)
            normal *= -np.sign(normal @ (middle - one))
            beyond = np.maximum(beyond, (yaw_pitch - one - [2 * np.pi * turn, 0]) @ normal)
        least = np.minimum(least, beyond)
    return least
