"""A certified plan for the tests of exports, with no symmetry, and its motion by scipy and by differences.

A day is several of them in a row.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from builders import at_rest
from manoeuvres import craft, manoeuvre
from reference import attitudes_of, boresights_of, joints_of, spin_of
from scipy.spatial.transform import Rotation

import jaxplan as jp
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
    return as_plan(manoeuvre(seed, terminals=terminals, duration=duration, step=0.9))


def as_plan(trajectory: Trajectory) -> Plan:
    """A trajectory from rest to rest as the plan that it would be of."""
    terminals = trajectory.joint_coefficients.shape[-1] // 2
    times = trajectory.breaks[[0, -1]]
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


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part of a day."""

    name: str
    kind: str
    start: float
    end: float

    @property
    def shown(self) -> str:
        """The name in files of ASCII."""
        return self.name.replace("\u03b1", "?")


@dataclass(frozen=True, kw_only=True)
class FlownDay:
    """Certified plans in a row, each beginning where the one before ends, with what exports ask of a day."""

    ok: bool
    scene: Scenario
    trajectory: Trajectory
    segments: tuple[Part, ...]
    plans: tuple[Plan, ...]

    def certify(self) -> SimpleNamespace:
        """Prove each of the plans."""
        proofs = [jp.certify(plan) for plan in self.plans]
        faults = [fault for proof in proofs for fault in proof.faults]
        return SimpleNamespace(certified=all(proof.certified for proof in proofs), faults=faults)


def flown_day(
    durations: tuple[float, ...] = (30.0, 900.0, 0.0, 45.0, 300.0, 25.0),
    epoch: str | None = EPOCH,
    terminals: int = 2,
) -> FlownDay:
    """Slews and slow tracks by turns, with an activity that takes no time, as a day."""
    parts, plans, pieces, reached = [], [], [], 0.0
    attitude, joints = np.eye(3), np.zeros(2 * terminals)
    for number, duration in enumerate(durations):
        kind = "track" if duration > 100 else "slew"
        parts.append(Part(name=f"{kind} {number}, \u03b1", kind=kind, start=reached, end=reached + duration))
        if not duration:
            continue
        step = 0.9 if kind == "slew" else 0.4
        own = manoeuvre(number, terminals=terminals, duration=duration, step=step)
        begin, angles = attitudes_of(own, np.zeros(1))[0], joints_of(own, np.zeros(1))[0, 0]
        coefficients = own.joint_coefficients.copy()
        coefficients[:, 0] += joints - angles
        turned = attitude @ begin.T @ own.chart_attitude
        own = replace(own, chart_attitude=turned, joint_coefficients=coefficients)
        plans.append(as_plan(own))
        pieces.append((reached, own))
        end = np.array([duration])
        attitude, joints, reached = attitudes_of(own, end)[0], joints_of(own, end)[0, 0], reached + duration
    scene = plans[0].scenario
    if epoch is not None:
        scene = replace(scene, epoch=np.datetime64(epoch, "ns"))
    return FlownDay(
        ok=True, scene=scene, trajectory=in_a_row(pieces), segments=tuple(parts), plans=tuple(plans)
    )


def in_a_row(pieces: list[tuple[float, Trajectory]]) -> Trajectory:
    """One trajectory of several, each with the time at which it begins."""
    first = pieces[0][1]

    def moved(name: str, drop: int) -> np.ndarray:
        arrays = [getattr(one, name)[drop * bool(k) :] + start for k, (start, one) in enumerate(pieces)]
        return np.concatenate(arrays)

    def stacked(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for _, one in pieces])

    return replace(
        first,
        breaks=moved("breaks", 1),
        chart_start=moved("chart_start", 0),
        joint_breaks=moved("joint_breaks", 1),
        node_times=moved("node_times", 1),
        **{name: stacked(name) for name in ("chart_attitude", "chart_rate", "coefficients")},
        joint_coefficients=stacked("joint_coefficients"),
    )


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


def truth(plan: Plan | FlownDay, times: np.ndarray) -> Truth:
    """The motion of a plan or a day at times."""
    trajectory: Trajectory = plan.trajectory
    scene = plan.scenario if isinstance(plan, Plan) else plan.scene
    rate, acceleration, _ = spin_of(trajectory, times)
    return Truth(
        attitude=attitudes_of(trajectory, times),
        rate=rate,
        acceleration=acceleration,
        joints=joints_of(trajectory, times),
        boresights=boresights_of(trajectory, scene.spacecraft, times),
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
