"""Whole constellations: a Walker shell whose satellites switch their links, each of them planned.

    >>> shell = jp.walker("53:1584/72/39", 550.0)
    >>> switch = jp.link_switch(shell, sun_direction=[0.0, 0.9174771, 0.3977885])
    >>> print(jp.plan_constellation(switch, workers=2))

`shell` says where the satellites are, `links` whom their terminals point at and what is in the way; `switch`
makes planning problems of it, and `result` plans them and says what came of it.
"""

from jaxplan.constellation.links import default_topologies
from jaxplan.constellation.result import Constellation, ConstellationSummary, plan_constellation
from jaxplan.constellation.shell import Shell, walker
from jaxplan.constellation.switch import LinkSwitch, link_switch, relay_spacecraft

__all__ = [
    "Constellation",
    "ConstellationSummary",
    "LinkSwitch",
    "Shell",
    "default_topologies",
    "link_switch",
    "plan_constellation",
    "relay_spacecraft",
    "walker",
]
