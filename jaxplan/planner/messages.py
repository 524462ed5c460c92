"""Texts that tell the user how planning went, and which setting to change."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.goal import Decomposition
from jaxplan.goal.aims import apart, off
from jaxplan.model.breaches import in_own_zone
from jaxplan.model.constraints import Constraints
from jaxplan.model.goals import LEAST_TIME, GivenState, Targets
from jaxplan.model.hidden_spans import rounded_up
from jaxplan.model.limits import longest
from jaxplan.model.scenario import Scenario, known_until, moves, seen_from, target_paths
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner.record import Plan
from jaxplan.search import (
    Barrier,
    JointBarrier,
    Scene,
    SearchResult,
    most_obstructive,
    narrow_zone,
    narrowest,
)
from jaxplan.trajectory.fit import needed_words, too_tight
from jaxplan.trajectory.peaks import peaks

FOR_LONGER = "let it be known for longer, by more samples or a longer sky.for_duration_s"
"""Advice where a target or a zone that moves is known for a shorter time than the motion takes."""


def when(scenario: Scenario, time: float) -> str:
    """Return text, to end a sentence, that targets and zones are where they are at `time` s.

    It is empty where nothing moves.
    """
    return f" (with targets and zones where they are after {time:.6g} s)" if moves(scenario) else ""


def hidden(scenario: Scenario, unseen: Sequence[str], time: float) -> str:
    """Return text why targets that are hidden at the end time are no goal, and which duration to set instead.

    Args:
        scenario: the problem.
        unseen: a phrase for each hidden target.
        time: s, when the manoeuvre ends.
    """
    several = sum(bool(path.hidden) for _, path in target_paths(scenario)) > 1
    seen, (known, _) = seen_from(scenario, time), known_until(scenario)
    advice = f"change goal.targets, or {FOR_LONGER}"
    if seen <= known:
        all_seen = ", when all targets are seen" * several
        advice = f'set trajectory.duration_s = {rounded_up(seen)}{all_seen}, or "minimum" to have it found'
    return f"{'; '.join(unseen)}: {advice}"


def _tube_advice(scenario: Scenario) -> str:
    """Return text that lowering the errors of [robust] may help as well; empty if the scenario has none."""
    return "" if scenario.robust is None else ", or lower the errors of [robust], which count"


def unreachable(
    scenario: Scenario, rows: Constraints, found: Decomposition, most: float, time: float = 0.0
) -> str:
    """Return text why no attitude reaches the targets while it keeps the zones.

    Args:
        scenario: the problem.
        rows: its constraints at that time.
        found: the decomposition, which has found no goals.
        most: largest platform rotation from the start, rad.
        time: s, when the manoeuvre ends.
    """
    craft = scenario.usable
    asked = scenario.goal.at(time) if isinstance(scenario.goal, Targets) else scenario.goal
    if found.aim_excess > 0 and isinstance(asked, Targets):
        contrary = apart(craft, asked)
        if contrary is not None:
            return f"{contrary}: change one of goal.targets, or raise goal.tolerance_deg"
        return (
            f"at best {off(craft, asked, found.aim_excesses)} at the goal: change goal.targets or the limits"
        )
    if isinstance(scenario.goal, Targets):
        own = in_own_zone(craft, scenario.cones, scenario.goal, time)
        if own is not None:
            return f"{own}: change goal.targets or the zone"
    if found.worst_zone is not None and found.worst_device is not None and found.zone_excess > 0:
        sight = scenario.sight_names[found.worst_device]
        zone = rows.zone[found.worst_zone]
        wider = getattr(scenario.goal, "clearance", 0.0)
        lower = f", or lower goal.clearance_deg = {np.rad2deg(wider):g}, which counts" if wider else ""
        return (
            f"at best {sight} breaks zone {scenario.zones[zone].name} "
            f"by {np.rad2deg(found.zone_excess):.4g} deg at the goal: change goal.targets or the zone{lower}"
            f"{_tube_advice(scenario)}"
        )
    if not found.slew_angle > most and isinstance(asked, Targets):  # what is broken is lost in rounding
        named = " and ".join(asked.names(craft))
        return (
            f"no attitude was found at which {named} reach their targets and every zone is kept: "
            f"change goal.targets or the zones, or try another search.seed{_tube_advice(scenario)}"
        )
    # Equation (6): no turn is quicker than about the diagonal of the body axes' limits.
    least = found.slew_angle / longest(craft, 1)
    box = longest(replace(craft, rate_norm_limit=None), 1)
    limit = "rate_limit_deg_s" if longest(craft, 1) >= box else "rate_norm_limit_deg_s"
    # The paper's method does not stretch what starts or ends with a rate, or moves.
    otherwise = ', or set it to "stretched"' if scenario.trajectory.method == "global" else ""
    wishes = " and fulfils the wishes of prefer" * (isinstance(asked, Targets) and bool(asked.prefer))
    return (
        f"the nearest attitude that reaches the targets{wishes} is {np.rad2deg(found.slew_angle):.4g} deg "
        f"away, which takes {least:.4g} s or more within spacecraft.{limit}: raise that, or "
        f"trajectory.duration_s (now {scenario.trajectory.duration}){otherwise}"
    )


def parted(scenario: Scenario, scene: Scene, barrier: Barrier) -> str:
    """Return text that zones form a ring between the start direction and the goal direction of a sight.

    Args:
        scenario: the problem.
        scene: the search problem in which the barrier was found.
        barrier: the ring of zones.
    """
    rows = scene.cones
    zones = scenario.zones
    ring = [zones[zone] for zone in rows.zone[list(barrier.zones)]]
    sight = scenario.sight_names[barrier.device]
    names = [zone.name for zone in ring]
    out, inside = (any(isinstance(zone, kind) for zone in ring) for kind in (KeepOut, KeepIn))
    change = " or ".join(["a keep-out zone smaller"] * out + ["a keep-in zone larger"] * inside)
    return (
        f"{sight} cannot get from its start direction to its goal "
        f"direction, since zones {', '.join(names[:-1])} and {names[-1]} overlap in a ring between the two: "
        f"make {change}, or do not bind the device to it{_tube_advice(scenario)}"
    )


def closed(scenario: Scenario, barrier: JointBarrier, time: float) -> str:
    """Return text that a barrier in joint angles keeps a device from its angles at the goal.

    `time` is that of the goal, s.
    """
    device, names = _barrier_names(scenario, barrier)
    what = "yaw and pitch" if barrier.device < len(scenario.spacecraft.terminals) else "angle"
    lies = "lies" if len(barrier.zones) == 1 else "lie"
    return (
        f"{device} cannot get from its {what} at the start to what is wanted at the goal, since "
        f"{names} {lies} between the two{when(scenario, time)}: make it smaller, widen the range, or "
        f"change the goal{_tube_advice(scenario)}"
    )


def _barrier_names(scenario: Scenario, barrier: JointBarrier) -> tuple[str, str]:
    """Return the name of a joint barrier's device, and text with the names of its zones."""
    zones = [scenario.zones[zone] for zone in barrier.zones]
    names = [zone.name if zone.any_of is None else f"{zone.name} (of {zone.any_of})" for zone in zones]
    return scenario.spacecraft.device_names[barrier.device], " and ".join(names)


def no_path(scenario: Scenario, scene: Scene, result: SearchResult) -> str:
    """Return text why a search found no path, with the zone that is most in the way."""
    settings = scenario.search
    blocked = _describe_obstacle(scenario, scene)
    if result.status is Status.TIME_LIMIT:
        return (
            f"no path within search.time_limit_s = {settings.time_limit:g} "
            f"({result.expansions} expansions): raise it, or search.heuristic_weight{blocked}"
        )
    return (
        f"no path within search.max_expansions = {settings.max_expansions}"
        f"{_tell_shorter_step(scenario, scene)}: raise it, or try another search.seed{blocked}"
    )


def _tell_shorter_step(scenario: Scenario, scene: Scene) -> str:
    """Return text that a narrow keep-in zone was searched in shorter steps, too; empty if none was."""
    zone = narrow_zone(scenario)
    if zone is None or scene.attitude_step >= scenario.search.attitude_step:
        return ""
    return (
        f" (in steps of {scenario.search.attitude_step:g} rad, and then of {scene.attitude_step:.2g}, as "
        f"keep-in zone {zone.name} is narrow)"
    )


def _describe_obstacle(scenario: Scenario, scene: Scene) -> str:
    """Return text on what is most in the way: a narrow gap for joints, or what the straight motion breaks.

    The text ends a sentence, and is empty where the straight motion breaks nothing.
    """
    narrow = narrowest(scene)
    if narrow is not None:
        device, names = _barrier_names(scenario, narrow[0])
        return (
            f"; the joints of {device} get past {names} by a gap of {2 * np.rad2deg(narrow[1]):.2g} deg "
            "or less: make that wider, or smaller search steps"
        )
    obstacle = most_obstructive(scene)
    if obstacle is None:
        return ""
    rows, row = obstacle
    zone = scenario.zones[rows.zone[row]]
    if zone.any_of is None:
        return f"; zone {zone.name} is most in the way"
    members = [one for one in scenario.zones if one.any_of == zone.any_of]
    kind = "keep-in group" if all(isinstance(one, KeepIn) for one in members) else "group"
    return f"; {kind} {zone.any_of} is most in the way"


def farther(nearest: Plan, plan: Plan) -> str:
    """Return the message of a plan to another goal than the nearest one: its own, and why that one failed."""
    away = "" if nearest.goal is None else f", {np.rad2deg(nearest.goal.slew_angle):.4g} deg away,"
    which = "goal nearest to the wishes" if getattr(plan.scenario.goal, "prefer", ()) else "nearest goal"
    failed = f"this is not the {which}: that{away} ended as {nearest.status.name}"
    return "; ".join(filter(None, (plan.message, failed, nearest.message)))


def sooner(refused: Plan, plan: Plan) -> str:
    """Return the message of a plan in a given duration, after the first plan in it was refused.

    It says that the goal is now one of least time, unless the scenario names a criterion or a state.
    """
    asked = refused.scenario.goal
    if isinstance(asked, GivenState) or asked.criterion is not None:
        return plan.message
    why = f"in {refused.scenario.trajectory.duration:g} s the goal of least rotation was not reached"
    return "; ".join(filter(None, (plan.message, f'goal.criterion = "{LEAST_TIME}": {why}')))


def too_short(refused: Plan, enough: float) -> str:
    """Return text why a duration is refused, and which one is enough.

    Args:
        refused: the failed plan in the given duration.
        enough: s, a duration in which there is a certified plan.
    """
    scenario, needed = refused.scenario, needed_words(enough, moving=False, scalable=True)
    duration = float(scenario.trajectory.duration)
    if refused.status is Status.LIMITS_TOO_TIGHT and refused.trajectory is not None:
        return too_tight(duration, peaks(refused.trajectory, scenario.usable), needed, "")
    return f"{refused.message}; {needed}"
