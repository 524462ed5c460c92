"""What the certificate is asked: about one trajectory, about many, and about every margin of one."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jaxplan.certificate import errors, form
from jaxplan.certificate.cases import Case, negligible, prove_alike
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import Motion
from jaxplan.certificate.report import Claim, EndState, ProvedMargin, Report, every_sight
from jaxplan.runtime.batching import grouped

if TYPE_CHECKING:
    from jaxplan.model.constraints import Constraints
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory

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


def certify_batch(claims: Sequence[Claim]) -> list[Report]:
    """What `certify` says of each of many trajectories, in less time."""
    reports: dict[int, Report] = {}
    cases: list[tuple[int, Case]] = []
    with np.errstate(all="ignore"):  # NaN and infinities are found by their values
        for number, claim in enumerate(claims):
            case = Case.of(claim)
            if isinstance(case, Report):
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
        evidence = errors.gather(motion, negligible(spacecraft, [bindings]), list(bindings.ways.values()))
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
