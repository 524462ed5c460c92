"""The paper's four cases, as files that can be read, copied and changed.

Their numbers are those printed in section 5; each file says which table or equation they are from.
"""

from importlib import resources
from pathlib import Path

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.schema import load_scenario

CASE_NAMES = ("case-1", "case-2", "case-3", "case-4")


def case_path(name: str) -> Path:
    """Path of the scenario file of a case.

    Args:
        name: one of `CASE_NAMES`.

    Raises:
        ValueError: there is no such case.
    """
    if name not in CASE_NAMES:
        raise ValueError(f"name = {name!r}: must be one of {', '.join(CASE_NAMES)}")
    return Path(str(resources.files(__package__) / f"{name}.toml"))


def paper_case(number: int) -> Scenario:
    """Read one of the paper's four cases.

    Args:
        number: 1 or 2 with keep-out zones alone, 3 or 4 with a keep-in zone for terminal 1.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ValueError: the paper has no such case.
    """
    if type(number) not in (int, np.int64) or number not in (1, 2, 3, 4):
        raise ValueError(f"number = {number!r}: must be 1, 2, 3 or 4")
    return load_scenario(case_path(f"case-{number}"))
