"""Advice on motions that are not proved safe: settings to change, with values, the most helpful first.

A zone that is broken where the motion ends needs a goal farther away from it; one that is broken on the way
needs a path with more clearance, which tapers to zero at both ends. A load (a rate, torque or the like) that
is too large needs more time: it falls with a known power of the duration. A joint that leaves its range needs
ends farther inside, or nodes closer to each other.
"""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from jaxplan.certificate import LIMIT_ALLOWANCE, MARGIN_ALLOWANCE, Certificate
from jaxplan.model.goals import GivenState
from jaxplan.model.limits import QUANTITIES, Quantity, limits
from jaxplan.model.scenario import LONGEST_DURATION, Scenario
from jaxplan.planner.proving import lasting_faults

_TAPER = 0.1  # fraction of the duration, from either end, in which the path's clearance tapers off
_SAFETY_FACTOR = 2.0  # factor on what is lacking, to be safe, since the next motion is another one
_TIME_SAFETY_FACTOR = 1.01  # likewise, factor on the time in which loads would just fit
_QUANTITIES_BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}


def uncertified(certificate: Certificate, scenario: Scenario, duration: float) -> str:
    """Return text why a trajectory is not proved safe, and what to change, most promising first.

    Args:
        certificate: that of the trajectory, not certified.
        scenario: what was asked for.
        duration: that of the trajectory, s.
    """
    told = "; ".join(certificate.faults)
    if certificate.faults and set(certificate.faults) <= set(lasting_faults(scenario, duration)):
        return told  # which have said what to change
    if not certificate.evaluated:
        return told  # another search would lead to the same
    beyond = {name: peak for name, peak in certificate.peaks.items() if not peak <= 1 + LIMIT_ALLOWANCE}
    angles = {name: peak for name, peak in beyond.items() if _QUANTITIES_BY_NAME[name].power == 0}
    loads = {_QUANTITIES_BY_NAME[name]: peak for name, peak in beyond.items() if name not in angles}
    advice = list(
        chain(
            _margin_advice(certificate, scenario, duration),
            _angle_advice(angles, certificate, scenario, duration),
            _load_advice(loads, duration),
        )
    )
    other = f"try another search.seed, such as {scenario.search.seed + 1}, or trajectory.method"
    return f"{told}: {'; or '.join(advice) or other}"


def _margin_advice(certificate: Certificate, scenario: Scenario, duration: float) -> Iterator[str]:
    """Yield settings that give back the margin that is lacking; nothing if no zone is broken."""
    margin = certificate.min_margin
    if margin is None or margin >= -MARGIN_ALLOWANCE:
        return
    lack, settings = -_SAFETY_FACTOR * float(np.rad2deg(margin)), scenario.search
    where, zone = _locate_on_motion(certificate.worst_time, duration), certificate.worst_zone
    if not np.isfinite(lack):  # of no number nothing follows
        yield "set a larger search.clearance_deg"
        return
    clearance = float(np.rad2deg(settings.clearance)) + lack
    on_the_way = [f"set search.clearance_deg = {_round_up_text(clearance)}"] * (clearance < 90)
    steps = [f"search.attitude_step_rad = {settings.attitude_step / 2:.3g}, for nodes closer to each other"]
    if where == "goal":
        if isinstance(scenario.goal, GivenState):
            yield f"move the state of [goal] by {_round_up_text(lack)} deg away from zone {zone}"
        elif (wider := np.rad2deg(scenario.goal.clearance) + lack) <= 45:
            yield f"set goal.clearance_deg = {_round_up_text(wider)}, as the margin is lost next to the goal"
        else:
            yield f"change goal.targets, which lie in zone {zone}"
    elif where == "start":
        yield f"move the state of [start] by {_round_up_text(lack)} deg away from zone {zone}"
    if any(one.name == zone and one.moves for one in scenario.zones):
        steps.append("try another trajectory.duration_s, as the zone is elsewhere then")
    yield from (*on_the_way, *steps)


def _angle_advice(
    beyond: dict[str, float], certificate: Certificate, scenario: Scenario, duration: float
) -> Iterator[str]:
    """Yield what brings joints back into their ranges.

    Args:
        beyond: kinds of angles that leave their ranges, each with its peak as a multiple of the range's
            bound.
        certificate: that of the trajectory.
        scenario: what was asked for.
        duration: that of the trajectory, s.
    """
    bounds = {limit.quantity.name: limit.bound for limit in limits(scenario.usable)}
    for name, peak in beyond.items():
        where = _locate_on_motion(certificate.peak_times.get(name), duration)
        lack = _SAFETY_FACTOR * (peak - 1) * float(np.rad2deg(np.max(bounds.get(name, 0.0), initial=0.0)))
        steps = f"set search.joint_step_rad = {scenario.search.joint_step / 2:.3g}"
        if where == "way":
            yield f"{steps}, as a {name} leaves its joint limits on the way"
            continue
        by = f" {_round_up_text(lack)} deg" * bool(np.isfinite(lack) and lack > 0)
        yield f"keep the {name} at the {where}{by} farther inside its joint limits, or lower its rate there"
        yield steps


def _load_advice(beyond: dict[Quantity, float], duration: float) -> Iterator[str]:
    """Yield the duration, s, in which rates and loads would fit; `beyond` has each peak over its limit."""
    if not beyond:
        return
    longer = (
        duration
        * max(peak ** (1 / quantity.power) for quantity, peak in beyond.items())
        * _TIME_SAFETY_FACTOR
    )
    if not np.isfinite(longer) or any(quantity.lesser for quantity in beyond):
        yield f"set a longer trajectory.duration_s than {duration:.4g}"  # part of it falls more slowly
        return
    if longer > LONGEST_DURATION:
        yield f"raise the limit of {' and of '.join(quantity.name.replace('_', ' ') for quantity in beyond)}"
        return
    yield f"set trajectory.duration_s = {_round_up_text(longer)}"


def _locate_on_motion(time: float | None, duration: float) -> str:
    """Tell where `time` is on a motion of `duration` s: near "start" or "goal", or on the "way".

    Near is within the fraction `_TAPER` of the duration. Of None, and of no duration, it is "way".
    """
    if time is None or not duration > 0:
        return "way"
    return "start" if time < _TAPER * duration else "goal" if time > (1 - _TAPER) * duration else "way"


def _round_up_text(value: float) -> str:
    """Return text of a positive number rounded up to two significant digits, or to three from 100 on.

    Other values are written as they are.
    """
    if not np.isfinite(value) or value <= 0:
        return f"{value:g}"
    unit = 10.0 ** (np.floor(np.log10(value)) - (1 if value < 100 else 2))
    return f"{np.ceil(value / unit - 1e-9) * unit:.10g}"
