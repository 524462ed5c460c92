"""What must stay as it was for an earlier plan to be kept up to an activity, and planned anew from there on.

What comes before that activity, and the start, must be the same as in the plan that is kept, since its motion
stays what it is; that it breaks nothing of what is asked now is proved anew.
"""

from collections.abc import Sequence
from dataclasses import fields

from jaxplan.model.equality import same
from jaxplan.model.timeline import Activity, Timeline, in_order
from jaxplan.runtime.arguments import expect
from jaxplan.schema.faults import nearest
from jaxplan.timeline.record import TimelinePlan


def first_again(timeline: Timeline, kept: TimelinePlan, name: str) -> int:
    """Number of the activity, in the order in which they are done, from which a timeline is planned anew.

    Args:
        timeline: that is planned.
        kept: an earlier plan, which is kept before that activity.
        name: of the activity.

    Raises:
        ValueError: if there is no such activity, or what comes before is not what was planned.
    """
    expect("after", kept, TimelinePlan, "jp.plan_timeline makes one")
    names = [one.name for one in in_order(timeline.activities)]
    if name not in names:
        raise ValueError(f"from_activity = {name!r}: no such activity, {nearest(name, names, 'names')}")
    first = names.index(name)
    if [one.name for one in kept.activities[:first]] != names[:first]:
        raise ValueError(f"after: the activities before {name} are not those of the timeline")
    _expect_the_same(timeline, kept, names[:first])
    return first


def _expect_the_same(timeline: Timeline, kept: TimelinePlan, names: Sequence[str]) -> None:
    """Raise a ValueError where activities of these names, or the start, are others in a kept plan."""
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
