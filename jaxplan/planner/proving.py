"""Certify the trajectory of a scenario when it is planned, and anew from a file.

`jaxplan.certificate` proves that a trajectory keeps limits and zones and goes from one state to another. That
these states are what the scenario asks for is checked here: the goal meets its targets, and where these move,
it meets their directions and rates when the manoeuvre ends. The check is plain numpy, written so that NaN
counts as a fault, from equation (13) and the derivative of ``p = R u(q)``, ``p' = R (omega x u + u_q q')``,
for the inertial beam ``p`` of a device with joints ``q``, body beam ``u``, attitude ``R`` and angular
velocity ``omega``. It shares no code with what finds goals.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate, Claim, EndState, ProvedMargin, certify_batch, prove_margins
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario, moves
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import hidden_targets
from jaxplan.runtime.arguments import expect
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import refuse_types, take_in
from jaxplan.trajectory import Trajectory

TOLERANCE = 1e-8
"""rad and rad/s: how far a goal may be from what the scenario asks for, a beam from its target; the
certificate allows as much of the ends."""
_TIME_TOLERANCE = 1e-12  # share of the duration by which the goal's time may differ from the trajectory's end


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProofQuery:
    """A trajectory to be certified against its scenario's zones, limits, start and goal.

    Attributes:
        scenario: the problem; its zones and limits must hold.
        goal: where the trajectory must end; it must be what the scenario asks for.
        trajectory: the manoeuvre.
    """

    scenario: Scenario
    goal: Goal
    trajectory: Trajectory


def prove(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> Certificate:
    """Certify one trajectory and its goal, see `ProofQuery`."""
    return prove_batch([ProofQuery(scenario=scenario, goal=goal, trajectory=trajectory)])[0]


def prove_batch(queries: Sequence[ProofQuery]) -> list[Certificate]:
    """Certify many trajectories, those of equal array shapes together; certificates in the same order."""
    certificates = []
    for query, certificate in zip(
        queries, certify_batch([_make_claim(query) for query in queries]), strict=True
    ):
        off = (
            *_goal_faults(query.scenario, query.goal),
            *lasting_faults(query.scenario, query.trajectory.duration),
            *_arrival_faults(query.scenario, query.goal, query.trajectory.duration),
        )
        certified, faults = certificate.certified and not off, (*certificate.faults, *off)
        certificates.append(replace(certificate, certified=certified, faults=faults))
    return certificates


def _make_claim(query: ProofQuery) -> Claim:
    """Return the claim that a trajectory keeps its scenario's limits and zones from start to goal."""
    scenario, goal, start = query.scenario, query.goal, query.scenario.start
    end, craft = end_rates(scenario, goal), scenario.spacecraft
    return Claim(
        trajectory=query.trajectory,
        spacecraft=craft,
        cones=scenario.stated,
        zone_names=_zone_names(scenario),
        sight_names=scenario.sight_names,
        robust=scenario.robust,
        start=EndState(
            attitude=start.attitude,
            joints=start.joints,
            angular_velocity=start.angular_velocity,
            joint_rates=start.joint_rates,
        ),
        goal=EndState(
            attitude=goal.attitude,
            joints=goal.joints,
            angular_velocity=end[0],
            joint_rates=end[1],
        ),
    )


def certify(plan: Plan) -> Certificate:
    """Certify a plan's trajectory anew; nothing in the plan is trusted, not even that its goal fits.

    Args:
        plan: one with a trajectory and a goal.

    Returns:
        The certificate, whose `faults` list what could not be proved.

    Raises:
        TypeError: if `plan` is not a Plan.
        ValueError: if the plan has no trajectory, or no goal.
        ScenarioError: if an attribute of its scenario has the wrong type or shape.

    Example:
        >>> jp.certify(jp.load_plan("plan.json")).certified
        True
    """
    expect("plan", plan, Plan, "jp.plan makes one, jp.load_plan reads one")
    if plan.trajectory is None or plan.goal is None:
        missing = "trajectory" if plan.trajectory is None else "goal"
        raise ValueError(f"the plan of {plan.scenario.name} has no {missing}: it ended as {plan.status.name}")
    refuse_types(plan.scenario)
    certificate = prove(plan.scenario, plan.goal, plan.trajectory)
    return replace(certificate, faults=_restate_cone_faults(plan.scenario, certificate.faults))


def _restate_cone_faults(scenario: Scenario, faults: tuple[str, ...]) -> tuple[str, ...]:
    """Replace a certificate's faults in rows of constraints ("cones....") by those of the scenario's zones.

    They are returned as they are if the scenario's zones show no faults when they are checked.
    """
    others = tuple(fault for fault in faults if not fault.startswith("cones."))
    if len(others) == len(faults):
        return faults
    try:
        take_in(scenario)
    except ScenarioError as error:
        own = tuple(
            fault for fault in error.faults if fault.startswith(("keep_out", "keep_in", "joint_bounds"))
        )
        return (*own, *others) if own else faults
    return faults


def check_margins(plan: Plan) -> tuple[ProvedMargin, ...]:
    """Prove anew how far every device stays from every zone, see `jaxplan.certificate.prove_margins`.

    Args:
        plan: the plan; if it has no trajectory, the result is empty.
    """
    if plan.trajectory is None:
        return ()
    scenario = plan.scenario
    return prove_margins(
        Claim(
            trajectory=plan.trajectory,
            spacecraft=scenario.spacecraft,
            cones=scenario.stated,
            zone_names=_zone_names(scenario),
            sight_names=scenario.sight_names,
            robust=scenario.robust,
        )
    )


def _zone_names(scenario: Scenario) -> list[str]:
    """Return the name of the zone that each row of the scenario's constraints belongs to, without padding."""
    zones = scenario.zones
    return [zones[zone].name for zone in scenario.stated.zone if zone >= 0]


def _goal_faults(scenario: Scenario, goal: Goal) -> Iterator[str]:
    """Yield a sentence for each way in which a goal is not what the scenario asks for.

    NaN counts as a fault. Directions of moving targets are left to `_arrival_faults`.
    """
    asked, attitude, joints = scenario.goal, goal.attitude, goal.joints
    if not abs(so3.distance(scenario.start.attitude, attitude) - goal.slew_angle) <= TOLERANCE:
        yield "the goal's slew angle is not that from the start"
    if isinstance(asked, GivenState):
        if not np.linalg.norm(attitude - asked.attitude) <= TOLERANCE:
            yield "the goal's attitude is not the scenario's"
        if not np.all(np.abs(joints - asked.joints) <= TOLERANCE):
            yield "the goal's joints are not the scenario's"
        return
    terminals = len(scenario.spacecraft.terminals)
    for number, (name, limit) in enumerate((("yaw", asked.yaw_limit), ("pitch", asked.pitch_limit))):
        angles = joints[number * terminals : (number + 1) * terminals]
        if limit is not None and not np.all(np.abs(angles) <= limit + TOLERANCE):
            yield f"a {name} at the goal is beyond goal.{name}_limit_deg = {np.rad2deg(limit):g}"
    names = scenario.spacecraft.joint_names
    held = [number for number, name in enumerate(names) if name.rsplit(" ", 1)[0] in asked.hold]
    if not np.all(np.abs(joints[held] - scenario.start.joints[held]) <= TOLERANCE):
        yield "a device of goal.hold has not kept its joints at the goal"
    if asked.moves:
        return
    spin, rates = np.zeros(3), np.zeros(len(joints))
    beams, _ = _beam_motion(scenario, goal, spin, rates)
    for name, beam, direction in zip(asked.names(scenario.spacecraft), beams, asked.directions, strict=True):
        off = np.linalg.norm(beam - direction)
        if not off <= _target_tolerance(scenario, name):
            yield f"at the goal {name} points {off:.3g} rad off its target"


def _target_tolerance(scenario: Scenario, name: str) -> float:
    """Return by how many rad or rad/s a device may miss its target: a terminal only by `TOLERANCE`.

    Drives and instruments are allowed the goal's tolerance as well.
    """
    of_terminal = any(terminal.name == name for terminal in scenario.spacecraft.terminals)
    return TOLERANCE if of_terminal else TOLERANCE + float(scenario.goal.tolerance)  # type: ignore[union-attr]


def lasting_faults(scenario: Scenario, duration: float) -> Iterator[str]:
    """Yield a sentence on zones that are known for a shorter time than `duration`, that of the motion, s."""
    brief: dict[float, list[str]] = {}
    for zone in scenario.zones:
        if not duration <= zone.lasts:
            brief.setdefault(zone.lasts, []).append(zone.name)
    for lasts, names in brief.items():
        several = len(names) > 1
        yield (
            f"zone{'s' * several} {', '.join(names)} {'are' if several else 'is'} known for {lasts:g} s, and "
            f"the motion takes {duration:.4g} s: raise lasts_s, or sky.for_duration_s"
        )


def _arrival_faults(scenario: Scenario, goal: Goal, duration: float) -> Iterator[str]:
    """Yield a sentence for each way in which a goal misses its moving targets when the motion ends.

    `duration` is that of the motion, s. Nothing is yielded where nothing moves.
    """
    if not moves(scenario):
        return
    if not abs(goal.time - duration) <= _TIME_TOLERANCE * max(duration, 1.0):
        yield f"the goal is one at {goal.time:.6g} s, the trajectory ends at {duration:.6g} s"
    asked = scenario.goal
    if isinstance(asked, GivenState) or not asked.moves:
        return
    if goal.angular_velocity is None or goal.joint_rates is None:
        yield "the goal has no rates, though targets move"
        return
    if not all(path.covers(goal.time) for path in asked.paths) or not goal.time >= 0:
        yield f"the targets are not known at {goal.time:.6g} s, the time of the goal"
        return
    yield from hidden_targets(scenario, goal.time)
    beams, rates = _beam_motion(scenario, goal, goal.angular_velocity, goal.joint_rates)
    apart = np.linalg.norm(beams - asked.at(goal.time).directions, axis=-1)
    slip = np.linalg.norm(rates - asked.rates(goal.time), axis=-1)
    for name, off, too_fast in zip(asked.names(scenario.spacecraft), apart, slip, strict=True):
        if not off <= _target_tolerance(scenario, name):
            yield f"at the goal {name} points {off:.3g} rad off its moving target"
        if not too_fast <= _target_tolerance(scenario, name):
            yield f"at the goal {name} turns {too_fast:.3g} rad/s otherwise than its moving target"


def _beam_motion(
    scenario: Scenario, goal: Goal, angular_velocity: np.ndarray, joint_rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the beams of the devices with targets point at a goal, and how fast they turn.

    The beam of a device with joints turns in the body at ``y' Y + p' P``: about the yaw axis ``Y``, and about
    the pitch axis ``P``, which points to the right, opposite to the second axis ("left") of the device's
    frame.

    Args:
        scenario: the problem, whose goal is targets.
        goal: attitude and joint angles.
        angular_velocity: (3,) rad/s, body axes.
        joint_rates: (2n + d,) rad/s, yaws, pitches, drives.

    Returns:
        Inertial unit vectors (k, 3) of the k devices with targets, and their derivatives (k, 3), 1/s.
    """
    craft, asked = scenario.spacecraft, scenario.goal
    terminals = len(craft.terminals)
    body, turning = [], []
    for number in asked.numbers(craft):  # type: ignore[union-attr]
        if number >= terminals + len(craft.drives):
            body.append(craft.instruments[number - terminals - len(craft.drives)].boresight)
            turning.append(np.zeros(3))
            continue
        if number < terminals:
            frame, lifts = craft.terminals[number].frame, number + terminals
            yaw, pitch = goal.joints[number], goal.joints[lifts]
            rates = joint_rates[number], joint_rates[lifts]
        else:
            drive, joint = craft.drives[number - terminals], number + terminals
            frame, yaw, pitch = drive.frame, goal.joints[joint], float(drive.tilt)
            rates = joint_rates[joint], 0.0
        ahead, left, up = np.asarray(frame).T
        level = np.cos(yaw) * ahead + np.sin(yaw) * left
        beam = np.cos(pitch) * level + np.sin(pitch) * up
        body.append(beam)
        # up x beam and (level x up) x beam, with level and up at right angles
        turning.append(
            np.cos(pitch) * rates[0] * (np.cos(yaw) * left - np.sin(yaw) * ahead)
            + rates[1] * (np.cos(pitch) * up - np.sin(pitch) * level)
        )
    seen, moved = np.array(body).reshape(-1, 3), np.array(turning).reshape(-1, 3)
    x, y, z = np.asarray(angular_velocity, float)
    spin = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moving = seen @ spin.T + moved
    return seen @ goal.attitude.T, moving @ goal.attitude.T
