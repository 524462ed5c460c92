"""The certificate of a scenario's trajectory: made when it is planned, and made anew from a file.

`jaxplan.certificate` proves that a trajectory keeps limits and zones and goes from one state to another.
That these states are what the scenario asks for is checked here: the goal meets its targets, and where these
move, it is there when the manoeuvre ends, along their directions and at their rates. That is plain numpy, so
that no NaN passes, from equation (13) and the derivative of ``p = R v(q)``, ``p' = R (omega x v + v_q q')``;
nothing of what finds goals is used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate, Claim, EndState, ProvedMargin, certify_batch, prove_margins
from jaxplan.geometry.vectors import outward, slopes
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario, known_until, moves
from jaxplan.model.zones import sight_names
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import hidden_targets
from jaxplan.runtime.arguments import expect
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import refuse_types, take_in
from jaxplan.trajectory import Trajectory

TOLERANCE = 1e-8
"""rad and rad/s: how far a goal may be from what the scenario asks for, a beam from its target; the
certificate allows as much of the ends."""
_SAME_TIME = 1e-12  # share of the duration by which the goal's time may differ from the trajectory's end


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProofQuery:
    """A trajectory to be certified against its scenario's zones, limits, start and goal.

    Attributes:
        scenario: what must hold.
        goal: where the trajectory must end; it must be what the scenario asks for.
        trajectory: the manoeuvre.
    """

    scenario: Scenario
    goal: Goal
    trajectory: Trajectory


def prove(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> Certificate:
    """Certify a trajectory by itself, see `ProofQuery`."""
    return prove_batch([ProofQuery(scenario=scenario, goal=goal, trajectory=trajectory)])[0]


def prove_batch(queries: Sequence[ProofQuery]) -> list[Certificate]:
    """Certify many trajectories, alike ones together."""
    certificates = []
    for query, certificate in zip(queries, certify_batch([_claim(query) for query in queries]), strict=True):
        off = (
            *_goal_faults(query.scenario, query.goal),
            *_arrival_faults(query.scenario, query.goal, query.trajectory.duration),
        )
        certified, faults = certificate.certified and not off, (*certificate.faults, *off)
        certificates.append(replace(certificate, certified=certified, faults=faults))
    return certificates


def _claim(query: ProofQuery) -> Claim:
    """The claim that a trajectory keeps its scenario's limits and zones and ends at its goal."""
    scenario, goal, start = query.scenario, query.goal, query.scenario.start
    end, craft = end_rates(scenario, goal), scenario.spacecraft
    return Claim(
        trajectory=query.trajectory,
        spacecraft=craft,
        cones=scenario.constraints,
        zone_names=_zone_names(scenario),
        sight_names=sight_names(craft.device_names, scenario.constraints),
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
    """Certify a plan anew, trusting nothing it says, its goal included.

    Args:
        plan: with a trajectory.

    Returns:
        The certificate, which lists what could not be proved.

    Raises:
        TypeError: if it is no plan.
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
    return replace(certificate, faults=_of_zones(plan.scenario, certificate.faults))


def _of_zones(scenario: Scenario, faults: tuple[str, ...]) -> tuple[str, ...]:
    """Faults in which zones stand for the rows of cones that are made of them."""
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
        plan: with a trajectory; the margins of another are none.
    """
    if plan.trajectory is None:
        return ()
    scenario = plan.scenario
    return prove_margins(
        Claim(
            trajectory=plan.trajectory,
            spacecraft=scenario.spacecraft,
            cones=scenario.constraints,
            zone_names=_zone_names(scenario),
            sight_names=sight_names(scenario.spacecraft.device_names, scenario.constraints),
        )
    )


def _zone_names(scenario: Scenario) -> list[str]:
    """The name of the zone that each row of the scenario's constraints is of."""
    return [scenario.zones[zone].name for zone in scenario.constraints.zone if zone >= 0]


def _goal_faults(scenario: Scenario, goal: Goal) -> Iterator[str]:
    """A sentence for each way in which a goal is not what the scenario asks for.

    It is in numpy, so that no NaN passes. Of the directions of targets that move `_arrival_faults` tells.
    """
    asked, attitude = scenario.goal, goal.attitude
    if not abs(so3.distance(scenario.start.attitude, attitude) - goal.slew_angle) <= TOLERANCE:
        yield "the goal's slew angle is not that from the start"
    if isinstance(asked, GivenState):
        attitude, joints = asked.attitude, asked.joints
    else:
        limits = (("yaw", asked.yaw_limit), ("pitch", asked.pitch_limit))
        for (name, limit), angles in zip(limits, np.split(goal.joints, 2), strict=True):
            if limit is not None and not np.all(np.abs(angles) <= limit + TOLERANCE):
                yield f"a {name} at the goal is beyond goal.{name}_limit_deg = {np.rad2deg(limit):g}"
        if asked.moves:
            return
        joints = scenario.spacecraft.joints_toward(attitude, asked.directions)
    if not np.linalg.norm(goal.attitude - attitude) <= TOLERANCE:
        yield "the goal's attitude is not the scenario's"
    if not np.all(np.abs(goal.joints - joints) <= TOLERANCE):
        yield "the goal's joints do not point where the scenario asks"


def _arrival_faults(scenario: Scenario, goal: Goal, duration: float) -> Iterator[str]:
    """A sentence for each way in which a goal is not where its moving targets are when the motion ends."""
    if not moves(scenario):
        return
    if not abs(goal.time - duration) <= _SAME_TIME * max(duration, 1.0):
        yield f"the goal is one at {goal.time:.6g} s, the trajectory ends at {duration:.6g} s"
    asked = scenario.goal
    if isinstance(asked, GivenState) or not asked.moves:
        return
    if goal.angular_velocity is None or goal.joint_rates is None:
        yield "the goal has no rates, though targets move"
        return
    if not 0 <= goal.time <= known_until(scenario)[0]:
        yield f"the targets are not known at {goal.time:.6g} s, the time of the goal"
        return
    yield from hidden_targets(scenario, goal.time)
    beams, rates = _beam_motion(scenario, goal, goal.angular_velocity, goal.joint_rates)
    apart = np.linalg.norm(beams - asked.at(goal.time).directions, axis=-1)
    slip = np.linalg.norm(rates - asked.rates(goal.time), axis=-1)
    for terminal, off, too_fast in zip(scenario.spacecraft.terminals, apart, slip, strict=True):
        if not off <= TOLERANCE:
            yield f"at the goal {terminal.name} points {off:.3g} rad off its moving target"
        if not too_fast <= TOLERANCE:
            yield f"at the goal {terminal.name} turns {too_fast:.3g} rad/s otherwise than its moving target"


def _beam_motion(
    scenario: Scenario, goal: Goal, angular_velocity: np.ndarray, joint_rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Inertial directions (n, 3) of the terminals' beams at a goal, and how fast they turn (n, 3), 1/s."""
    yaw, pitch = np.split(np.asarray(goal.joints, float), 2)
    yaw_rate, pitch_rate = (part[:, None] for part in np.split(np.asarray(joint_rates, float), 2))
    azimuth = yaw + scenario.spacecraft.mounts
    circles = np.cos(azimuth), np.sin(azimuth), np.cos(pitch), np.sin(pitch)
    body, by_yaw, by_pitch = (np.stack(one, axis=-1) for one in (outward(*circles), *slopes(*circles)))
    moving = np.cross(angular_velocity, body) + yaw_rate * by_yaw + pitch_rate * by_pitch
    return body @ goal.attitude.T, moving @ goal.attitude.T
