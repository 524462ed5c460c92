"""Margins of devices to zones over a motion, for figures and lists of events.

A *pair* is a device (or a further direction that zones bind) with a zone, or with a group of zones of which
one entry must hold. Its margin in rad, positive where it is clear, is at each instant that of the zone, or of
the entry of the group that holds best then. If that entry does not bind the device there is no margin, which
is NaN. So the least of all margins at an instant is that of the scene. In shapes, k is a number of instants,
p of pairs, Z of rows of the constraints, S of sights, and 2n + d of joint angles.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from jaxplan.geometry.vectors import min_of_numbers
from jaxplan.model.constraints import Constraints, chosen_entries, state_margins
from jaxplan.model.directions import Sights
from jaxplan.model.scenario import Scenario
from jaxplan.model.tabulation import bound_by
from jaxplan.model.zones import Zone

_NUMBERS_PER_BLOCK = 2**21  # about as many numbers of a table are computed at once


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A device and a zone, or group of zones, that it must keep.

    Attributes:
        device: number of the device; numbers beyond the devices are further directions that zones bind, in
            the order of `Scenario.sight_names`. Edges of a field of view count as their device.
        zone: name of the zone or of the group.
        leader: the zone; for a group the first zone of it.
        rows: numbers of those rows of the scenario's constraints that the pair is made of.
    """

    device: int
    zone: str
    leader: Zone
    rows: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ZoneMargins:
    """The margins of a scenario's devices to its zones.

    Attributes:
        scenario: whose zones are meant; margins are reduced by the errors of attitude and joints that it
            states.
    """

    scenario: Scenario

    @cached_property
    def _constraints(self) -> Constraints:
        return self.scenario.constraints

    @cached_property
    def _sights(self) -> Sights:
        craft = self.scenario.spacecraft
        return self._constraints.sights(craft.gimbals, craft.fixed_boresights)

    @cached_property
    def _sight_devices(self) -> np.ndarray:
        """For each of the S sights, the number of the device to which its margins count."""
        return np.array(bound_by(self.scenario.zones, self.scenario.spacecraft).owners, int)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """All pairs of devices and zones that bind them, zone by zone."""
        rows, found = self._constraints, []
        for leader in np.unique(rows.group[rows.zone >= 0]):
            zone = self.scenario.zones[rows.zone[leader]]
            members = [[int(row)] for row in np.flatnonzero(rows.group == leader)]
            single = bool(rows.single[leader])
            if not single:
                members = [list(chain(*members))]
            for own in members:
                bound = np.any(rows.bound[own], axis=0)
                name = zone.name if single else zone.any_of or zone.name
                found += [
                    Pair(device=int(device), zone=name, leader=zone, rows=tuple(own))
                    for device in np.unique(self._sight_devices[bound])
                ]
        return tuple(found)

    def at(self, times: np.ndarray, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Compute the margins in states of a motion.

        Args:
            times: (k,) s, at which zones that move are taken.
            attitudes: (k, 3, 3) body to inertial.
            joints: (k, 2n + d) rad.

        Returns:
            (k, p) rad, a column for each of `pairs`, zero or more is clear; NaN where a group's best entry
            does not bind the device.

        Raises:
            ValueError: at a time at which a zone that moves is not known.
        """
        rows = self._constraints
        count = len(times)
        step = max(1, _NUMBERS_PER_BLOCK // max(1, len(rows.zone) * max(len(rows.zone), rows.bound.shape[1])))
        parts = [slice(first, first + step) for first in range(0, count, step)]
        found = [self._margins_of_block(times[own], attitudes[own], joints[own]) for own in parts]
        return np.concatenate([np.zeros((0, len(self.pairs))), *found])

    def _margins_of_block(self, times: np.ndarray, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Do the same as `at` for all states at once, without cutting them into blocks."""
        rows = self._constraints
        table = np.asarray(state_margins(rows, self._sights, attitudes, joints, times))  # (k, Z, S)
        chosen = chosen_entries(rows, np.min(table, axis=-1, initial=np.inf)) == rows.entry  # (k, Z)
        table = np.where(chosen[..., None] & rows.bound, table, np.nan)
        found = np.empty((len(times), len(self.pairs)))
        for place, pair in enumerate(self.pairs):
            own = table[:, list(pair.rows)][:, :, self._sight_devices == pair.device]
            found[:, place] = min_of_numbers(own, axis=(1, 2))
        return found
