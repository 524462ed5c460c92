"""How fast a goal of step 1 follows targets and zones that move: the rates at which tracking begins.

The goal as a function of time is the optimum of problem (7) with the targets and zones of each instant. Its
derivative (`sensitivity`) by their directions, times the rates of these, is the platform's angular velocity;
with it the joints' rates are those that keep every terminal on its target.
"""

import jax
import numpy as np

from jaxplan.decomposition.sensitivity import goal_in_time
from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Targets
from jaxplan.model.spacecraft import Spacecraft
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
        found = _followed(
            place,
            spacecraft,
            start_attitude,
            targets,
            cones,
            target_rates=target_rates,
            axis_rates=axis_rates,
        )
        return np.asarray(found.angular_velocity), np.asarray(found.joint_rates)


_followed = quick_jit(goal_in_time)
