"""What must be unchanged for an earlier plan to be kept up to an activity and continued from there.

The start, and all before that activity, must be the same as in the plan that is kept, since its motion is
reused. That it breaks nothing of what is asked now is proved anew.
"""

from collections.abc import Sequence
from dataclasses import fields

from jaxplan.model.activities import Activity, Timeline, in_order
from jaxplan.model.equality import same
from jaxplan.runtime.arguments import expect
from jaxplan.schema.faults import nearest
from jaxplan.timeline.record import TimelinePlan


def first_again(timeline: Timeline, kept: TimelinePlan, name: str) -> int:
    """Return the index of the activity, in order of execution, from which a timeline is planned anew.

    Args:
        timeline: the timeline to plan.
        kept: an earlier plan, which is kept before that activity.
        name: name of the activity.

    Raises:
        ValueError: if there is no such activity, or if what comes before it is not what was planned.
    """
    expect("after", kept, TimelinePlan, "jp.plan_timeline makes one")
    names = [one.name for one in in_order(timeline.activities)]
    if name not in names:
        raise ValueError(f"from_activity = {name!r}: no such activity, {nearest(name, names, 'names')}")
    first = names.index(name)
    if [one.name for one in kept.activities[:first]] != names[:first]:
        raise ValueError(f"after: the activities before {name} are not those of the timeline")
    _expect_unchanged(timeline, kept, names[:first])
    return first


def _expect_unchanged(timeline: Timeline, kept: TimelinePlan, names: Sequence[str]) -> None:
    """Raise ValueError if the start, or an activity of these names, differs from that in a kept plan."""
    were, are = ({one.name: one for one in own.activities} for own in (kept.timeline, timeline))
    for own in names:
        changed = [
            part.name
            for part in fields(Activity)
            if not same(getattr(were.get(own), part.name, None), getattr(are[own], part.name))
        ]
        if changed:
            raise ValueError(
                f"after: activity {own} differs from the one that was planned in "
                f"{', '.join(changed)}: plan anew from it on, by from_activity, or leave it as it was"
            )
    if not same(kept.timeline.scene.start, timeline.scene.start):
        raise ValueError("after: the start differs from the one that was planned: plan the whole timeline")
