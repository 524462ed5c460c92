"""Directions that move in closed form, and by the definition of a path in scipy; a scene in low orbit."""

from pathlib import Path

import numpy as np
from manoeuvres import boresights_of
from scipy.interpolate import CubicSpline

from jaxplan.model.directions import DirectionPath
from jaxplan.model.zones import KeepOut

LOW_ORBIT = Path(__file__).parent / "scenarios" / "low_orbit.toml"


def great_circle(first, toward, rate, time):
    """Directions (k, 3) of a turn at a steady rate from one direction toward another."""
    across = toward - (toward @ first) * first
    across /= np.linalg.norm(across)
    angle = np.multiply.outer(time, rate)[..., None]
    return np.cos(angle) * first + np.sin(angle) * across


def turning(rng, rate, times):
    """A path that turns at a steady rate, sampled at some times."""
    first, toward = rng.normal(size=(2, 3))
    return DirectionPath.through(times, great_circle(first / np.linalg.norm(first), toward, rate, times))


def wandering(rng, duration, samples, step):
    """A path through random directions, each about a step off the one before."""
    steps = np.cumsum(step * rng.normal(size=(samples, 3)), axis=0) + 2 * rng.normal(size=3)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    times = duration * (np.arange(samples) + rng.uniform(-0.3, 0.3, samples)) / (samples - 1)
    times[[0, -1]] = 0.0, duration
    return DirectionPath.through(times, directions)


def seen(path, time):
    """Directions (k, 3) by the definition of a path."""
    value = CubicSpline(path.times, path.samples)(time)
    return value / np.linalg.norm(value, axis=-1, keepdims=True)


def beams(craft, attitude, joints):
    """Directions (..., n, 3) of the terminals, inertial, by equation (13)."""
    yaw, pitch = np.split(joints, 2, axis=-1)
    azimuth = yaw + np.array([terminal.mount for terminal in craft.terminals])
    body = np.stack(
        [np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), np.sin(pitch)], axis=-1
    )
    return body @ np.swapaxes(attitude, -1, -2)


def sampled(trajectory, spacecraft, zones, count=6_001):
    """Margin (zones, k) of each zone's worst device, zones where they are at each instant."""
    time = np.linspace(0, trajectory.duration, count)
    boresights = boresights_of(trajectory, spacecraft, time)
    rows = []
    for zone in zones:
        moving = isinstance(zone.direction, DirectionPath)
        axis = seen(zone.direction, time)[:, None] if moving else np.broadcast_to(zone.direction, (1, 1, 3))
        sine = np.linalg.norm(np.cross(boresights, axis), axis=-1)
        clear = np.arctan2(sine, np.sum(boresights * axis, axis=-1)) - zone.half_angle
        names = zone.devices or spacecraft.device_names
        bound = [name in names for name in spacecraft.device_names]
        rows.append(np.min((clear if isinstance(zone, KeepOut) else -clear)[:, bound], axis=1))
    return np.array(rows)
