"""How fast a goal of step 1 follows targets and zones that move: the rates at which tracking begins.

The goal as a function of time is the optimum of problem (7) with the targets and zones of each instant. Its
derivative (`sensitivity`) by their directions, times the rates of these, is the platform's angular velocity;
with it the joints' rates are those that keep every terminal on its target.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.decomposition.sensitivity import differentiable_goal
from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Targets
from jaxplan.model.spacecraft import Spacecraft, joints_toward
from jaxplan.runtime.quick_jit import quick_jit


def tracking_rates(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    cones: Constraints,
    *,
    target_rates: np.ndarray,
    axis_rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Rates of platform and joints at a goal, with which it follows what moves.

    Args:
        goal: one that `decompose` found for this problem.
        spacecraft: terminals and instruments.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: where they are when the manoeuvre ends, with limits.
        cones: all constraints as they are then.
        target_rates: (n, 3) 1/s, derivatives of the targets' directions.
        axis_rates: (Z, 3) 1/s, those of the cones' axes; zero for all that are not inertial.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (2n,) joint rates, rad/s: together they turn every
        terminal's beam as its target turns, exactly. Where the optimum has no derivative, the platform's is
        the one that `differentiable_goal` chooses.
    """
    place = Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle)
    with jax.enable_x64(True):
        found = _rates(place, spacecraft, start_attitude, targets, cones, target_rates, axis_rates)
        spin, rates = (np.asarray(part) for part in found)
    return spin, rates


@quick_jit
def _rates(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: Array,
    targets: Targets,
    cones: Constraints,
    target_rates: Array,
    axis_rates: Array,
) -> tuple[Array, Array]:
    def attitude(directions: Array, axes: Array) -> Array:
        moved: Targets = replace(targets, directions=directions)
        zones: Constraints = replace(cones, axis=axes)  # type: ignore[arg-type]
        return jnp.asarray(differentiable_goal(goal, spacecraft, start_attitude, moved, zones).attitude)

    directions, axes = jnp.asarray(targets.directions), jnp.asarray(cones.axis)
    _, turning = jax.jvp(attitude, (directions, axes), (target_rates, axis_rates))
    found = jnp.asarray(goal.attitude)
    spin = so3.vee(found.T @ turning)
    _, rates = jax.jvp(
        lambda attitude, directions: joints_toward(spacecraft.mounts, attitude, directions),
        (found, directions),
        (found @ so3.hat(spin), target_rates),
    )
    return spin, rates
