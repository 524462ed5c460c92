"""The problem of step 1 as data: aims of a goal, constraints, and wishes of devices without a target.

Attitudes are body to inertial. Shapes: J joints, Z rows, S sights.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import azimuth_elevation, pointing, separation
from jaxplan.goal.aims import Aims, Known, aims_of, box_of, goal_ranges, known_sights, pointed
from jaxplan.goal.pairs import Pairs, open_pairs, pairs_at_goal
from jaxplan.model.constraints import Constraints, state_margins
from jaxplan.model.directions import Sights, as_path
from jaxplan.model.gimbals import in_range
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate


class Wished(NamedTuple):
    """A direction that a device without a target shall come near to.

    Attributes:
        device: number of the device.
        kind: "instrument", "drive" or "terminal".
        direction: (3,) inertial unit vector.
        frame: (3, 3) rotation from the device's axes to body axes.
        box: (2, 2) rad, ranges of azimuth and elevation in these axes in which it can point, see
            `aims.box_of`.
        reach: rad, the largest angle allowed between the direction and the nearest one that the device can
            point in.
    """

    device: int
    kind: str
    direction: np.ndarray
    frame: np.ndarray
    box: np.ndarray
    reach: float = np.pi

    @classmethod
    def all_of(cls, craft: Spacecraft, targets: Targets, ranges: np.ndarray) -> list[Self]:
        """Return all wishes of targets at an instant, in order.

        `ranges` (J, 2) rad are those of the joints at the goal.
        """
        found = []
        for wish in targets.prefer:
            number = craft.device_names.index(wish.device)
            frame, box = box_of(craft, number, ranges, 0.0)
            kinds = ("terminal", len(craft.terminals)), ("drive", craft.gimbals.count)
            kind = next((kind for kind, end in kinds if number < end), "instrument")
            direction = np.asarray(as_path(wish.direction).at(0.0), float)
            found.append(cls(number, kind, direction, np.asarray(frame), np.asarray(box)))
        return found

    def distance(self, attitudes: np.ndarray) -> np.ndarray:
        """Return the angle (...) rad by which the device fails to reach the direction, zero if it does.

        For a terminal it is the larger of the angles by which its two joints would have to leave their
        ranges.

        Args:
            attitudes: (..., 3, 3) body to inertial.
        """
        body = self.direction @ attitudes
        if self.kind == "instrument":
            return np.asarray(separation(self.frame[:, 0], body))
        own = body @ self.frame
        azimuth, elevation = azimuth_elevation(own)
        azimuth = in_range(azimuth[..., None], self.box[:1])[..., 0]
        (low, high), (least, most) = self.box
        beside = np.maximum(np.maximum(low - azimuth, azimuth - high), 0)
        above = np.maximum(np.maximum(least - elevation, elevation - most), 0)
        if self.kind == "terminal":
            return np.maximum(beside, above)
        ends = np.min([separation(pointing(end, least), own) for end in (low, high)], axis=0)
        return np.where(beside > 0, ends, above)


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalProblem:
    """What is asked of the attitude at a goal.

    Attributes:
        spacecraft: its devices.
        start: (3, 3) attitude at the start, body to inertial, ``R0``.
        rest: (J,) rad, joints of devices without a target unless they make way. Yaws of the others are taken,
            among angles that differ by whole turns, nearest to theirs here.
        aims: what must point where.
        ranges: (J, 2) rad, ranges of the joints at the goal.
        rows: all constraints, at an instant.
        wishes: directions that devices without a target must be near to, each with its `reach`.
    """

    spacecraft: Spacecraft
    start: np.ndarray
    rest: np.ndarray
    aims: Aims
    ranges: np.ndarray
    rows: Constraints
    wishes: tuple[Wished, ...] = ()

    @classmethod
    def of(
        cls,
        spacecraft: Spacecraft,
        start: ArrayLike,
        targets: Targets,
        rows: Constraints | None = None,
        rest: ArrayLike | None = None,
    ) -> Self:
        """Make the problem that targets state.

        Args:
            spacecraft: its devices.
            start: (3, 3) attitude at the start, body to inertial.
            targets: targets at an instant.
            rows: the constraints; None for none.
            rest: (J,) rad, joints of devices without a target; None for zero.
        """
        ranges = np.asarray(goal_ranges(spacecraft, targets))
        return cls(
            spacecraft=spacecraft,
            start=np.asarray(start, float),
            rest=np.zeros(len(ranges)) if rest is None else np.asarray(rest, float),
            aims=aims_of(spacecraft, targets, ranges, float(targets.tolerance)),
            ranges=ranges,
            rows=tabulate((), (), spacecraft) if rows is None else rows,
        )

    @cached_property
    def sights(self) -> Sights:
        """The directions that the rows bind."""
        return self.rows.sights(self.spacecraft.gimbals, self.spacecraft.fixed_boresights)

    @cached_property
    def known(self) -> Known:
        """The directions of sights that are known whatever the attitude."""
        return known_sights(self.aims, self.sights, self.rest)

    @cached_property
    def pairs(self) -> "Pairs":
        """All pairs of a row and a sight, with what is settled and what the attitude decides on."""
        return pairs_at_goal(self.rows, self.sights, self.known, self.rest)

    def joints(self, attitudes: np.ndarray) -> np.ndarray:
        """Return joints (..., J) rad with devices pointing at their targets, at attitudes (..., 3, 3)."""
        return np.asarray(pointed(self.spacecraft.gimbals, self.aims, attitudes, self.rest))

    def margins(self, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Return margins (..., Z, S) rad of all pairs of Z rows and S sights, positive where kept.

        Args:
            attitudes: (..., 3, 3) body to inertial.
            joints: (..., J) rad.
        """
        return np.asarray(state_margins(self.rows, self.sights, attitudes, joints))

    def wider(self, by: float) -> "GoalProblem":
        """Return the problem without constraints and with ranges of aims and joints wider on both sides.

        `by` is the widening on either side, rad.
        """
        around = np.array([-by, by])
        nowhere = tabulate((), (), self.spacecraft)
        return replace(
            self,
            aims=replace(self.aims, ranges=self.aims.ranges + around),
            ranges=self.ranges + around,
            rows=nowhere,
        )


def leaves_open(problem: GoalProblem) -> bool:
    """Tell whether there are open pairs (`pairs.open_pairs`), which a goal found may break."""
    return bool(np.any(open_pairs(problem.rows, problem.pairs)))
