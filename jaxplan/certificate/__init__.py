"""Proof that a trajectory keeps every margin and every limit at all times, or a list of what fails.

It reads only what a trajectory is (charts, breaks, polynomial coefficients) and evaluates it anew in plain
numpy, from the definition of the curve; it shares no code with the making of trajectories. On short
intervals everything is replaced by polynomials through samples. Bounds of higher derivatives, taken from the
coefficients, say how far those may be off (`errors`), and subdivision bounds the polynomials (`bounds`). So
what is reported holds for all times and not for samples. Zones that move are taken as they move (`axes`).

Allowances. A margin is certified from -1e-9 rad on, a limit up to 1 + 1e-9 of it. What the polynomials leave
out is kept to a hundredth of that (it is counted into the bounds, so that a margin of exactly zero reads as
about -1e-11), and evaluation in float64 errs by less than a thousandth, 1e-12, as the tests show against
extended precision; an estimate of it is counted in as well.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jaxplan.certificate import errors, form, jets, joins, limits
from jaxplan.certificate.errors import Errors
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Motion
from jaxplan.certificate.report import EndState, ProvedMargin, Report

if TYPE_CHECKING:
    from jaxplan.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory
    from jaxplan.zones import Cones

__all__ = [
    "LIMIT_ALLOWANCE",
    "MARGIN_ALLOWANCE",
    "EndState",
    "ProvedMargin",
    "Report",
    "certify",
    "prove_margins",
]

MARGIN_ALLOWANCE = 1e-9  # rad
LIMIT_ALLOWANCE = 1e-9  # of the limit


def certify(
    trajectory: "Trajectory",
    spacecraft: "Spacecraft",
    cones: "Cones",
    *,
    zone_names: Sequence[str],
    start: EndState,
    goal: EndState,
) -> Report:
    """Proves, or refuses to, that a trajectory is safe and does what it should.

    Certified is a trajectory on which at every instant every zone and every limit holds, attitude,
    joints and their rates are continuous, with as many more derivatives as it claims, and which starts and
    ends in the wanted states.

    Args:
        trajectory: the manoeuvre.
        spacecraft: its devices and limits.
        cones: all zones, padded or not.
        zone_names: names of the zones in the order of the cones' rows.
        start: the state it must start from.
        goal: the state it must end in.

    Returns:
        The report. Whatever the numbers are, nothing is raised.
    """
    with np.errstate(all="ignore"):  # NaN and infinities are found by their values
        curve, zones = form.plain(trajectory), form.plain(cones)
        refused = form.faults(curve, spacecraft, zones, len(zone_names), {"start": start, "goal": goal})
        if refused:
            return Report(certified=False, faults=tuple(refused))
        static = form.is_static(curve)
        motion = Motion.of(form.held(curve) if static else curve, spacecraft)
        bindings = Bindings.of(zones.at(0.0) if static else zones)
        evidence = errors.gather(motion, _negligible(spacecraft, bindings), list(bindings.ways.values()))
        samples = evidence.samples
        if not all(np.all(np.isfinite(x)) for x in (samples.boresights, samples.spin, samples.joints)):
            beyond = f"a chart turns by more than {jets.LARGEST_TURN:g} rad or a number overflows"
            return Report(certified=False, faults=(beyond,), evaluations=samples.time.size)
        limited = limits.quantities(spacecraft, evidence)
        margin, room = bindings.prove(evidence), limits.prove(limited, evidence)
        if static:
            margin.time[:] = room.time[:] = 0
        faults = (
            *joins.end_faults(samples, "start", start, 0),
            *joins.end_faults(samples, "goal", goal, -1),
            *joins.jump_faults(samples, curve.smoothness, spacecraft.jerk_limit is not None),
            *limits.faults(limited, room, LIMIT_ALLOWANCE),
            *bindings.faults(margin, motion, spacecraft.device_names, zone_names, MARGIN_ALLOWANCE),
        )
        report = Report(
            certified=not faults,
            peaks=limits.peaks(limited, room),
            peak_times=limits.peak_times(limited, room),
            jumps={name: float(np.max(steps, initial=0)) for name, steps in joins.jumps(samples).items()},
            faults=faults,
            evaluations=samples.time.size,
        )
        if len(margin.bound) == 0:
            return report
        worst = int(np.argmin(margin.seen))
        zone, device = bindings.deciding(worst, margin.time[worst], motion)
        return replace(
            report,
            min_margin=float(np.min(margin.bound)),
            worst_time=float(margin.time[worst]),
            worst_device=spacecraft.device_names[device],
            worst_zone=zone_names[zone],
        )


def prove_margins(
    trajectory: "Trajectory", spacecraft: "Spacecraft", cones: "Cones", *, zone_names: Sequence[str]
) -> tuple[ProvedMargin, ...]:
    """Bounds the margin of every device to every zone that binds it, each as closely as the smallest of all.

    `certify` bounds the larger margins only as far as its answer needs; this takes more work.

    Args:
        trajectory: the manoeuvre.
        spacecraft: its devices and limits.
        cones: all zones, padded or not.
        zone_names: names of the zones in the order of the cones' rows.

    Returns:
        One a pair of zone and device, and one for all the zones of a group; in the order of the zones,
        groups last. None of a trajectory that cannot be evaluated.
    """
    with np.errstate(all="ignore"):
        curve, zones = form.plain(trajectory), form.plain(cones)
        if form.faults(curve, spacecraft, zones, len(zone_names), {}):
            return ()
        static = form.is_static(curve)
        motion = Motion.of(form.held(curve) if static else curve, spacecraft)
        together = Bindings.of(zones.at(0.0) if static else zones)
        apart = replace(together.layout, quantity=np.arange(len(together.layout.quantity)))
        bindings = replace(together, layout=apart)
        evidence = errors.gather(motion, _negligible(spacecraft, bindings), list(bindings.ways.values()))
        if not np.all(np.isfinite(evidence.samples.boresights)):
            return ()
        found = bindings.prove(evidence)
        if static:
            found.time[:] = 0
        proved = []
        for clause, (bound, time) in enumerate(zip(found.bound, found.time, strict=True)):
            zone, device = bindings.deciding(clause, time, motion)
            rows = np.unique(bindings.zone[bindings.layout.clause == clause])
            proved.append(
                ProvedMargin(
                    zones=tuple(zone_names[row] for row in rows),
                    bound=float(bound),
                    time=float(time),
                    zone=zone_names[zone],
                    device=spacecraft.device_names[device],
                )
            )
    return tuple(proved)


def _negligible(spacecraft: "Spacecraft", bindings: Bindings) -> Errors:
    """Errors that do not matter beside the angles and limits they are compared with."""
    spin = np.array([spacecraft.rate_limit, spacecraft.acceleration_limit, spacecraft.jerk_limit or np.inf])
    if spacecraft.inertia is not None:
        inertia = np.linalg.norm(spacecraft.inertia, 2)
        for order, limit in enumerate((spacecraft.wheel_momentum_limit, spacecraft.torque_limit)):
            spin[order] = np.minimum(spin[order], np.inf if limit is None else np.min(limit) / inertia)
    angle = np.sin(np.min(bindings.angle, initial=np.pi / 2))
    joints = (spacecraft.joint_limits, spacecraft.joint_rate_limits, spacecraft.joint_acceleration_limits)
    return Errors(
        direction=errors.NEGLIGIBLE * np.full(len(spacecraft.device_names), angle),
        spin=errors.NEGLIGIBLE * spin,
        joints=errors.NEGLIGIBLE * np.stack(joints),
    )
