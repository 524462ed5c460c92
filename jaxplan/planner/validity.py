"""Whether a state is within the joint limits and clear of every zone, said in words when it is not."""

from collections.abc import Iterator, Sequence

import numpy as np

from jaxplan import zones
from jaxplan.model.constraints import state_margins
from jaxplan.scenario import Scenario

# What rounding may cost at the very limit, rad; the certificate allows the same.
ROUNDING = 1e-9


def breaches(
    scenario: Scenario,
    attitude: np.ndarray,
    joints: np.ndarray,
    angular_velocity: np.ndarray,
    joint_rates: np.ndarray,
    *,
    arriving: bool = False,
) -> tuple[str, ...]:
    """Everything a state breaks: joint limits, also those that it cannot but break next, rates and zones.

    Args:
        scenario: limits and zones.
        attitude: (3, 3) body to inertial.
        joints: (2n,) rad.
        angular_velocity: (3,) rad/s, body axes.
        joint_rates: (2n,) rad/s.
        arriving: whether the state ends a motion instead of starting one: what was just before counts.

    Returns:
        A phrase a breach, naming device, zone or limit and the overlap in degrees; empty when there is none.
    """
    craft = scenario.spacecraft
    found = [] if np.all(np.isfinite(attitude)) else ["the attitude is not made of finite numbers"]
    found += [
        f"{name} is {np.rad2deg(excess):.4g} deg beyond its limit of {np.rad2deg(limit):.4g} deg"
        for name, excess, limit in zip(
            craft.joint_names, np.abs(joints) - craft.joint_limits, craft.joint_limits, strict=True
        )
        if not excess <= ROUNDING
    ]
    rates = [
        ("the platform's rate", np.max(np.abs(angular_velocity)), craft.rate_limit),
        *zip(
            [f"the rate of {name}" for name in craft.joint_names],
            np.abs(joint_rates),
            craft.joint_rate_limits,
            strict=True,
        ),
    ]
    found += [
        f"{name} is {np.rad2deg(rate):.4g} deg/s, its limit {np.rad2deg(limit):.4g} deg/s"
        for name, rate, limit in rates
        if not rate <= limit * (1 + ROUNDING)
    ]
    found += _overruns(scenario, joints, joint_rates, arriving)
    return (*found, *_zone_breaches(scenario, attitude, joints))


def _overruns(
    scenario: Scenario, joints: np.ndarray, joint_rates: np.ndarray, arriving: bool
) -> Iterator[str]:
    """Joints within their limits that even full braking takes beyond, or that come from there."""
    craft = scenario.spacecraft
    room = craft.joint_limits - np.abs(joints)
    outward = np.where(arriving, -1, 1) * np.sign(joints) * joint_rates
    braking = joint_rates**2 / (2 * craft.joint_acceleration_limits)
    for j in np.flatnonzero((room >= -ROUNDING) & (outward > 0) & (braking > room + ROUNDING)):
        gap, rate, limit = np.rad2deg([max(room[j], 0), abs(joint_rates[j]), craft.joint_limits[j]])
        where = f"{craft.joint_names[j]}, {gap:.4g} deg from its limit of {limit:.4g} deg,"
        if arriving:
            yield f"{where} moves away from it at {rate:.4g} deg/s, so it must have been beyond it"
        else:
            yield f"{where} moves toward it at {rate:.4g} deg/s and cannot stop before it"


def _zone_breaches(scenario: Scenario, attitude: np.ndarray, joints: np.ndarray) -> list[str]:
    craft = scenario.spacecraft
    cones = zones.tabulate(scenario.keep_out, scenario.keep_in, craft.device_names)
    sights = cones.sights(craft.mounts, craft.fixed_boresights)
    table = state_margins(cones, sights, np.asarray(attitude), np.asarray(joints))
    every: Sequence[zones.KeepOut | zones.KeepIn] = [*scenario.keep_out, *scenario.keep_in]
    found = []
    for row, zone in enumerate(every):
        group = zone.any_of if isinstance(zone, zones.KeepIn) else None
        worst = table[row].min(initial=np.inf)
        if group is not None:
            members = [k for k in range(len(every)) if cones.group[k] == cones.group[row]]
            if members[0] != row:
                continue  # the group has been looked at
            best = max(members, key=lambda k: table[k].min())
            row, worst = best, table[best].min()
        if not worst >= -ROUNDING:
            device = craft.device_names[int(np.argmin(table[row]))]
            side = "outside keep-in zone" if cones.side[row] < 0 else "inside keep-out zone"
            name = every[row].name + (f", the nearest of group {group}," if group else "")
            found.append(f"{device} is {np.rad2deg(-worst):.4g} deg {side} {name}".rstrip(","))
    return found
