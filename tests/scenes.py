"""Scenarios that the tests build by themselves, with any number of devices."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario, SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.search import Scene, make_scene


def make_spacecraft(terminals: int = 3, instruments: int = 0) -> Spacecraft:
    """The paper's limits, with terminals evenly around the z axis and instruments spread over the body."""
    rng = np.random.default_rng(7)
    mounts = np.deg2rad([0.0, 120.0, -120.0]) if terminals == 3 else 2 * np.pi * np.arange(terminals) / 16
    axes = rng.standard_normal((instruments, 3))
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"terminal-{i + 1}",
                mount=float(mounts[i]),
                yaw_limit=np.pi / 2,
                pitch_limit=np.pi / 12,
                rate_limit=np.deg2rad(4.0),
                acceleration_limit=np.deg2rad(3.0),
            )
            for i in range(terminals)
        ),
        instruments=tuple(
            Instrument(name=f"camera-{i + 1}", boresight=axis / np.linalg.norm(axis))
            for i, axis in enumerate(axes)
        ),
        rate_limit=np.deg2rad(3.0),
        acceleration_limit=np.deg2rad(2.0),
    )


def make_scenario(
    terminals: int = 3,
    instruments: int = 0,
    *,
    keep_out: tuple[KeepOut, ...] = (),
    keep_in: tuple[KeepIn, ...] = (),
    turn: tuple[float, float, float] = (0.3, -0.5, 0.4),
    seed: int = 0,
) -> Scenario:
    """A scenario with a given goal, ``turn`` away from a random start."""
    rng = np.random.default_rng(seed)
    craft = make_spacecraft(terminals, instruments)
    limits = craft.joint_limits
    start = Rotation.random(rng=rng)
    states = [
        GivenState(
            rotation_vector=attitude.as_rotvec(),
            joints=rng.uniform(-0.9, 0.9, 2 * terminals) * limits,
            angular_velocity=np.zeros(3),
            joint_rates=np.zeros(2 * terminals),
        )
        for attitude in (start, start * Rotation.from_rotvec(turn))
    ]
    return Scenario(
        name="test",
        spacecraft=craft,
        start=states[0],
        goal=states[1],
        keep_out=keep_out,
        keep_in=keep_in,
        search=SearchSettings(),
        trajectory=TrajectorySettings(),
    )


def scene_of(scenario: Scenario, goal: Goal | None = None) -> Scene:
    """The search problem of a scenario whose goal is given."""
    start = Rotation.from_rotvec(scenario.start.rotation_vector)
    if goal is None:
        end = Rotation.from_rotvec(scenario.goal.rotation_vector)
        slew = (start.inv() * end).magnitude()
        goal = Goal(attitude=end.as_matrix(), joints=scenario.goal.joints, slew_angle=slew)
    return make_scene(scenario, goal)


def with_search(scenario: Scenario, **changes: object) -> Scenario:
    """The scenario with other search settings."""
    return replace(scenario, search=replace(scenario.search, **changes))


def boresights(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(k, devices, 3) inertial directions, in plain numpy by equation (13)."""
    count = len(scene.mounts)
    yaw, pitch = joints[:, :count] + scene.mounts, joints[:, count:]
    moving = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
    fixed = np.broadcast_to(scene.fixed_boresights, (len(joints), *scene.fixed_boresights.shape))
    return np.einsum("kij,kdj->kdi", attitudes, np.concatenate([moving, fixed], axis=1))


def sampled_margin(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(k,) rad: smallest margin over zones and groups at each state, in plain numpy."""
    directions = boresights(scene, attitudes, joints)
    worst = np.full(len(joints), np.inf)
    for cones in (scene.cones, scene.grouped_cones):
        cosines = np.clip(np.einsum("kdi,zi->kzd", directions, cones.axis), -1, 1)
        margin = cones.side[:, None] * (np.arccos(cosines) - cones.half_angle[:, None])
        zone = np.where(cones.bound, margin, np.inf).min(axis=-1, initial=np.inf)
        for group in np.unique(cones.group):
            worst = np.minimum(worst, zone[:, cones.group == group].max(axis=1))
    return worst


def edge_states(
    attitude: np.ndarray, joints: np.ndarray, end_attitude: np.ndarray, end_joints: np.ndarray, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """States along the motion between two nodes, by scipy."""
    start = Rotation.from_matrix(np.array(attitude))  # scipy wants writable arrays
    turn = (start.inv() * Rotation.from_matrix(np.array(end_attitude))).as_rotvec()
    fraction = np.linspace(0, 1, samples)[:, None]
    path = joints + fraction * (end_joints - joints).reshape(1, -1)
    return (start * Rotation.from_rotvec(fraction * turn)).as_matrix(), path
