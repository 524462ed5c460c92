"""Joining certificates: those of the parts of a table, and those of two interpolations of one table."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.certificate import Certificate, faults_later


def joined_proof(proofs: Sequence[tuple[float, Certificate]]) -> Certificate:
    """Join the certificates of a table's parts to one of the whole table.

    A peak, jump or margin that is NaN counts as the worst. Where nothing of a part could be evaluated, the
    whole has no peaks.

    Args:
        proofs: for each part the time, s, at which it begins, and its certificate.
    """
    peaks: dict[str, float] = {}
    jumps: dict[str, float] = {}
    for _, proof in proofs:
        for kept, own in ((peaks, proof.peaks), (jumps, proof.jumps)):
            for name, value in own.items():
                kept[name] = float(np.maximum(kept.get(name, value), value))  # which keeps what is no number
    bound = [(begin, proof) for begin, proof in proofs if proof.min_margin is not None]
    whole = Certificate(
        certified=all(proof.certified for _, proof in proofs),
        peaks=peaks if all(proof.peaks for _, proof in proofs) else {},
        jumps=jumps,
        faults=tuple(
            fault
            for begin, proof in proofs
            for fault in (faults_later(proof, begin) if begin else proof.faults)
        ),
        evaluations=sum(proof.evaluations for _, proof in proofs),
    )
    if not bound:
        return whole
    begin, least = min(bound, key=lambda pair: np.nan_to_num(np.float64(pair[1].min_margin), nan=-np.inf))
    assert least.worst_time is not None
    return replace(
        whole,
        min_margin=least.min_margin,
        worst_time=least.worst_time + begin,
        worst_device=least.worst_device,
        worst_zone=least.worst_zone,
    )


def with_margins(proof: Certificate, also: Certificate, how: str) -> Certificate:
    """Join proofs of two interpolations of a table: the smaller margin, the larger peaks, all faults.

    Args:
        proof: certificate for the main interpolation, whose jumps and other numbers are kept.
        also: certificate for the other interpolation.
        how: its name, which is prefixed to its faults.
    """
    told = tuple(f"with {how.replace('_', ' ')} between rows: {fault}" for fault in also.faults)
    peaks = {name: float(np.maximum(peak, also.peaks.get(name, peak))) for name, peak in proof.peaks.items()}
    found = replace(
        proof, certified=proof.certified and also.certified, faults=(*proof.faults, *told), peaks=peaks
    )
    own, other = proof.min_margin, also.min_margin
    if other is None or (own is not None and (other >= own or np.isnan(own))):
        return found
    names = ("min_margin", "worst_time", "worst_device", "worst_zone")
    return replace(found, **{name: getattr(also, name) for name in names})
