"""Proof that a trajectory keeps every margin and every limit at all times, or a list of what fails.

It reads only what a trajectory is (charts, breaks, polynomial coefficients) and evaluates it anew in plain
numpy, from the definition of the curve; it shares no code with the making of trajectories. On short
intervals everything is replaced by polynomials through samples. Bounds of higher derivatives, taken from the
coefficients, say how far those may be off, and subdivision bounds the polynomials (both `bounds`). So
what is reported holds for all times and not for samples. Zones that move are taken as they move (`motion`).

Allowances. A margin is certified from -1e-9 rad on, a limit up to 1 + 1e-9 of it. What the polynomials leave
out is kept to a hundredth of that (it is counted into the bounds, so that a margin of exactly zero reads as
about -1e-11), and evaluation in float64 errs by less than a thousandth, 1e-12, as the tests show against
extended precision; an estimate of it is counted in as well.
"""

from jaxplan.certificate.claims import (
    Certificate,
    Claim,
    EndState,
    ProvedMargin,
    faults_later,
    margin_and_peaks,
)
from jaxplan.certificate.proof import LIMIT_ALLOWANCE, MARGIN_ALLOWANCE, certify, certify_batch, prove_margins

Report = Certificate  # its name before

__all__ = [
    "LIMIT_ALLOWANCE",
    "MARGIN_ALLOWANCE",
    "Certificate",
    "Claim",
    "EndState",
    "ProvedMargin",
    "Report",
    "certify",
    "certify_batch",
    "faults_later",
    "margin_and_peaks",
    "prove_margins",
]
