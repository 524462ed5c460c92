"""Basilisk's side of `basilisk_compare.py`: its planner, and a rigid body that flies a reference.

The body is a hub without gravity in closed loop, steered by ``mrpFeedback`` with perfect navigation.
Attitudes are (k, 3, 3) body to inertial, which are the rotations of its ``sigma_BN``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from Basilisk.architecture import bskLogging, messaging
from Basilisk.fswAlgorithms import (
    attTrackingError,
    constrainedAttitudeManeuver,
    mrpFeedback,
    waypointReference,
)
from Basilisk.simulation import extForceTorque, simpleNav, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros
from scipy.spatial.transform import Rotation

bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)

STEP = 0.1  # s, of the controller and of the integration
FAR = 1e11  # m, to the body that the cone is about
FREQUENCY, DAMPING = 0.3, 1.0  # of the closed loop about each axis, rad/s and as a share of critical
_STILL = 1e-9  # rad from the last attitude of a reference, within which it has arrived
_GRID = 8  # size of the grid of the planner's nodes, as in its documentation's example


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A slew of one instrument beside one cone.

    Attributes:
        inertia: (3, 3) kg m^2.
        start: (3,) rotation vector, rad, body to inertial.
        goal: (3,) likewise.
        boresight: (3,) body axes.
        direction: (3,) inertial, of the cone.
        half_angle: rad.
    """

    inertia: np.ndarray
    start: np.ndarray
    goal: np.ndarray
    boresight: np.ndarray
    direction: np.ndarray
    half_angle: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """A flight in closed loop.

    Attributes:
        times: (k,) s.
        reference: (k, 3, 3) that was asked for.
        attitude: (k, 3, 3) that was flown.
        torque: (k, 3) N m, commanded, body axes.
    """

    times: np.ndarray
    reference: np.ndarray
    attitude: np.ndarray
    torque: np.ndarray

    @property
    def slew_time(self) -> float:
        """Time at which the reference arrives at its last attitude, s."""
        away = Rotation.from_matrix(self.reference[-1].T @ self.reference).magnitude()
        moving = np.flatnonzero(away > _STILL)
        return float(self.times[moving[-1] + 1]) if len(moving) else 0.0

    def error(self) -> np.ndarray:
        """Angles (k,) rad between the reference and the attitude that is flown."""
        between = np.swapaxes(self.reference, 1, 2) @ self.attitude
        return Rotation.from_matrix(between).magnitude()


def fly_waypoints(task: Task, file: Path, seconds: float) -> Flown:
    """Fly a file of waypoints, as ``jaxplan.export(format="basilisk")`` writes it, for some seconds."""
    return _fly(task, waypoints(file), seconds)


def fly_own_plan(task: Task, average_rate: float, spline: int, seconds: float) -> Flown:
    """Fly what Basilisk plans.

    Args:
        task: the slew.
        average_rate: rad/s, which says how long it takes.
        spline: 0 for one through the nodes, 1 for one near them.
        seconds: s, how long to fly.
    """
    module = constrainedAttitudeManeuver.ConstrainedAttitudeManeuver(_GRID)
    module.ModelTag = "constrainedAttitudeManeuver"
    # These are not set by its constructor.
    module.constraints.keepIn = module.constraints.keepOut = False
    module.boresights.keepInBoresightCount = module.boresights.keepOutBoresightCount = 0
    module.sigma_BN_goal, module.omega_BN_B_goal = mrp(task.goal), [0.0, 0.0, 0.0]
    module.avgOmega, module.BSplineType, module.costFcnType = average_rate, spline, 0
    module.appendKeepOutDirection(task.boresight.tolist(), task.half_angle)
    state, body = messaging.SCStatesMsgPayload(), messaging.SpicePlanetStateMsgPayload()
    state.sigma_BN, body.PositionVector = mrp(task.start), (FAR * task.direction).tolist()
    start, config = messaging.SCStatesMsg().write(state), vehicle(task.inertia)
    avoided, seen = messaging.SpicePlanetStateMsg().write(body), messaging.SpicePlanetStateMsg()
    module.scStateInMsg.subscribeTo(start)
    module.vehicleConfigInMsg.subscribeTo(config)
    module.keepOutCelBodyInMsg.subscribeTo(avoided)
    module.keepInCelBodyInMsg.subscribeTo(seen)  # there is nothing to keep in sight, but it is asked
    return _fly(task, module, seconds)


def waypoints(file: Path) -> Any:
    """Basilisk's module that reads such a file."""
    module = waypointReference.WaypointReference()
    module.ModelTag = "waypointReference"
    module.dataFileName, module.attitudeType, module.delimiter = str(file), 1, ","
    module.useReferenceFrame = False
    return module


def _fly(task: Task, reference: Any, seconds: float) -> Flown:
    """Fly the reference of a module with ``attRefOutMsg`` from the task's start, for some seconds."""
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(STEP)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 500.0
    craft.hub.IHubPntBc_B = task.inertia.tolist()
    craft.hub.sigma_BNInit, craft.hub.omega_BN_BInit = mrp(task.start), [0.0, 0.0, 0.0]
    torque, navigation = extForceTorque.ExtForceTorque(), simpleNav.SimpleNav()
    craft.addDynamicEffector(torque)
    navigation.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    error, control = attTrackingError.attTrackingError(), mrpFeedback.mrpFeedback()
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
    config = vehicle(task.inertia)
    control.guidInMsg.subscribeTo(error.attGuidOutMsg)
    control.vehConfigInMsg.subscribeTo(config)
    largest = float(np.linalg.norm(task.inertia, 2))
    # J phi'' + P phi' + K phi / 4 = 0 for small angles, sigma being a quarter of the angle
    control.K, control.P, control.Ki = 4 * largest * FREQUENCY**2, 2 * DAMPING * largest * FREQUENCY, -1.0
    torque.cmdTorqueInMsg.subscribeTo(control.cmdTorqueOutMsg)
    asked, flown = reference.attRefOutMsg.recorder(), navigation.attOutMsg.recorder()
    commanded = control.cmdTorqueOutMsg.recorder()
    for module in (reference, navigation, error, control, torque, craft, asked, flown, commanded):
        simulation.AddModelToTask("task", module)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(seconds))
    simulation.ExecuteSimulation()
    return Flown(
        times=asked.times() * macros.NANO2SEC,
        reference=Rotation.from_mrp(asked.sigma_RN).as_matrix(),
        attitude=Rotation.from_mrp(flown.sigma_BN).as_matrix(),
        torque=np.array(commanded.torqueRequestBody),
    )


def mrp(rotation_vector: np.ndarray) -> list[float]:
    """Modified Rodrigues parameters of a rotation vector (3,) rad."""
    return Rotation.from_rotvec(rotation_vector).as_mrp().tolist()


def vehicle(inertia: np.ndarray) -> Any:
    """Basilisk's message of the vehicle's inertia (3, 3) kg m^2."""
    config = messaging.VehicleConfigMsgPayload()
    config.ISCPntB_B = inertia.ravel().tolist()
    return messaging.VehicleConfigMsg().write(config)
