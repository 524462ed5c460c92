"""By how much tables may fall short: the one rule for exports and checks.

Between rows, a reader's motion differs from the one that was certified. A plan that touches a zone or a
limit, as the shortest ones do, leaves no margin for that, and with rows a tenth of a second apart the
reader's motion is some 1e-4 deg inside the zone. So a table may fall short by a little, which is *forgiven*:
reported with it, but not a failure. How much may be set, down to nothing. Jumps, and whatever cannot be
evaluated, are never forgiven.
"""

from typing import NamedTuple

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.certificate.limits import TOLERANCE
from jaxplan.runtime.arguments import number

FORGIVE_DEG = 1e-3
"""deg: by which a table may fall short of a margin of zero, unless told."""
FORGIVE_PERCENT = 0.5
"""Percent of a limit by which its peaks may exceed it, unless told."""
MOST_DEG, MOST_PERCENT = 1.0, 10.0
_JUMPS_BY_ORDER = (("attitude", "joints"), ("angular_velocity", "joint_rates"))  # by order of the derivative


class Forgiven(NamedTuple):
    """By how much a table may fall short.

    Attributes:
        deg: deg, by which margins to zones may be negative.
        percent: percent, by which limits and ranges may be exceeded.
    """

    deg: float = FORGIVE_DEG
    percent: float = FORGIVE_PERCENT

    @property
    def words(self) -> str:
        """Both numbers in words, or "nothing"."""
        if self.deg == 0 and self.percent == 0:
            return "nothing"
        return f"{self.deg:g} deg of margins and {self.percent:g} % of limits"

    def covers(self, proof: Certificate, continuous: int) -> bool:
        """Tell whether everything that a certificate finds fault with is forgiven.

        Args:
            proof: a certificate with faults.
            continuous: number of derivatives that must not jump; -1 where attitudes may jump.
        """
        margin = proof.min_margin
        short = margin is not None and not margin >= -np.deg2rad(self.deg)
        over = not all(peak <= 1 + self.percent / 100 for peak in proof.peaks.values())
        steps = [proof.jumps.get(name, 0.0) for names in _JUMPS_BY_ORDER[: continuous + 1] for name in names]
        jumps = not all(step <= TOLERANCE for step in steps)
        illegible = not proof.peaks  # whatever could be evaluated has some
        return not (short or over or jumps or illegible)


NOTHING = Forgiven(0.0, 0.0)


def forgiven(deg: object, percent: object) -> Forgiven:
    """Check by how much a table may fall short, and return it as `Forgiven`.

    Args:
        deg: deg, by which margins may be negative, in [0, 1].
        percent: percent, by which limits may be exceeded, in [0, 10].

    Raises:
        ValueError: if one is no number, or out of its range.
    """
    found = []
    for name, value, most in (("forgive_deg", deg, MOST_DEG), ("forgive_percent", percent, MOST_PERCENT)):
        found.append(number(name, value, f"a number in [0, {most:g}]"))
        if not 0 <= found[-1] <= most:
            raise ValueError(f"{name} = {value}: must lie in [0, {most:g}]")
    return Forgiven(*found)
