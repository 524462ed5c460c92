"""Planning for whole constellations: Walker shells whose satellites change their links once, or all day long.

    >>> shell = jp.walker("53:1584/72/39", 550.0)
    >>> switch = jp.link_switch(shell, sun_direction=[0.0, 0.9174771, 0.3977885])
    >>> print(jp.plan_constellation(switch, workers=2))
    >>> day = jp.link_schedule(shell, epoch="2026-06-20T09:30:00", duration_s=86400.0)
    >>> print(jp.plan_fleet(day, "fleet", workers=2))

For a single change of links (a *switch*): `shell` computes where the satellites are, `links` which satellite
each terminal points at and what blocks the view, `switch` makes a planning problem for each satellite, and
`result` plans these problems and summarizes the plans.

For links that change over hours: `link_schedules` lists the links step by step (by default those of the
`Mesh` between neighbouring satellites), `fleet` plans each satellite from an order of `orders`, and
`fleet_folder` keeps the plans on disk.
"""

from jaxplan.constellation.fleet import Fleet, load_fleet, plan_fleet
from jaxplan.constellation.link_schedules import LinkSchedule, Span, link_schedule
from jaxplan.constellation.links import default_topologies
from jaxplan.constellation.result import Constellation, ConstellationSummary, plan_constellation
from jaxplan.constellation.shell import Shell, walker
from jaxplan.constellation.switch import LinkSwitch, link_switch, relay_spacecraft

__all__ = [
    "Constellation",
    "ConstellationSummary",
    "Fleet",
    "LinkSchedule",
    "LinkSwitch",
    "Shell",
    "Span",
    "default_topologies",
    "link_schedule",
    "link_switch",
    "load_fleet",
    "plan_constellation",
    "plan_fleet",
    "relay_spacecraft",
    "walker",
]
