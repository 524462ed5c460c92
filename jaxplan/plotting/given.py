"""What figures are given: anything that cannot be drawn is refused by the name of its argument."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jaxplan.given import as_floats, expect, show
from jaxplan.model.spacecraft import Spacecraft

if TYPE_CHECKING:
    from jaxplan.planner import Plan


def expect_plan(plan: object) -> "Plan":
    """A plan of any status; a TypeError for anything else."""
    from jaxplan.planner import Plan

    return expect("plan", plan, Plan, "jp.plan makes one, jp.load_plan reads one")


def expect_trajectories(given: object, spacecraft: object) -> None:
    """Raise a TypeError for what are no trajectories by their names, or no spacecraft."""
    from jaxplan.trajectory.curve import Trajectory

    for name, trajectory in expect_mapping("trajectories", given).items():
        advice = "a plan has one as plan.trajectory"
        expect(f"trajectories[{name!r}]", trajectory, Trajectory, advice)
    expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")


def expect_mapping(name: str, value: object) -> Mapping[Any, Any]:
    """A dict by names; a TypeError for anything else."""
    if isinstance(value, Mapping):
        return value
    raise TypeError(f"{name} must be a dict by names, not {type(value).__name__}")


def expect_view(view: object) -> None:
    """Raise a ValueError for what are no two angles."""
    angles = as_floats(view)
    if angles is None or angles.shape != (2,):
        raise ValueError(f"view = {show(view)}: must be azimuth and elevation of the eye, deg, or None")
