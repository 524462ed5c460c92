"""The paper's four cases and two example timelines, as files that can be read, copied and changed.

The numbers of the cases are those printed in section 5; each file says which table or equation they are from.
"""

from importlib import resources
from pathlib import Path

import numpy as np

from jaxplan.model.activities import Timeline
from jaxplan.model.scenario import Scenario
from jaxplan.schema import load_scenario, load_timeline

CASE_NAMES = ("case-1", "case-2", "case-3", "case-4")
TIMELINE_NAMES = ("case-day", "case-imaging")
"""Names of timelines: a day of a link satellite, and two orbits of an Earth observer."""


def case_path(name: str) -> Path:
    """Path of the file of a case or an example timeline.

    Args:
        name: one of `CASE_NAMES` or `TIMELINE_NAMES`.

    Raises:
        ValueError: if there is no such case.
    """
    if name not in (*CASE_NAMES, *TIMELINE_NAMES):
        raise ValueError(f"name = {name!r}: must be one of {', '.join((*CASE_NAMES, *TIMELINE_NAMES))}")
    return Path(str(resources.files(__package__) / f"{name}.toml"))


def paper_case(number: int) -> Scenario:
    """Read one of the paper's four cases.

    Args:
        number: 1 or 2, with keep-out zones only; 3 or 4, with a keep-in zone for terminal 1 too.

    Returns:
        The scenario, in radians and seconds.

    Raises:
        ValueError: if the paper has no such case.
    """
    if type(number) not in (int, np.int64) or number not in (1, 2, 3, 4):
        raise ValueError(f"number = {number!r}: must be 1, 2, 3 or 4")
    return load_scenario(case_path(f"case-{number}"))


def example_timeline(name: str) -> Timeline:
    """Read one of the timelines that come with the package; needs the extra ``orbit``.

    Args:
        name: ``"case-day"``, 24 hours of a satellite with four links that switch every 15 minutes; or
            ``"case-imaging"``, images and downlinks of two orbits.

    Returns:
        The timeline, in radians and seconds.

    Raises:
        ValueError: if there is no such timeline.

    Example:
        >>> day = jp.plan_timeline(jp.example_timeline("case-imaging"))
    """
    if name not in TIMELINE_NAMES:
        raise ValueError(f"name = {name!r}: must be one of {', '.join(TIMELINE_NAMES)}")
    return load_timeline(case_path(name))
