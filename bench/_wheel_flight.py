"""Basilisk's side of flights with wheels: a rigid body that its own wheel array and its own controller turn.

The hub has no gravity. ``waypointReference`` reads the plan as ``jaxplan.export(format="basilisk")`` wrote
it, ``mrpFeedback`` with ``attTrackingError`` asks for a torque, ``rwMotorTorque`` shares it out by the
pseudo-inverse, and ``reactionWheelStateEffector`` gives it, balanced, without friction, within the limits of
torque and speed of each wheel. The controller sees ``simpleNav`` with errors that walk at random within
bounds, and the speeds of the wheels; it knows the inertia as it is thought to be, not as it is.

``inertia`` is the whole spacecraft with wheels locked, as in jaxplan; so is Basilisk's hub, from which its
balanced wheels take their spin inertias off. A wheel's momentum is its spin inertia times its speed relative
to the hub, in both.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _basilisk import mrp, vehicle, waypoints
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, mrpFeedback, rwMotorTorque
from Basilisk.simulation import reactionWheelStateEffector, simpleNav, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
from scipy.spatial.transform import Rotation

SPEED = 6000 * macros.RPM  # rad/s, of a wheel that holds as much momentum as it can
_WALK = 0.5  # step of the navigation's errors, as a share of their bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Craft:
    """The spacecraft as it is, and as its controller is designed.

    Attributes:
        inertia: (3, 3) kg m^2, as it is.
        thought: (3, 3) kg m^2, as the controller has it.
        axes: (n, 3) of the wheels, body axes.
        torque: (n,) N m, the most that each wheel gives.
        momentum: (n,) N m s, the most that each holds.
        frequency: rad/s, of the closed loop about the axis of the largest inertia.
        damping: as a share of critical.
        step: s, of the controller and of the integration.
    """

    inertia: np.ndarray
    thought: np.ndarray
    axes: np.ndarray
    torque: np.ndarray
    momentum: np.ndarray
    frequency: float
    damping: float
    step: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """The state that a flight starts in, and what its controller sees of it.

    Attributes:
        attitude: (3,) rotation vector, rad, body to inertial.
        rate: (3,) rad/s.
        stored: (n,) N m s of the wheels.
        attitude_noise: rad, the bound about each axis.
        rate_noise: rad/s, likewise.
        seed: of the noise.
    """

    attitude: np.ndarray
    rate: np.ndarray
    stored: np.ndarray
    attitude_noise: float
    rate_noise: float
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """A flight as it was, at k instants.

    Attributes:
        times: (k,) s.
        reference: (k, 3, 3) body to inertial, that was asked for.
        attitude: (k, 3, 3) that was flown.
        rate: (k, 3) rad/s.
        commanded: (k, n) N m that was asked of the wheels, positive where it speeds them up.
        given: (k, n) N m that their motors gave.
        momentum: (k, n) N m s that they held.
    """

    times: np.ndarray
    reference: np.ndarray
    attitude: np.ndarray
    rate: np.ndarray
    commanded: np.ndarray
    given: np.ndarray
    momentum: np.ndarray


def fly(craft: Craft, start: Start, file: Path, seconds: float) -> Flown:
    """Fly a file of waypoints for some seconds."""
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(craft.step)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    body = spacecraft.Spacecraft()
    body.hub.mHub = 500.0
    body.hub.IHubPntBc_B = craft.inertia.tolist()
    body.hub.sigma_BNInit, body.hub.omega_BN_BInit = mrp(start.attitude), start.rate.tolist()
    spin = craft.momentum / SPEED  # kg m^2
    built, wheels = simIncludeRW.rwFactory(), reactionWheelStateEffector.ReactionWheelStateEffector()
    for number, axis in enumerate(craft.axes):
        built.create(
            "custom",
            axis.tolist(),
            Js=float(spin[number]),
            Omega=float(start.stored[number] / spin[number] / macros.RPM),
            Omega_max=float(SPEED / macros.RPM),
            u_max=float(craft.torque[number]),
            RWModel=messaging.BalancedWheels,
        )
    built.addToSpacecraft("wheels", wheels, body)
    navigation = _navigation(start)
    navigation.scStateInMsg.subscribeTo(body.scStateOutMsg)
    reference, error = waypoints(file), attTrackingError.attTrackingError()
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
    control, motors = mrpFeedback.mrpFeedback(), rwMotorTorque.rwMotorTorque()
    array = built.getConfigMessage()
    # The controller adds what the wheels hold for turning with the hub, so its own inertia is without that.
    config = vehicle(craft.thought - np.einsum("k,ki,kj->ij", spin, craft.axes, craft.axes))
    control.guidInMsg.subscribeTo(error.attGuidOutMsg)
    control.vehConfigInMsg.subscribeTo(config)
    control.rwParamsInMsg.subscribeTo(array)
    control.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    largest = float(np.linalg.norm(craft.thought, 2))
    control.K, control.Ki = 4 * largest * craft.frequency**2, -1.0
    control.P = 2 * craft.damping * largest * craft.frequency
    motors.controlAxes_B = np.eye(3).ravel().tolist()
    motors.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
    motors.rwParamsInMsg.subscribeTo(array)
    wheels.rwMotorCmdInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
    asked, state = reference.attRefOutMsg.recorder(), body.scStateOutMsg.recorder()
    commanded, speeds = motors.rwMotorTorqueOutMsg.recorder(), wheels.rwSpeedOutMsg.recorder()
    given = [message.recorder() for message in wheels.rwOutMsgs]
    # The body comes first: at each instant the controller sees the state of that instant.
    for module in (body, navigation, reference, error, control, motors, wheels):
        simulation.AddModelToTask("task", module)
    for recorder in (asked, state, commanded, speeds, *given):
        simulation.AddModelToTask("task", recorder)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(seconds))
    simulation.ExecuteSimulation()
    count = len(craft.axes)
    return Flown(
        times=asked.times() * macros.NANO2SEC,
        reference=Rotation.from_mrp(asked.sigma_RN).as_matrix(),
        attitude=Rotation.from_mrp(state.sigma_BN).as_matrix(),
        rate=np.array(state.omega_BN_B),
        commanded=np.array(commanded.motorTorque)[:, :count],
        given=np.stack([wheel.u_current for wheel in given], axis=1),
        momentum=np.array(speeds.wheelSpeeds)[:, :count] * spin,
    )


def _navigation(start: Start) -> simpleNav.SimpleNav:
    """Navigation with the start's errors of attitude and rate."""
    module = simpleNav.SimpleNav()
    module.ModelTag = "navigation"
    bounds = np.zeros(18)
    bounds[6:9], bounds[9:12] = start.attitude_noise / 4, start.rate_noise  # an MRP is a quarter of the angle
    module.PMatrix, module.walkBounds = np.diag(_WALK * bounds).tolist(), bounds[:, None].tolist()
    module.RNGSeed = start.seed
    return module
