"""Proof that a trajectory keeps every margin and every limit at all times, or a list of what fails.

The certificate reads only what defines a trajectory (charts, breaks, polynomial coefficients) and evaluates
it anew in plain numpy; it shares no code with what makes trajectories. On short intervals everything is
replaced by polynomials through samples. Bounds of higher derivatives, taken from the coefficients, say how
far these may be off, and subdivision bounds the polynomials (both in `bounds`). So what is reported holds for
all times and not only for samples. Moving zones are evaluated as they move (`motion`).

Allowances. A margin counts as kept from -1e-9 rad on, and a limit up to 1 + 1e-9 times its value. The errors
of the polynomials are kept to a hundredth of these allowances and are counted into the bounds, so that a
margin of exactly zero reads as about -1e-11. Evaluation in float64 errs by less than a thousandth, 1e-12, as
the tests show against extended precision; an estimate of that error is counted in as well.
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
