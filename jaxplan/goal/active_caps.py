"""Caps that may be active at a goal of step 1, and which of them are.

What is asked at the goal is gathered as JAX arrays (`GoalState`), of which the caps follow (`assemble_caps`).
Which of them must be kept depends on the best entry of each constraint there (`caps_to_keep`), and which are
active on the quadratic program of the least turn (`active_caps`).

Attitudes are body to inertial, angles in radians, joints as in `jaxplan.model.spacecraft`. Shapes: J joints,
Z rows, m caps, k devices with targets, e equations.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import array_module, length
from jaxplan.goal import descent
from jaxplan.goal.aims import AZIMUTH, ELEVATION, Aims, Known, aims_of, goal_ranges, known_sights, pointed
from jaxplan.goal.descent import MET, angle_terms, cap_terms
from jaxplan.goal.pairs import cleared, pairs_at_goal, single_yaws
from jaxplan.model.constraints import Constraints, chosen_entries, state_margins
from jaxplan.model.directions import Sights, as_path
from jaxplan.model.gimbals import TURN
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft


class GoalState(NamedTuple):
    """What is asked at the goal, as JAX arrays.

    Attributes:
        aims: of devices with targets, with equations met exactly.
        asked: `aims` and those of wishes that are met.
        rows: all constraints.
        sights: the directions that the rows bind.
        rest: (J,) rad, joints of devices without a target.
    """

    aims: Aims
    asked: Aims
    rows: Constraints
    sights: Sights
    rest: Array

    @classmethod
    def of(
        cls,
        spacecraft: Spacecraft,
        targets: Targets,
        cones: Constraints,
        rest: Array,
        dtype: jnp.dtype,
        met: Sequence[int] = (),
    ) -> "GoalState":
        """Make the arrays by which a goal is differentiated, with all directions brought to unit length.

        Args:
            spacecraft: with the devices that point.
            targets: their directions.
            cones: the constraints.
            rest: (J,) rad, joints of devices without a target.
            dtype: type of all numbers.
            met: places in `targets.prefer` of the wishes that are met.
        """

        def aims_at(targets: Targets) -> Aims:
            aims = aims_of(spacecraft, targets, goal_ranges(spacecraft, targets))
            directions = normalise(jnp.asarray(aims.directions, dtype))
            frames, ranges = (jnp.asarray(part, dtype) for part in (aims.frames, aims.ranges))
            return replace(aims, directions=directions, frames=frames, ranges=ranges)  # type: ignore[arg-type]

        aims = asked = aims_at(targets)
        if met:
            asked = aims_at(with_met(targets, spacecraft, met))
        parts: dict[str, Any] = {
            name: normalise(jnp.asarray(getattr(cones, name), dtype)) for name in ("axis", "body")
        }
        parts |= {
            name: jnp.asarray(getattr(cones, name), dtype) for name in ("side", "half_angle", "carried")
        }
        rows = replace(cones, **parts)  # typed as numpy's, here JAX arrays
        boresights = normalise(jnp.asarray(spacecraft.fixed_boresights, dtype))
        gimbals = jax.tree.map(lambda part: jnp.asarray(part, dtype), spacecraft.gimbals)
        return cls(aims=aims, asked=asked, rows=rows, sights=rows.sights(gimbals, boresights), rest=rest)

    @property
    def known(self) -> Known:
        """The directions of sights that are known whatever the attitude."""
        return known_sights(self.aims, self.sights, self.rest)

    def cleared(self, clearance: ArrayLike) -> "GoalState":
        """Return the state with its rows tightened by the goal's clearance, rad, as in step 1."""
        pairs = pairs_at_goal(self.rows, self.sights, self.known, self.rest)
        wanted = jnp.asarray(clearance, self.rest.dtype)
        return self._replace(rows=cleared(self.rows, pairs, wanted))

    @property
    def columns(self) -> slice | np.ndarray:
        """The numbers of the sights that may make caps with rows."""
        count = self.sights.gimbals.count
        if self.rows.inner or self.aims.held:
            return slice(None)
        aimed = np.isin(np.arange(self.sights.count), self.aims.devices)
        return np.flatnonzero((np.arange(self.sights.count) >= count) & ~aimed)


class GoalCaps(NamedTuple):
    """The m caps that may be active at a goal, in the form of `caps.Caps`, with an empty one at the end.

    First come the caps of the k largest azimuths, then of the k largest elevations, likewise of the least
    ones; then for each row one cap for each sight of `GoalState.columns`.
    """

    axis: Array  # (m, 3) unit vectors in body axes
    direction: Array  # (m, 3) unit vectors in the body axes of the start
    half_angle: Array  # (m,) rad


def assemble_caps(state: GoalState, start: Array) -> GoalCaps:
    """Return all caps of a problem, for a start attitude (3, 3), body to inertial."""
    aims, dtype, own = state.asked, start.dtype, state.columns
    frames, (low, high) = jnp.asarray(aims.frames), jnp.moveaxis(jnp.asarray(aims.ranges), -1, 0)
    edges = jnp.stack([high[:, AZIMUTH] + jnp.pi / 2, low[:, AZIMUTH] - jnp.pi / 2])  # (2, k)
    of_azimuth = jnp.cos(edges)[..., None] * frames[..., 0] + jnp.sin(edges)[..., None] * frames[..., 1]
    up, flat = frames[..., 2], jnp.full(len(frames), jnp.pi / 2, dtype)
    of_aims = jnp.concatenate([of_azimuth[0], up, of_azimuth[1], -up])
    half_angles = [flat, flat - high[:, ELEVATION], flat, flat + low[:, ELEVATION]]
    pairs = pairs_at_goal(state.rows, state.sights, state.known, state.rest)
    end = jnp.zeros((1, 3), dtype)
    directions = jnp.asarray(aims.directions)
    return GoalCaps(
        axis=jnp.concatenate([of_aims, pairs.axis[:, own].reshape(-1, 3), end]),
        direction=jnp.concatenate([jnp.tile(directions, (4, 1)), pairs.direction[:, own].reshape(-1, 3), end])
        @ start,
        half_angle=jnp.concatenate([*half_angles, pairs.half_angle[:, own].ravel(), end[:, 0]]),
    )


def caps_to_keep(attitude: Array, state: GoalState) -> Array:
    """Tell which of the m caps must be kept at an attitude (3, 3), body to inertial, as (m,) bool.

    Of a range it is the cap of the nearer end, of a constraint those of its best entry.
    """
    aims, rows = state.asked, state.rows
    ranges, angles = jnp.asarray(aims.ranges), jnp.stack(aims.angles(attitude), axis=-1)  # (k, 2)
    above = angles >= jnp.mean(ranges, axis=-1)
    equations = np.array(aims.equations, bool).reshape(-1, 2)
    limited = jnp.stack(
        [ranges[:, AZIMUTH, 1] - ranges[:, AZIMUTH, 0] < TURN, jnp.ones(len(ranges), bool)], -1
    )
    upper, lower = ((part & limited) | equations for part in (above, ~above))

    joints = pointed(state.sights.gimbals, state.aims, attitude, state.rest)
    margins = state_margins(rows, state.sights, attitude, joints)
    chosen = chosen_entries(rows, jnp.min(margins, axis=-1, initial=jnp.inf))
    capped = pairs_at_goal(rows, state.sights, state.known, state.rest).capped
    capped = capped & (rows.entry == chosen)[:, None]
    if rows.inner:  # a yaw more than a quarter turn off its bound may be on the other side of its plane
        capped = capped & ~(single_yaws(rows)[:, None] & (margins > jnp.pi / 2))
    of_rows = capped[:, state.columns]
    return jnp.concatenate([upper.T.ravel(), lower.T.ravel(), of_rows.ravel(), jnp.zeros(1, bool)])


def equation_cap_numbers(aims: Aims) -> np.ndarray:
    """Return the numbers in `GoalCaps` of the upper and lower caps of the e equations, as rows (2, e)."""
    above = np.flatnonzero(np.array(aims.equations, bool).reshape(-1, 2).T)
    return np.stack([above, above + 2 * len(aims.devices)])


def active_caps(turn: Array, caps: GoalCaps, matter: Array, aims: Aims) -> tuple[Array, Array]:
    """Find the caps that are active at the goal found, with their multipliers.

    They come from the quadratic program of the least turn with the caps taken as linear. At an optimum its
    solution is zero; where more than three caps are touched, it chooses. Of an equation the active cap is the
    one on the side to which the turn would leave it, if any, else the upper one, with multiplier zero.

    Args:
        turn: (4, 1) quaternion of the turn from the start to the goal found.
        caps: all m caps.
        matter: (m,) bool, which caps must be kept.
        aims: with the equations.

    Returns:
        Their numbers (3,), -1 for a free slot, and multipliers (3,).
    """
    _, eta, _ = angle_terms(turn)
    _, excess, gradients = cap_terms(turn, *caps)
    of_equations, below = equation_cap_numbers(aims)
    excess = excess.at[np.concatenate([of_equations, below])].set(0.0)
    excess = jnp.where(matter[:, None], excess, MET)
    identity = jnp.eye(3, dtype=turn.dtype)
    _, active, _ = descent.solve(identity[:, :, None], eta, gradients, excess)
    number, multiplier = active.number[:, 0], active.multiplier[:, 0]
    for upper, lower in zip(of_equations.tolist(), below.tolist(), strict=True):
        missing = ~jnp.any((number == upper) | (number == lower))
        slot = jnp.argmin(number)  # a free one, if any
        put = missing & (number[slot] < 0)
        number = jnp.where(put & (np.arange(3) == slot), upper, number)
    return number, multiplier


def with_met(targets: Targets, spacecraft: Spacecraft, met: Sequence[int]) -> Targets:
    """Return targets at an instant with the wishes in places `met` of `targets.prefer` as further targets."""
    wishes = [targets.prefer[place] for place in met]
    directions = [*targets.directions, *(as_path(wish.direction).at(0.0) for wish in wishes)]
    names = (*targets.names(spacecraft), *(wish.device for wish in wishes))
    return replace(targets, devices=names, directions=array_module(*directions).stack(directions))


def normalise(vectors: Array) -> Array:
    """Return vectors (..., 3) brought to unit length."""
    return vectors / length(vectors)[..., None]
