"""A certified plan for the tests of exports, with no symmetry, and its motion by scipy and by differences."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from builders import at_rest
from manoeuvres import craft, manoeuvre
from reference import attitudes_of, boresights_of, joints_of, spin_of
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner import Plan
from jaxplan.trajectory import Trajectory

DURATION = 30.0
EPOCH = "2026-03-01T06:30:15.25"
# The last entries of NAIF's leap second kernel, and its three constants.
LEAP_SECONDS = """
DELTET/DELTA_T_A = 32.184
DELTET/K = 1.657D-3
DELTET/EB = 1.671D-2
DELTET/M = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT = ( 35, @2012-JUL-1, 36, @2015-JUL-1, 37, @2017-JAN-1 )
"""


def flown_plan(seed: int = 3, terminals: int = 2, duration: float = DURATION) -> Plan:
    """A random manoeuvre about no axis in particular, as a plan."""
    trajectory = manoeuvre(seed, terminals=terminals, duration=duration, step=0.9)
    times = np.array([0.0, duration])
    attitudes = attitudes_of(trajectory, times)
    joints = joints_of(trajectory, times)[0]
    vectors = Rotation.from_matrix(attitudes).as_rotvec()
    start, goal = (at_rest(vector, angles) for vector, angles in zip(vectors, joints, strict=True))
    scenario = Scenario(
        name="an odd slew: 3 %, \u03c0", spacecraft=craft(terminals, 1), start=start, goal=goal
    )
    turn = Rotation.from_matrix(attitudes[0].T @ attitudes[1]).magnitude()
    found = Goal(attitude=attitudes[1], joints=joints[1], slew_angle=turn)
    return Plan(scenario=scenario, status=Status.OK, goal=found, trajectory=trajectory)


@dataclass(frozen=True)
class Truth:
    """What a file must say, by other means than the package's.

    Attributes:
        attitude: (k, 3, 3) body to inertial.
        rate: (k, 3) rad/s, body axes.
        acceleration: (k, 3) rad/s^2, body axes.
        joints: (3, k, 2n) angles, rates, accelerations.
        boresights: (k, devices, 3) inertial.
    """

    attitude: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    joints: np.ndarray
    boresights: np.ndarray


def truth(plan: Plan, times: np.ndarray) -> Truth:
    """The plan's motion at times."""
    trajectory: Trajectory = plan.trajectory
    rate, acceleration, _ = spin_of(trajectory, times)
    return Truth(
        attitude=attitudes_of(trajectory, times),
        rate=rate,
        acceleration=acceleration,
        joints=joints_of(trajectory, times),
        boresights=boresights_of(trajectory, plan.scenario.spacecraft, times),
    )


def differences(attitude: np.ndarray, step: float) -> np.ndarray:
    """(k - 2, 3) rad/s: angular velocities in body axes by central differences of (k, 3, 3) attitudes."""
    turned = Rotation.from_matrix(np.swapaxes(attitude[1:-1], 1, 2) @ attitude[2:]).as_rotvec()
    behind = Rotation.from_matrix(np.swapaxes(attitude[1:-1], 1, 2) @ attitude[:-2]).as_rotvec()
    return (turned - behind) / (2 * step)


def load(folder: Path) -> float:
    """Load an export and a leap second kernel; SPICE's own time of the epoch."""
    import spiceypy as spice

    for file in sorted(folder.iterdir()):
        spice.furnsh(str(file))
    spice.lmpool(LEAP_SECONDS.split("\n")[1:-1])
    return spice.str2et(EPOCH)
