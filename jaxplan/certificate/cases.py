"""Claims of one kind proved together: samples and their errors, margins, limits, joins; then the reports.

Trajectories of one spacecraft lie one after the other in the same arrays, see `motion` and `bounds`; what is
said of each is, to the last bit, the same whichever others there are.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import errors, form, jets, joins, limits
from jaxplan.certificate.bounds import Minima
from jaxplan.certificate.errors import Errors
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Motion, Samples
from jaxplan.certificate.report import Claim, Report
from jaxplan.model.limits import QUANTITIES
from jaxplan.model.limits import limits as every_limit

if TYPE_CHECKING:
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory

MARGIN_ALLOWANCE = 1e-9  # rad
LIMIT_ALLOWANCE = 1e-9  # of the limit


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A claim of legible form.

    Attributes:
        claim: as it was made.
        static: whether it is of a state without duration, which is held for a second.
        curve: its trajectory in float64, held.
        bindings: its zones.
    """

    claim: Claim
    static: bool
    curve: "Trajectory"
    bindings: Bindings

    @classmethod
    def of(cls, claim: Claim) -> "Self | Report":
        """The case, or a report of what is wrong with its form."""
        curve, zones = form.plain(claim.trajectory), form.plain(claim.cones)
        ends = {"start": claim.start, "goal": claim.goal}
        refused = form.faults(curve, claim.spacecraft, zones, len(claim.zone_names), ends, claim.sight_names)
        if refused:
            return Report(certified=False, faults=tuple(refused))
        static = form.is_static(curve)
        return cls(
            claim=claim,
            static=static,
            curve=form.held(curve) if static else curve,
            bindings=Bindings.of(zones.at(0.0) if static else zones),
        )

    def kind(self, number: int) -> Hashable:
        """What is the same for all cases that may be proved together; where axes move, none with another."""
        craft = self.claim.spacecraft
        numbers = (
            craft.mounts,
            craft.fixed_boresights,
            craft.inertia,
            *(quantity.given(craft) for quantity in QUANTITIES),
        )
        return (
            number if self.bindings.ways else None,
            craft.device_names,
            self.curve.coefficients.shape[1],
            self.curve.joint_coefficients.shape[1],
            *(None if part is None else np.asarray(part, np.float64).tobytes() for part in numbers),
            *(part.tobytes() for part in vars(self.bindings.views).values()),
        )


def prove_alike(cases: Sequence[Case]) -> list[Report]:
    """Reports on cases of one kind."""
    craft = cases[0].claim.spacecraft
    bindings = Bindings.joined([case.bindings for case in cases])
    motion = Motion.of(craft, bindings.views, *(case.curve for case in cases))
    wanted = negligible(craft, [case.bindings for case in cases])
    evidence = errors.gather(motion, wanted, list(bindings.ways.values()))
    samples = evidence.samples
    if not all(np.all(np.isfinite(x)) for x in (samples.boresights, samples.spin, samples.joints)):
        if len(cases) > 1:
            return [report for case in cases for report in prove_alike([case])]
        beyond = f"a chart turns by more than {jets.LARGEST_TURN:g} rad or a number overflows"
        return [Report(certified=False, faults=(beyond,), evaluations=samples.time.size)]
    limited = limits.quantities(craft, evidence)
    margin, room, jumps = bindings.prove(evidence), limits.prove(limited, evidence), joins.jumps(samples)
    reports, clause, component = [], 0, 0
    components = sum(len(quantity.components) for quantity in limited)
    for number, case in enumerate(cases):
        clauses = len(case.bindings.layout.quantity)
        first, end = evidence.on.begins[number : number + 2].tolist()
        found = _Found(
            motion=motion,
            number=number,
            samples=samples,
            first=first,
            last=end - 1,
            margin=margin.part(slice(clause, clause + clauses)),
            limited=limited,
            room=room.part(slice(component, component + components)),
            jumps={name: steps[first : end - 1] for name, steps in jumps.items()},
        )
        reports.append(_report(case, found))
        clause, component = clause + clauses, component + components
    return reports


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """What was found of a trajectory, maybe among others.

    Attributes:
        motion: of all.
        number: that of the trajectory among all.
        samples: of all.
        first: number of the trajectory's first interval.
        last: number of its last one.
        margin: of its clauses.
        limited: quantities of all.
        room: of their components on this one.
        jumps: at its inner breaks.
    """

    motion: Motion
    number: int
    samples: Samples
    first: int
    last: int
    margin: Minima
    limited: list[limits.Limited]
    room: Minima
    jumps: dict[str, np.ndarray]


def _report(case: Case, found: _Found) -> Report:
    """What is said of one trajectory."""
    claim, bindings, margin, room = case.claim, case.bindings, found.margin, found.room
    names, sights = claim.zone_names, claim.every_sight
    if case.static:
        margin.time[:] = room.time[:] = 0
    faults = (
        *joins.end_faults(found.samples, "start", claim.start, (found.first, 0)),
        *joins.end_faults(found.samples, "goal", claim.goal, (found.last, -1)),
        *joins.jump_faults(
            found.jumps,
            found.samples.time[found.first : found.last, -1],
            case.curve.smoothness,
            jerk_limited=any(limited.of.quantity.power > 2 for limited in found.limited),
        ),
        *limits.faults(found.limited, room, LIMIT_ALLOWANCE),
        *bindings.faults(margin, found.motion, sights, names, MARGIN_ALLOWANCE, found.number),
    )
    report = Report(
        certified=not faults,
        peaks=limits.peaks(found.limited, room),
        peak_times=limits.peak_times(found.limited, room),
        jumps={name: float(np.max(steps, initial=0)) for name, steps in found.jumps.items()},
        faults=faults,
        evaluations=(found.last + 1 - found.first) * found.samples.time.shape[1],
    )
    if len(margin.bound) == 0:
        return report
    worst = int(np.argmin(margin.seen))
    pair = bindings.deciding(worst, margin.time[worst], found.motion, found.number)
    return replace(
        report,
        min_margin=float(np.min(margin.bound)),
        worst_time=float(margin.time[worst]),
        worst_device=sights[bindings.sight[pair]],
        worst_zone=names[bindings.row[pair]],
    )


def negligible(spacecraft: "Spacecraft", several: Sequence[Bindings]) -> Errors:
    """Errors that do not matter beside the angles and limits they are compared with.

    Args:
        spacecraft: of all trajectories.
        several: the bindings of each, which number the last axis.
    """
    spin, joints = np.full(3, np.inf), [[np.zeros(0)] for _ in range(3)]
    heaviest = 1.0 if spacecraft.inertia is None else np.linalg.norm(spacecraft.inertia, 2)
    for limit in every_limit(spacecraft):
        power, size = limit.quantity.power, heaviest if limit.quantity.by_inertia else 1.0
        if limit.quantity.of_joints:
            joints[power].append(limit.bound)
        else:
            spin[power - 1] = np.minimum(spin[power - 1], np.min(limit.bound) / size)
    angle = np.sin([bindings.narrowest for bindings in several])
    views = several[0].views
    directions = sum(map(len, (spacecraft.device_names, views.body, views.carrier, views.within)))
    each = np.ones(len(several))
    angles = errors.NEGLIGIBLE * np.stack([np.concatenate(own) for own in joints])[..., None] * each
    for number, bindings in enumerate(several):
        if np.any(bindings.frame == form.JOINTS):  # whose margins are angles
            angles[0, :, number] = np.minimum(angles[0, :, number], errors.NEGLIGIBLE)
    return Errors(
        direction=errors.NEGLIGIBLE * np.ones((directions, 1)) * angle,
        spin=errors.NEGLIGIBLE * spin[:, None] * each,
        joints=angles,
    )
