"""A decorator by which measures of a trajectory accept plans.

A plan may be given in place of its trajectory; then its own spacecraft and zones are used where none are
given.
"""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

from jaxplan.model.constraints import Constraints
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import expect
from jaxplan.trajectory.curve import Trajectory

Out = TypeVar("Out")

# Arguments that a plan's scene supplies: their classes, and functions that get them from the scene.
_SCENE_ARGUMENTS: dict[str, tuple[type, Callable[[Any], Any]]] = {
    "craft": (Spacecraft, lambda scene: scene.spacecraft),
    "cones": (Constraints, lambda scene: scene.constraints),
}


def of_plans(measure: Callable[..., Out]) -> Callable[..., Out]:
    """Make a measure of a trajectory, its first argument, accept a plan in place of the trajectory.

    With a plan the arguments ``craft`` and ``cones`` may be left out; those of the plan are then used.
    """
    parameters = signature(measure)
    wanted = [name for name in _SCENE_ARGUMENTS if name in parameters.parameters]

    @wraps(measure)
    def called(*args: Any, **kwargs: Any) -> Out:
        given = dict(parameters.bind_partial(*args, **kwargs).arguments)
        plan = given.get("trajectory")
        if "trajectory" in given and not isinstance(plan, Trajectory):
            given["trajectory"] = _trajectory_of(plan)
            scene = getattr(plan, "scenario", getattr(plan, "scene", None))
            for name in wanted:
                given.setdefault(name, _SCENE_ARGUMENTS[name][1](scene))
        for name in wanted:
            if name in given:
                kind = _SCENE_ARGUMENTS[name][0]
                hint = f"of a plan {name} may be left out, and what comes after is told by its name"
                expect(name, given[name], kind, hint)
        return measure(**given)

    return called


def _trajectory_of(plan: object) -> Trajectory:
    """Return the trajectory of a plan, or the argument itself if it is a trajectory.

    Raises:
        TypeError: if it is neither.
        ValueError: if the plan has no trajectory.
    """
    found = getattr(plan, "trajectory", plan)
    if found is None and plan is not None:
        ending = getattr(getattr(plan, "status", None), "name", "without one")
        raise ValueError(f"trajectory: the plan has none, it ended as {ending}")
    if isinstance(found, Trajectory):
        return found
    return expect("trajectory", plan, Trajectory, "a plan may stand for its own")
