"""Claims put in groups of one shape, and the proof of each group.

Claims of one kind proved together: samples and their errors, margins, limits, joins; then the reports.

Trajectories of one spacecraft lie one after the other in the same arrays, see `motion` and `bounds`; what is
said of each is, to the last bit, the same whichever others there are.

What the certificate is asked: about one trajectory, about many, and about every margin of one.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import bounds, form, limits, series
from jaxplan.certificate.bounds import Errors, Minima
from jaxplan.certificate.claims import Certificate, Claim, EndState, ProvedMargin, every_sight
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Motion, Samples
from jaxplan.model.limits import QUANTITIES
from jaxplan.model.limits import limits as every_limit
from jaxplan.runtime.batching import grouped

if TYPE_CHECKING:
    from jaxplan.model.constraints import Constraints
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
    def of(cls, claim: Claim) -> "Self | Certificate":
        """The case, or a report of what is wrong with its form."""
        curve, zones = form.plain(claim.trajectory), form.plain(claim.cones)
        ends = {"start": claim.start, "goal": claim.goal}
        refused = form.faults(curve, claim.spacecraft, zones, len(claim.zone_names), ends, claim.sight_names)
        if refused:
            return Certificate(certified=False, faults=tuple(refused))
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


def prove_alike(cases: Sequence[Case]) -> list[Certificate]:
    """Reports on cases of one kind."""
    craft = cases[0].claim.spacecraft
    bindings = Bindings.joined([case.bindings for case in cases])
    motion = Motion.of(craft, bindings.views, *(case.curve for case in cases))
    wanted = negligible(craft, [case.bindings for case in cases])
    evidence = bounds.gather(motion, wanted, list(bindings.ways.values()))
    samples = evidence.samples
    if not all(np.all(np.isfinite(x)) for x in (samples.boresights, samples.spin, samples.joints)):
        if len(cases) > 1:
            return [report for case in cases for report in prove_alike([case])]
        beyond = f"a chart turns by more than {series.LARGEST_TURN:g} rad or a number overflows"
        return [Certificate(certified=False, faults=(beyond,), evaluations=samples.time.size)]
    limited = limits.quantities(craft, evidence)
    margin, room, jumps = bindings.prove(evidence), limits.prove(limited, evidence), limits.jumps(samples)
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


def _report(case: Case, found: _Found) -> Certificate:
    """What is said of one trajectory."""
    claim, bindings, margin, room = case.claim, case.bindings, found.margin, found.room
    names, sights = claim.zone_names, claim.every_sight
    if case.static:
        margin.time[:] = room.time[:] = 0
    faults = (
        *limits.end_faults(found.samples, "start", claim.start, (found.first, 0)),
        *limits.end_faults(found.samples, "goal", claim.goal, (found.last, -1)),
        *limits.jump_faults(
            found.jumps,
            found.samples.time[found.first : found.last, -1],
            case.curve.smoothness,
            jerk_limited=any(limited.of.quantity.power > 2 for limited in found.limited),
        ),
        *limits.faults(found.limited, room, LIMIT_ALLOWANCE),
        *bindings.faults(margin, found.motion, sights, names, MARGIN_ALLOWANCE, found.number),
    )
    report = Certificate(
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
    angles = bounds.NEGLIGIBLE * np.stack([np.concatenate(own) for own in joints])[..., None] * each
    for number, bindings in enumerate(several):
        if np.any(bindings.frame == form.JOINTS):  # whose margins are angles
            angles[0, :, number] = np.minimum(angles[0, :, number], bounds.NEGLIGIBLE)
    return Errors(
        direction=bounds.NEGLIGIBLE * np.ones((directions, 1)) * angle,
        spin=bounds.NEGLIGIBLE * spin[:, None] * each,
        joints=angles,
    )


_TOGETHER, _PIECES = 16, 1024  # trajectories that are proved at once, and about their pieces


def certify(
    trajectory: "Trajectory",
    spacecraft: "Spacecraft",
    cones: "Constraints",
    *,
    zone_names: Sequence[str],
    start: EndState,
    goal: EndState,
    sight_names: Sequence[str] | None = None,
) -> Certificate:
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
        sight_names: names of all that the constraints bind; None for those that `Claim.every_sight` has.

    Returns:
        The report. Whatever the numbers are, nothing is raised.
    """
    claim = Claim(
        trajectory=trajectory,
        spacecraft=spacecraft,
        cones=cones,
        zone_names=zone_names,
        start=start,
        goal=goal,
        sight_names=sight_names,
    )
    return certify_batch([claim])[0]


def certify_batch(claims: Sequence[Claim]) -> list[Certificate]:
    """What `certify` says of each of many trajectories, in less time."""
    reports: dict[int, Certificate] = {}
    cases: list[tuple[int, Case]] = []
    with np.errstate(all="ignore"):  # NaN and infinities are found by their values
        for number, claim in enumerate(claims):
            case = Case.of(claim)
            if isinstance(case, Certificate):
                reports[number] = case
            else:
                cases.append((number, case))
        for group in grouped(cases, lambda pair: pair[1].kind(pair[0])):
            for part in _parts([cases[place] for place in group]):
                numbers, alike = zip(*part, strict=True)
                reports.update(zip(numbers, prove_alike(alike), strict=True))
    return [reports[number] for number in range(len(claims))]


def _parts(stack: Sequence[tuple[int, Case]]) -> Iterator[list[tuple[int, Case]]]:
    """So many cases at once that their samples stay in the cache."""
    part: list[tuple[int, Case]] = []
    pieces = 0
    for number, case in stack:
        more = len(case.curve.breaks)
        if part and (len(part) == _TOGETHER or pieces + more > _PIECES):
            yield part
            part, pieces = [], 0
        part.append((number, case))
        pieces += more
    yield part


def prove_margins(
    trajectory: "Trajectory",
    spacecraft: "Spacecraft",
    cones: "Constraints",
    *,
    zone_names: Sequence[str],
    sight_names: Sequence[str] | None = None,
) -> tuple[ProvedMargin, ...]:
    """Bounds the margin of every device to every zone that binds it, each as closely as the smallest of all.

    `certify` bounds the larger margins only as far as its answer needs; this takes more work.

    Args:
        trajectory: the manoeuvre.
        spacecraft: its devices and limits.
        cones: all zones, padded or not.
        zone_names: names of the zones in the order of the cones' rows.
        sight_names: names of all that the constraints bind; None for those that `Claim.every_sight` has.

    Returns:
        One a pair of zone and device, and one for all the zones of a group; in the order of the zones,
        groups last. None of a trajectory that cannot be evaluated.
    """
    with np.errstate(all="ignore"):
        curve, zones = form.plain(trajectory), form.plain(cones)
        if form.faults(curve, spacecraft, zones, len(zone_names), {}, sight_names):
            return ()
        sights = every_sight(spacecraft, zones) if sight_names is None else sight_names
        static = form.is_static(curve)
        together = Bindings.of(zones.at(0.0) if static else zones)
        motion = Motion.of(spacecraft, together.views, form.held(curve) if static else curve)
        apart = replace(together.layout, quantity=np.arange(len(together.layout.quantity)))
        bindings = replace(together, layout=apart)
        evidence = bounds.gather(motion, negligible(spacecraft, [bindings]), list(bindings.ways.values()))
        if not np.all(np.isfinite(evidence.samples.boresights)):
            return ()
        found = bindings.prove(evidence)
        if static:
            found.time[:] = 0
        proved = []
        for clause, (bound, time) in enumerate(zip(found.bound, found.time, strict=True)):
            pair = bindings.deciding(clause, time, motion)
            rows = np.unique(bindings.row[bindings.layout.clause == clause])
            proved.append(
                ProvedMargin(
                    zones=tuple(dict.fromkeys(zone_names[row] for row in rows)),
                    bound=float(bound),
                    time=float(time),
                    zone=zone_names[bindings.row[pair]],
                    device=sights[bindings.sight[pair]],
                )
            )
    return tuple(proved)
