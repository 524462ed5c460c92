"""Random scenarios of every sort: 0 to 12 terminals, 0 to 3 instruments, 0 to 64 zones, every method.

Most can be flown: zones keep clear of start and goal, targets are what the devices see from some state. A few
cannot, by chance or on purpose. Numbers of devices come in `SHAPES` and zones fill a few sizes, since every
combination is compiled once.
"""

import numpy as np
from reference import boresights
from scipy.spatial.transform import Rotation

from jaxplan.model.devices import Instrument, Terminal
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import MINIMUM, STRETCHED, Scenario, SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut

# Terminals and instruments.
SHAPES = (
    *((0, 1), (0, 3), (1, 0), (1, 2), (2, 1), (3, 0), (3, 2), (4, 1)),
    *((5, 0), (6, 2), (7, 0), (8, 1), (9, 0), (10, 3), (11, 1), (12, 0)),
)
ZONES = ((0, 0), (1, 8), (9, 16), (17, 32), (33, 64))  # least and most of each size
HOW_OFTEN = (0.15, 0.4, 0.25, 0.12, 0.08)
BEYOND = np.deg2rad(1.0)  # that start and goal keep from zones


def mixed_scenario(seed: int, shape: tuple[int, int] | None = None, most_zones: int = 64) -> Scenario:
    """The scenario of a seed.

    Args:
        seed: 0 or more.
        shape: terminals and instruments; drawn if there is none.
        most_zones: of the sizes of which one is drawn.
    """
    rng = _random(seed)
    drawn = _drawn(rng)
    craft = spacecraft(rng, *(drawn if shape is None else shape))
    start, goal = ends(rng, craft)
    chances = np.array(HOW_OFTEN) * [least <= most_zones for least, _ in ZONES]
    least, most = ZONES[rng.choice(len(ZONES), p=chances / chances.sum())]
    seen = np.array([boresights(craft, end.as_matrix(), joints) for end, joints in (start, goal)])
    keep_out, keep_in = zones(rng, craft, seen, int(rng.integers(least, most + 1)))
    return Scenario(
        name=f"mixed {seed}",
        spacecraft=craft,
        start=state(rng, craft, *start),
        goal=wanted(rng, craft, goal, seen[1]),
        keep_out=keep_out,
        keep_in=keep_in,
        search=SearchSettings(
            method=str(rng.choice(["mha"] * 12 + ["mha-paper", "wastar", "rrt_star", "rrt_connect"])),
            attitude_step=float(rng.uniform(0.06, 0.2)),
            joint_step=float(rng.uniform(0.06, 0.2)),
            clearance=float(np.deg2rad(rng.choice([0.0, 0.5, 2.0]))),
            max_expansions=int(rng.choice([20, 150, 400])),
            max_goals=int(rng.integers(1, 4)),
            time_limit=np.inf,
            seed=int(rng.integers(1000)),
        ),
        trajectory=trajectory_settings(rng),
    )


def shape_of(seed: int) -> tuple[int, int]:
    """Terminals and instruments of a seed's scenario."""
    return _drawn(_random(seed))


def _random(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 11])


def _drawn(rng: np.random.Generator) -> tuple[int, int]:
    return SHAPES[rng.integers(len(SHAPES))]


def spacecraft(rng: np.random.Generator, terminals: int, instruments: int) -> Spacecraft:
    """Limits of all sizes; now and then with actuators or a limited jerk."""
    mounts = 2 * np.pi * (np.arange(terminals) + rng.uniform(-0.3, 0.3, terminals)) / max(terminals, 1)
    axes = rng.standard_normal((instruments, 3))
    actuators = {}
    if rng.random() < 0.15:
        actuators["inertia"] = np.diag(rng.uniform(60, 110, 3))
        actuators["torque_limit"] = rng.uniform(0.5, 5, 3)
    if rng.random() < 0.1:
        actuators["jerk_limit"] = float(np.deg2rad(rng.uniform(0.5, 5)))
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"terminal-{i + 1}",
                mount=float(mount),
                yaw_limit=float(np.deg2rad(rng.uniform(50, 179))),
                pitch_limit=float(np.deg2rad(rng.uniform(10, 80))),
                rate_limit=float(np.deg2rad(rng.uniform(1, 8))),
                acceleration_limit=float(np.deg2rad(rng.uniform(0.5, 5))),
            )
            for i, mount in enumerate(mounts)
        ),
        instruments=tuple(
            Instrument(name=f"camera-{i + 1}", boresight=axis / np.linalg.norm(axis))
            for i, axis in enumerate(axes)
        ),
        rate_limit=float(np.deg2rad(rng.uniform(1, 6))),
        acceleration_limit=float(np.deg2rad(rng.uniform(0.3, 4))),
        **actuators,
    )


Place = tuple[Rotation, np.ndarray]


def ends(rng: np.random.Generator, craft: Spacecraft) -> tuple[Place, Place]:
    """Attitude and joints of start and goal, now and then the same."""
    first = Rotation.random(rng=rng)
    limits = craft.joint_ranges[:, 1]
    joints = rng.uniform(-0.85, 0.85, (2, len(limits))) * limits
    axis = rng.standard_normal(3)
    angle = rng.choice(
        [rng.uniform(0.02, 0.5), rng.uniform(0.3, 1.5), rng.uniform(1, np.pi)], p=[0.3, 0.5, 0.2]
    )
    if rng.random() < 0.04:
        return (first, joints[0]), (first, joints[0])
    return (first, joints[0]), (first * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)), joints[1])


def state(rng: np.random.Generator, craft: Spacecraft, attitude: Rotation, joints: np.ndarray) -> GivenState:
    """At rest, as a rule."""
    moving = 0.2 * craft.rate_limit * (rng.random() < 0.05)
    return GivenState(
        rotation_vector=attitude.as_rotvec(),
        joints=joints,
        angular_velocity=moving * rng.uniform(-1, 1, 3),
        joint_rates=np.zeros(len(joints)),
    )


def wanted(
    rng: np.random.Generator, craft: Spacecraft, goal: Place, seen: np.ndarray
) -> Targets | GivenState:
    """The goal as it is, or what its terminals see as targets; a few targets are anywhere."""
    terminals = len(craft.terminals)
    if not terminals or rng.random() < 0.5:
        return state(rng, craft, *goal)
    directions = seen[:terminals]
    if rng.random() < 0.05:
        directions = rng.standard_normal((terminals, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Targets(directions=directions, angular_velocity=np.zeros(3), joint_rates=np.zeros(2 * terminals))


def zones(
    rng: np.random.Generator, craft: Spacecraft, seen: np.ndarray, count: int
) -> tuple[tuple[KeepOut, ...], tuple[KeepIn, ...]]:
    """So many zones, smaller where there are many, most of them clear of what both ends see (2, D, 3)."""
    names = np.array(craft.device_names)
    keep_out, keep_in = [], []
    largest = np.deg2rad(40.0) / np.sqrt(max(count, 1))
    while len(keep_out) + len(keep_in) < count:
        number = len(keep_out) + len(keep_in) + 1
        bound = rng.permutation(len(names))[: rng.integers(1, len(names) + 1)]
        if rng.random() < 0.85:
            direction = rng.standard_normal(3)
            direction /= np.linalg.norm(direction)
            room = np.arccos(np.clip(seen[:, bound] @ direction, -1, 1)).min() - BEYOND
            half_angle = largest * rng.uniform(0.4, 1.5)
            if rng.random() < 0.997:
                half_angle = min(half_angle, room)
            if half_angle > np.deg2rad(1.0):
                devices = tuple(names[bound].tolist())
                keep_out.append(
                    KeepOut(name=f"out-{number}", direction=direction, half_angle=half_angle, devices=devices)
                )
            continue
        device = bound[0]
        direction = seen[:, device].sum(axis=0) + 0.2 * rng.standard_normal(3)
        direction /= max(np.linalg.norm(direction), 1e-9)
        widest = np.arccos(np.clip(seen[:, device] @ direction, -1, 1)).max() + BEYOND
        half_angle = widest + np.deg2rad(rng.uniform(2, 60))
        group = f"group-{rng.integers(3)}" if rng.random() < 0.4 else None
        if half_angle < np.deg2rad(175):
            keep_in.append(
                KeepIn(
                    name=f"in-{number}",
                    direction=direction,
                    half_angle=half_angle,
                    devices=(str(names[device]),),
                    any_of=group,
                )
            )
    return tuple(keep_out), tuple(keep_in)


def trajectory_settings(rng: np.random.Generator) -> TrajectorySettings:
    """Every method and duration; the paper's knows no shortest motion."""
    if rng.random() < 0.2:
        return TrajectorySettings(method="paper", duration=float(rng.uniform(60, 300)))
    duration = rng.choice([STRETCHED] * 6 + [MINIMUM, "given"])
    return TrajectorySettings(
        duration={STRETCHED: STRETCHED, MINIMUM: MINIMUM}.get(str(duration), float(rng.uniform(5, 200))),
        end_acceleration=str(rng.choice(["zero", "zero", "zero", "free"])),
    )
