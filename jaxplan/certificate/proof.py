"""Certify claims, many at once, and bound every margin of one claim.

Claims whose spacecraft and arrays are alike make up a group, and the trajectories of a group lie one after
the other in the same arrays; see `motion` and `bounds`. The result for a claim does not depend, to the last
bit, on which other claims are certified with it.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Self

import numpy as np

from jaxplan.certificate import bounds, form, inertia, limits, series, tube, wheels
from jaxplan.certificate.bounds import Errors, Evidence, Majorants, Minima
from jaxplan.certificate.claims import Certificate, Claim, ProvedMargin
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Intervals, Motion, Mountings, Trajectory
from jaxplan.model.limits import QUANTITIES
from jaxplan.model.limits import limits as every_limit
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import in_groups

MARGIN_ALLOWANCE = 1e-9  # rad by which a margin may fall below zero
LIMIT_ALLOWANCE = 1e-9  # fraction of a limit by which it may be exceeded
_TRAJECTORIES_PER_BATCH = 16  # trajectories that are proved at once, so that their samples stay in the cache
_MOST_BREAKS_IN_BATCH = 64  # most breaks of a trajectory that is proved with others


def certify(claim: Claim) -> Certificate:
    """Prove that a trajectory keeps all limits and zones and ends where it should, or say what fails.

    A trajectory is certified if at every instant it keeps every zone and every limit; if attitude, joints and
    their rates are continuous, and as many further derivatives as the trajectory claims; and if it starts and
    ends in the wanted states.

    Returns:
        The certificate. Bad numbers lead to faults in it and never to an exception.
    """
    return certify_batch([claim])[0]


def certify_batch(claims: Sequence[Claim]) -> list[Certificate]:
    """Certify many trajectories together, faster than one by one; certificates are in the order of claims.

    See `certify`.
    """
    with np.errstate(all="ignore"):  # NaN and infinities are detected in the results
        cases = [Case.of(claim) for claim in claims]
        legible = [case for case in cases if isinstance(case, Case)]
        proved = iter(
            in_groups(legible, lambda case: case.kind, _certify_group, most=_TRAJECTORIES_PER_BATCH)
        )
    return [case if isinstance(case, Certificate) else next(proved) for case in cases]


def prove_margins(claim: Claim) -> tuple[ProvedMargin, ...]:
    """Bound the margin of every sight to every zone that binds it, each as closely as the smallest of all.

    `certify` bounds the larger margins only as far as its answer needs; this takes more work.

    Returns:
        One margin for each pair of zone and sight, and one for each group of zones; in the order of the
        constraints' rows. Empty for a trajectory that cannot be evaluated.
    """
    with np.errstate(all="ignore"):
        case = Case.of(claim)
        if isinstance(case, Certificate):
            return ()
        together = case.bindings.layout
        apart = replace(together, quantity=np.arange(len(together.quantity)))
        case = replace(case, bindings=replace(case.bindings, layout=apart))
        motion, bindings, evidence = _gather_evidence([case])
        if not _is_finite(evidence):
            return ()
        found = bindings.prove(evidence)
        if case.static:
            found.time[:] = 0
        return tuple(
            _proved_margin(case, clause, found, bindings.deciding(clause, found.time[clause], motion))
            for clause in range(len(found.bound))
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A claim whose form has been checked, with what is computed from it before the proof.

    Attributes:
        claim: as it was made.
        static: whether it is of a state without duration, which is kept for one second instead.
        curve: its trajectory in float64; if static, that of one second.
        bindings: the pairs of its zones and sights.
    """

    claim: Claim
    static: bool
    curve: Trajectory
    bindings: Bindings

    @classmethod
    def of(cls, claim: Claim) -> Self | Certificate:
        """Check a claim; return the case, or a certificate whose faults say what is wrong with its form."""
        curve, cones = form.plain(claim.trajectory), form.plain(claim.cones)
        refused = form.faults(claim, curve, cones)
        if refused:
            return Certificate(certified=False, faults=tuple(refused))
        static = form.is_static(curve)
        craft, robust = claim.spacecraft, claim.robust
        lost = None if robust is None else tube.losses(robust, craft, cones)
        return cls(
            claim=claim,
            static=static,
            curve=form.held(curve) if static else curve,
            bindings=Bindings.of(cones.at(0.0) if static else cones, len(craft.terminals), lost),
        )

    @property
    def kind(self) -> Hashable:
        """A key that is equal for cases that may be proved together."""
        if self.bindings.ways or len(self.curve.breaks) > _MOST_BREAKS_IN_BATCH:
            return id(self)  # to be proved alone
        craft = self.claim.spacecraft
        given = (quantity.given(craft) for quantity in QUANTITIES)
        mountings = Mountings.of(craft)
        centres = (quantity.centre(craft) for quantity in QUANTITIES if quantity.centre is not None)
        moving = wheels.numbers(craft), inertia.numbers(craft)
        turning = mountings.axes, mountings.tilts
        numbers = (*turning, craft.fixed_boresights, craft.inertia, *given, *centres, *moving)
        return (
            craft.device_names,
            craft.allocation,
            tube.numbers(self.claim.robust),
            self.claim.limits,
            tuple(wheel.name for wheel in craft.wheels),
            self.curve.coefficients.shape[1],
            self.curve.joint_coefficients.shape[1],
            *(None if part is None else np.asarray(part, np.float64).tobytes() for part in numbers),
            *(part.tobytes() for part in vars(self.bindings.views).values()),
        )


def _gather_evidence(cases: Sequence[Case]) -> tuple[Motion, Bindings, Evidence]:
    """Return motion, bindings and evidence of cases of one kind, their trajectories one after the other."""
    craft, several = cases[0].claim.spacecraft, [case.bindings for case in cases]
    bindings = Bindings.joined(several)
    motion = Motion.of(craft, bindings.views, *(case.curve for case in cases))
    ways, further = list(bindings.ways.values()), carried_excess(craft)
    return motion, bindings, bounds.gather(motion, negligible(craft, several), ways, further)


def _is_finite(evidence: Evidence) -> bool:
    """Tell whether all samples of the trajectories are finite."""
    samples = evidence.samples
    return all(np.isfinite(part).all() for part in (samples.boresights, samples.spin, samples.joints))


def _certify_group(cases: Sequence[Case]) -> list[Certificate]:
    """Certify cases of one kind together; return their certificates in order."""
    motion, bindings, evidence = _gather_evidence(cases)
    if not _is_finite(evidence):
        if len(cases) > 1:
            return [certificate for case in cases for certificate in _certify_group([case])]
        beyond = f"a chart turns by more than {series.LARGEST_TURN:g} rad or a number overflows"
        return [Certificate(certified=False, faults=(beyond,), evaluations=evidence.samples.time.size)]
    first = cases[0].claim
    limited = limits.quantities(first.spacecraft, evidence, first.robust, first.limits)
    proof = _Proof(
        motion=motion,
        bindings=bindings,
        evidence=evidence,
        limited=limited,
        margin=bindings.prove(evidence),
        room=limits.prove(limited, evidence),
        jumps=limits.jumps(evidence.samples),
    )
    return [proof.certificate(case, place) for place, case in enumerate(cases)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Proof:
    """Bounds of trajectories that are proved together.

    Attributes:
        motion: that of all trajectories.
        bindings: their pairs of zones and sights.
        evidence: samples and bounds of all trajectories.
        limited: samples of the quantities that their spacecraft limits.
        margin: least margins of all clauses, rad.
        room: least ``1 - |f| / limit`` of the limited components ``f``, trajectory by trajectory.
        jumps: jumps of every component from each interval to the next, as `limits.jumps` returns them.
    """

    motion: Motion
    bindings: Bindings
    evidence: Evidence
    limited: list[limits.Limited]
    margin: Minima
    room: Minima
    jumps: dict[str, np.ndarray]

    def certificate(self, case: Case, place: int) -> Certificate:
        """Return the certificate of a case; `place` is the index of its trajectory among all."""
        claim, bindings, margin, samples = case.claim, self.bindings, self.margin, self.evidence.samples
        first, beyond = self.evidence.on.begins[place : place + 2].tolist()
        clauses = np.flatnonzero(bindings.layout.owner == place)
        components = len(self.room.bound) // (len(self.evidence.on.begins) - 1)
        room = self.room.part(slice(place * components, (place + 1) * components))
        if case.static:
            margin.time[clauses] = room.time[:] = 0
        instants = {"start": (first, 0), "goal": (beyond - 1, -1)}
        jumps = {name: steps[first : beyond - 1] for name, steps in self.jumps.items()}
        peaks = limits.peaks(self.limited, room)
        jerk_limited = any(each.limit.quantity.power > 2 for each in self.limited)
        missed = (limits.end_faults(samples, name, end, instants[name]) for name, end in claim.ends.items())
        faults = (
            *chain.from_iterable(missed),
            *limits.jump_faults(
                jumps,
                samples.time[first : beyond - 1, -1],
                case.curve.smoothness,
                jerk_limited,
                claim.spacecraft.joint_names,
                claim.continuous,
            ),
            *limits.faults(
                self.limited, room, LIMIT_ALLOWANCE, samples.time[first:beyond], slice(first, beyond)
            ),
            *bindings.faults(clauses, margin, self.motion, claim, MARGIN_ALLOWANCE),
        )
        certificate = Certificate(
            certified=not faults,
            peaks={name: peak for name, (peak, _) in peaks.items()},
            peak_times={name: time for name, (_, time) in peaks.items()},
            jumps={name: float(steps.max(initial=0)) for name, steps in jumps.items()},
            faults=faults,
            evaluations=(beyond - first) * samples.time.shape[1],
        )
        if len(clauses) == 0:
            return certificate
        worst = int(clauses[np.argmin(margin.seen[clauses])])
        pair = bindings.deciding(worst, margin.time[worst], self.motion)
        return replace(
            certificate,
            min_margin=float(margin.bound[clauses].min()),
            worst_time=float(margin.time[worst]),
            worst_device=claim.sights[bindings.sight[pair]],
            worst_zone=claim.zone_names[bindings.row[pair]],
        )


def _proved_margin(case: Case, clause: int, found: Minima, pair: int) -> ProvedMargin:
    """Return a clause's margin as `ProvedMargin`.

    Args:
        case: the claim's case.
        clause: index of the clause.
        found: minima of all clauses.
        pair: index of the pair of zone and sight that decides the margin.
    """
    bindings, names = case.bindings, case.claim.zone_names
    rows = np.unique(bindings.row[bindings.layout.clause == clause])
    return ProvedMargin(
        zones=tuple(dict.fromkeys(names[row] for row in rows)),
        bound=float(found.bound[clause]),
        time=float(found.time[clause]),
        zone=names[bindings.row[pair]],
        device=case.claim.sights[bindings.sight[pair]],
    )


def carried_excess(craft: Spacecraft) -> Callable[[Intervals, Majorants], np.ndarray] | None:
    """Return the function that `bounds.gather` needs for errors of the stages' momenta; None without stages.

    From intervals and majorants it computes how many times as large as wanted these errors are.
    """
    if not len(inertia.numbers(craft)):
        return None
    least = dict.fromkeys((1, 2), np.inf)
    for limit in every_limit(craft):
        if limit.quantity.by_inertia:
            bound, power = np.asarray(limit.bound, np.float64), limit.quantity.power
            if limit.quantity.of_wheels:
                size = np.linalg.norm(wheels.rows_of(craft), axis=1)
                bound = bound[size > 0] / size[size > 0]
            least[power] = min(least[power], float(np.min(bound)))
    return partial(inertia.excess, craft, (least[1], least[2]))


def negligible(spacecraft: Spacecraft, several: Sequence[Bindings]) -> Errors:
    """Return errors that are `bounds.NEGLIGIBLE` times the angles and limits they are compared with.

    Args:
        spacecraft: that of all trajectories.
        several: the bindings of each trajectory; the last axis of the errors numbers the trajectories.
    """
    heaviest = 1.0 if spacecraft.inertia is None else np.linalg.norm(inertia.matrix(spacecraft.inertia), 2)
    spin, joints, attitude = np.full(3, np.inf), [[np.zeros(0)] for _ in range(3)], None
    if spacecraft.wheels:
        needed = wheels.negligible(spacecraft)
        spin, attitude = needed[:3], bounds.NEGLIGIBLE * needed[3] * np.ones(len(several))
    for limit in every_limit(spacecraft):
        if limit.quantity.of_wheels:
            continue
        power, size = limit.quantity.power, heaviest if limit.quantity.by_inertia else 1.0
        if limit.quantity.of_joints:
            joints[power].append(limit.bound)
        else:
            spin[power - 1] = np.minimum(spin[power - 1], np.min(limit.bound) / size)
    views, each = several[0].views, np.ones(len(several))
    directions = sum(map(len, (spacecraft.device_names, views.body, views.carrier, views.within)))
    angles = np.stack([np.concatenate(own) for own in joints])[..., None] * each
    angles[0] = np.minimum(angles[0], [1.0 if bindings.has_joints else np.inf for bindings in several])
    return Errors(
        direction=bounds.NEGLIGIBLE * np.ones((directions, 1)) * np.sin([own.narrowest for own in several]),
        spin=bounds.NEGLIGIBLE * spin[:, None] * each,
        joints=bounds.NEGLIGIBLE * angles,
        attitude=attitude,
    )
