"""The rows of a timeline's figure: what is done when, and which device follows which target.

The top row has a bar for each activity; the others have a device each, with a bar while it follows a target.
A bar is pale while the target is followed before the window of its activity opens. Hatching shows when a
device's target is hidden: that of its activity under way or coming next, after the last one still that of the
last. Activities that could not be planned have a row of their own, outlined in red over the time in which
they were allowed, each after the one before it.

A name stands in its bar or, where it does not fit, beside it. Activities without room for that have their
names turned by 90 deg in a *lane* above the rows, with lines to their bars. In crowded rows of devices names
are turned; then not all bars are named, and bars in a row that follow the same target share one name.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from jaxplan.model.activities import Activity
from jaxplan.plotting.day import followings
from jaxplan.plotting.style import GREY, HALO, KEEP_OUT, SMALL, Entries, Look, device_style, name_lines, plain
from jaxplan.timeline.record import TimelinePlan

Span = tuple[float, float]

_BAR = 0.74  # height of bars, in heights of a row
_LETTER = 0.56  # width of a letter, in units of the font size
_NAME_PADDING = 3.0  # points that a bar is longer than the name in it
_TURNED, _UPRIGHT = 8.0, 8.6  # points: size of names turned by 90 deg, and of upright ones
_UPRIGHT_SHARE = 0.75  # a row's names are upright if that share of those with room when turned has room
_ROW_STRETCH = 1.12  # factor by which rows are higher than their names need, since the layout shrinks them
_MAX_TURNED_LENGTH = 80.0  # points: longest turned name for which rows are made higher
_NAME_PITCH = 9.6  # points: distance between names above the rows
_LEADER_HEIGHT = 12.0  # points: height for the lines from these names to the rows
_ROWS_TOP = -0.6  # upper end of the rows, whose middles are at 0, 1, ...
_LEADER_LINE: Look = {"color": "0.45", "linewidth": 0.6, "zorder": 0.9}
_MAX_JOINED_GAP = 0.02  # fraction of the day: bars of one target that are not farther apart share one name
_BARE = 0.25  # largest fraction of the length of a name on several bars that may lie between them
_MIN_EDGED_BAR = 0.006  # fraction of the day: shorter bars have no white edge
_WAITING_OPACITY = 0.35  # opacity of bars before a window opens
_NOT_PLANNED = "not planned"
_COLOURS: dict[str, str] = {"track": "0.35", "point": "0.35", "attitude": "0.55", "idle": "0.75"}
_HIDDEN_SPAN: Look = {"facecolor": "none", "edgecolor": "0.84", "hatch": "///", "linewidth": 0.0}
_BACKDROP: Look = {"zorder": 0.9, **_HIDDEN_SPAN}
_GAP: Look = {"facecolor": "white", "edgecolor": "0.7", "linewidth": 0.6}
_MEANINGS = {  # of the colours of activities, in the order of the legend
    "point": "activity with targets,\na line where it is short",
    "attitude": "activity at an attitude",
    "idle": "rest",
}
_FAILED: Look = {"facecolor": to_rgba(KEEP_OUT, 0.10), "edgecolor": KEEP_OUT, "linewidth": 1.0}
_SLEW: Look = {"facecolor": "0.92", "edgecolor": "0.84", "linewidth": 0.5, "zorder": 0.7}
_POINT_MARK: Look = {"marker": "D", "markersize": 5.5, "linestyle": "none", "markeredgewidth": 0.6}


def device_rows(plan: TimelinePlan) -> dict[int, int]:
    """Return a dict from the number of each device that has a row to the number of that row."""
    first = 1 + any(one.start is None for one in plan.activities)
    return {device: row for row, device in enumerate(devices(plan), first)}


def row_count(plan: TimelinePlan) -> int:
    """Return the number of rows: of activities, of those not planned if there are any, and of devices."""
    return 1 + any(one.start is None for one in plan.activities) + len(devices(plan))


def slews(plan: TimelinePlan) -> list[Span]:
    """Return the start and end, s, of each slew."""
    return [(one.start, one.end) for one in plan.slews]


def shade_slews(axes: Axes, plan: TimelinePlan, *, edges: bool = True) -> None:
    """Shade the slews behind the data of a panel.

    With edges a short slew on a long axis is a hairline; without them it cannot be mistaken for a curve.
    """
    spans = [(start, end - start) for start, end in slews(plan)]
    look = _SLEW if edges else {**_SLEW, "edgecolor": "none"}
    axes.broken_barh(spans, (0, 1), transform=axes.get_xaxis_transform(), **look)


def devices(plan: TimelinePlan) -> list[int]:
    """Return the numbers of the devices for which any activity has a target; each has a row."""
    craft = plan.timeline.scene.spacecraft
    asked = [one.targets.numbers(craft) for one in plan.timeline.activities if one.targets is not None]
    return sorted(set(chain.from_iterable(asked)))


def draw_rows(axes: Axes, plan: TimelinePlan, end: float, lane: float = 0.0) -> Entries:
    """Draw the rows of a timeline without names on a panel up to `end`, s; returns legend entries.

    `lane` is the height of the lane for names above the rows, in rows.
    """
    craft, rows = plan.timeline.scene.spacecraft, device_rows(plan)
    failed = [_NOT_PLANNED] * (row_count(plan) - 1 - len(rows))
    labels = name_lines(axes, ["activity", *failed, *(craft.device_names[device] for device in rows)])
    for label in labels[1 : 1 + len(failed)]:
        label.set_color(KEEP_OUT)
    for device, label in zip(rows, labels[1 + len(failed) :], strict=True):
        label.set_color(device_style(device)["color"])
    axes.set_xlim(0, end)
    axes.set_ylim(top=_ROWS_TOP - lane)
    axes.grid(False, axis="y")
    shade_slews(axes, plan)
    spans = _hidden_spans(plan, end)
    for row, own in spans.items():
        axes.broken_barh([(first, last - first) for first, last in own], (row - _BAR / 2, _BAR), **_BACKDROP)
    for bar in _list_bars(plan, end):
        look = bar.look
        if bar.end - bar.start < _MIN_EDGED_BAR * end and look is not _FAILED:  # all of it would be edge
            look = {**look, "edgecolor": look["facecolor"]}
        axes.broken_barh([(bar.start, bar.end - bar.start)], (bar.row - _BAR / 2, _BAR), **look)
    _draw_points(axes, plan)
    return row_entries(plan, end)


def row_entries(plan: TimelinePlan, end: float) -> Entries:
    """Return legend entries for what the rows of a timeline show until `end`, s."""
    rows = device_rows(plan)
    done = {_COLOURS[one.kind] for one in plan.activities if one.start is not None}
    entries: Entries = [
        (Patch(color=_COLOURS[kind]), text) for kind, text in _MEANINGS.items() if _COLOURS[kind] in done
    ]
    following = [
        (Patch(facecolor=device_style(device)["color"]), "device that follows one") for device in rows
    ]
    entries += [*following[:1], (Patch(**_SLEW), "slew"), (Patch(**_GAP), "gap: the device is free")]
    entries += [(Patch(**_HIDDEN_SPAN), "target hidden")] * bool(_hidden_spans(plan, end))
    off = any(not one.ok and one.start is not None for one in plan.activities)
    entries += [(Patch(**_FAILED), "not certified")] * off
    if any(bar.waiting for bar in _list_bars(plan, end)):
        colour = device_style(next(iter(rows)))["color"]
        entries.append((Patch(color=colour, alpha=_WAITING_OPACITY), "followed before\nits window"))
    if any(one.kind == "point" and one.ok for one in plan.activities):
        entries.append((Line2D([], [], color=GREY, **_POINT_MARK), "instant"))
    return entries


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bar:
    """A bar in a row from `start` to `end`, s, with a name; `waiting` before its activity's window opens."""

    row: int
    start: float
    end: float
    name: str
    look: Look
    waiting: bool = False


def _list_bars(plan: TimelinePlan, end: float) -> Iterator[_Bar]:
    """Yield the bars of all rows until `end`, s."""
    asked = {activity.name: activity for activity in plan.timeline.activities}
    rows, before = device_rows(plan), 0.0
    for one in plan.activities:
        if one.start is None or one.end is None:
            wanted = asked.get(one.name, Activity(name=one.name, idle=True, latest=end))  # the final rest
            start, last = _allowed_span(wanted, before, end)
            yield _Bar(row=1, start=start, end=last, name=one.name, look=_FAILED)
            before = max(before, last)
            continue
        before = one.end
        look = {"facecolor": _COLOURS[one.kind], "edgecolor": "white", "linewidth": 0.5}
        if not one.ok:
            look |= _FAILED
        yield _Bar(row=0, start=one.start, end=one.end, name=one.name, look=look)
    for own in followings(plan):
        colour, start = device_style(own.device)["color"], own.start
        look = {"facecolor": colour, "edgecolor": "white", "linewidth": 0.5}
        if own.begin < start:
            pale = {**look, "facecolor": to_rgba(colour, _WAITING_OPACITY)}
            yield _Bar(row=rows[own.device], start=own.begin, end=start, name="", look=pale, waiting=True)
        yield _Bar(row=rows[own.device], start=start, end=own.end, name=own.name, look=look)


def _allowed_span(activity: Activity, before: float, end: float) -> Span:
    """Return the span, s, in which an activity that was not planned was allowed, within [0, `end`].

    It begins at the earliest at `before`, s, the end of the activity in front.
    """
    start = min(max(before, activity.earliest or 0.0), end)
    last = activity.latest
    if last is None:
        last = start + (activity.duration or 0.0)
    return start, float(np.clip(last, start, end))


def _draw_points(axes: Axes, plan: TimelinePlan) -> None:
    """Mark the instants of activities whose devices point at targets for one instant only."""
    rows = device_rows(plan)
    for own in followings(plan):
        if own.planned.kind == "point":
            look = {"color": device_style(own.device)["color"], "markeredgecolor": "white", **_POINT_MARK}
            axes.plot([own.start], [rows[own.device]], **look)
    times = np.array([one.start for one in plan.activities if one.kind == "point" and one.ok], float)
    axes.plot(times, np.zeros(len(times)), color=_COLOURS["point"], markeredgecolor="white", **_POINT_MARK)


def _hidden_spans(plan: TimelinePlan, end: float) -> dict[int, list[Span]]:
    """Return spans, s, in which targets of devices are hidden, by row; rows without any are left out."""
    every, found = followings(plan), dict[int, list[Span]]()
    for device, row in device_rows(plan).items():
        own, spans = [one for one in every if one.device == device], list[Span]()
        before = 0.0
        for one in own:
            last = end if one is own[-1] else one.end
            spans += [
                (max(before, span.start), min(last, span.end))
                for span in one.path.hidden
                if span.start < last and span.end > before
            ]
            before = one.end
        if spans:
            found[row] = spans
    return found


def write_names(axes: Axes, plan: TimelinePlan, end: float, size: tuple[float, float]) -> None:
    """Write the names of bars into or beside them; names without room are left out.

    A row's names are upright, but for those in narrow bars, or all turned by 90 deg if many more fit so.

    Args:
        axes: with the rows.
        plan: of the timeline.
        end: s, right end of the panel.
        size: width and height of the panel, points.
    """
    low, high = sorted(axes.get_ylim())
    width, height = size[0] / end, size[1] / (high - low) * _BAR
    left_out = False
    for own in _rows_of_bars(plan, end):
        if own[0].row == 0 and low < _ROWS_TOP:
            left_out |= not _name_activities(axes, own, size[0], low)
            continue
        upright, turned = (list(_places(own, width, height, end, turned)) for turned in (False, True))
        places = turned
        if len(upright) >= _UPRIGHT_SHARE * len(turned):  # and turned names in narrow bars
            named = [one.bar for one in upright]
            within = [one for one in turned if one.side == "center" and one.alone]
            places = [*upright, *(one for one in within if not any(one.bar is bar for bar in named))]
        for place in places:
            _write_name(axes, place)
        left_out |= len(places) < sum(bool(bar.name) for bar in own)
    if left_out:
        words = "not all bars have room for their names"
        look: Look = {"fontsize": SMALL, "color": GREY, "ha": "right", "va": "top"}
        below: Look = {"xycoords": "axes fraction", "xytext": (0, -4), "textcoords": "offset points"}
        plain(axes.annotate(words, (1, 0), **below, **look))


def lane_height(plan: TimelinePlan, width: float, end: float) -> float:
    """Return the height, in points, needed above the rows for names of activities without room in their row.

    Args:
        plan: of the timeline.
        width: of the panel, points.
        end: s, right end of the panel.

    Returns:
        Zero where no name needs it, or where so many do that they would not fit beside each other.
    """
    bars = next((own for own in _rows_of_bars(plan, end) if own[0].row == 0), [])
    lengths = [len(bar.name) * _LETTER * _TURNED for bar in _unnamed_bars(bars, width / max(end, 1e-9), end)]
    lengths = [length for length in lengths if length <= _MAX_TURNED_LENGTH]
    return max(lengths) + _LEADER_HEIGHT if lengths and len(lengths) * _NAME_PITCH <= width else 0.0


def _unnamed_bars(bars: Sequence[_Bar], width: float, end: float) -> list[_Bar]:
    """Return bars of a row, by time, whose names have no upright place; `width` is points per second."""
    placed = [one.bar for one in _places(bars, width, np.inf, end, turned=False)]
    return [bar for bar in bars if bar.name and not any(bar is one for one in placed)]


def _name_activities(axes: Axes, bars: Sequence[_Bar], width: float, top: float) -> bool:
    """Name activities in their row, or in the lane above it; returns whether all are named.

    Args:
        axes: with the rows.
        bars: of the activities, in order of time.
        width: of the panel, points.
        top: upper end of the panel on the vertical axis.
    """
    end = axes.get_xlim()[1]
    for place in _places(bars, width / end, np.inf, end, turned=False):
        _write_name(axes, place)
    missing = _unnamed_bars(bars, width / end, end)
    above = [bar for bar in missing if len(bar.name) * _LETTER * _TURNED <= _MAX_TURNED_LENGTH]
    above = above[: int(width / _NAME_PITCH)]
    middles = np.array([(bar.start + bar.end) / 2 for bar in above]) * width / end
    turned: Look = {"rotation": 90, "ha": "center", "va": "bottom", "fontsize": _TURNED, "clip_on": True}
    longest = max((len(bar.name) for bar in above), default=0) * _LETTER * _TURNED
    foot = top + (_ROWS_TOP - top) * longest / (longest + _LEADER_HEIGHT)
    for bar, middle, place in zip(above, middles, spread(middles, _NAME_PITCH, width), strict=True):
        axes.plot(np.array([middle, place]) * end / width, [-_BAR / 2, foot], **_LEADER_LINE)
        colour = KEEP_OUT if bar.look.get("facecolor") == _FAILED["facecolor"] else "black"
        plain(axes.text(float(place) * end / width, foot, bar.name, color=colour, **turned))
    return len(above) == len(missing)


def spread(places: np.ndarray, pitch: float, width: float) -> np.ndarray:
    """Move rising places (k,) as little as possible so that they are at least `pitch` apart.

    They also keep half of that from 0 and `width`, whose distance has to be enough for all of them.
    """
    if not len(places):
        return places
    from scipy.optimize import isotonic_regression  # slow to import, so not at the top

    steps = pitch * np.arange(len(places))
    free = isotonic_regression(places - steps).x
    return np.asarray(np.clip(free, pitch / 2, width - pitch / 2 - steps[-1]) + steps)


def _join_bars(bars: Sequence[_Bar], near: float) -> Iterator[_Bar]:
    """Yield bars of a row, by time; those of one name within `near`, s, of each other become one bar."""
    before: _Bar | None = None
    pale: _Bar | None = None  # part before a window, which does not separate bars of one name
    for bar in bars:
        if bar.waiting:
            pale = bar
            continue
        if before is not None and bar.name == before.name and bar.start - before.end <= near:
            before = replace(before, end=bar.end)
        else:
            yield from (one for one in (before, pale) if one is not None)
            before = bar
        pale = None
    yield from (one for one in (before, pale) if one is not None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Place:
    """Where a bar's name stands: at a time, s, which is its left end, middle or right end.

    `side` says which of these, as text alignment; `alone` whether the name lies wholly within its bar.
    """

    bar: _Bar
    time: float
    side: str
    turned: bool
    alone: bool


def _places(bars: Sequence[_Bar], width: float, height: float, end: float, turned: bool) -> Iterator[_Place]:
    """Yield the places of the names of a row's bars, for those that have room.

    Args:
        bars: of the row, in order of time.
        width: points that a second takes.
        height: of a bar, points.
        end: s, right end of the panel.
        turned: whether names are turned by 90 deg.
    """
    taken = written = 0.0  # s: ends of the space taken so far by bars and names, and by names
    for number, bar in enumerate(bars):
        length = len(bar.name) * _LETTER * (_TURNED if turned else _UPRIGHT)
        needed = _TURNED if turned else length + _NAME_PADDING
        if not bar.name or (turned and length > height):
            taken = bar.end
            continue
        after = bars[number + 1].start if number + 1 < len(bars) else end
        gap = _NAME_PADDING / 2 / width
        place: tuple[float, str] | None = None
        middle = (bar.start + bar.end) / 2
        if needed <= (bar.end - bar.start) * width:
            place = middle, "center"
        elif needed <= (after - bar.end) * width:
            place = bar.end + gap, "left"
        elif needed <= (bar.start - taken) * width:
            place = bar.start - gap, "right"
        elif turned and _fits_across(bars[max(number - 1, 0) : number + 2], middle, needed / width, written):
            place = middle, "center"
        taken = bar.end
        if place is not None:
            written = middle + needed / width / 2
            alone = needed <= (bar.end - bar.start) * width
            yield _Place(bar=bar, time=place[0], side=place[1], turned=turned, alone=alone)
            if place[1] == "left":
                taken += needed / width


def _fits_across(bars: Sequence[_Bar], middle: float, length: float, written: float) -> bool:
    """Return whether a name fits upon a bar and its neighbours, `bars`, which must look the same.

    `middle` and `length`, s, are those of the name; until `written`, s, the row has other names.
    """
    first, last = middle - length / 2, middle + length / 2
    same = all(bar.look == bars[0].look for bar in bars)
    bare = sum(max(0.0, min(b.start, last) - max(a.end, first)) for a, b in pairwise(bars))
    return same and bare <= _BARE * length and first >= max(written, bars[0].start) and last <= bars[-1].end


def _write_name(axes: Axes, place: _Place) -> None:
    """Write a bar's name, light on dark bars and dark elsewhere."""
    bar = place.bar
    red, green, blue = to_rgb(bar.look["facecolor"])
    dark = place.side == "center" and bar.look is not _FAILED and 0.3 * red + 0.59 * green + 0.11 * blue < 0.6
    halo = HALO["path_effects"] if place.side != "center" else None
    if halo is None and not place.alone:  # over what is between its bar and the next
        halo = [withStroke(linewidth=2.5, foreground=bar.look["facecolor"])]
    text = axes.text(
        place.time,
        bar.row,
        bar.name,
        ha=place.side,
        va="center",
        rotation=90 if place.turned else 0,
        fontsize=_TURNED if place.turned else _UPRIGHT,
        color=KEEP_OUT if bar.look is _FAILED else "white" if dark else "black",
        clip_on=True,
        zorder=4,
        path_effects=halo,
    )
    plain(text)


def row_height(plan: TimelinePlan, width: float, end: float) -> float:
    """Return the height in points that a row needs for names that fit only when turned; zero if none does.

    Args:
        plan: of the timeline.
        width: of the panel, points.
        end: s, right end of the panel.
    """
    needed = 0.0
    above = lane_height(plan, width, end) > 0
    for bars in _rows_of_bars(plan, end):
        if above and bars[0].row == 0:
            continue
        fitting = len(list(_places(bars, width / max(end, 1e-9), np.inf, end, turned=False)))
        named = [bar for bar in bars if bar.name]
        if named and fitting < _UPRIGHT_SHARE * len(named):
            longest = max(len(bar.name) for bar in named) * _LETTER * _TURNED
            needed = max(needed, longest if longest <= _MAX_TURNED_LENGTH else 0.0)
    return _ROW_STRETCH * (needed + _NAME_PADDING) / _BAR if needed else 0.0


def _rows_of_bars(plan: TimelinePlan, end: float) -> Iterator[list[_Bar]]:
    """Yield the bars of each row by time; those of devices are joined where they follow one target."""
    bars = list(_list_bars(plan, end))
    for row in sorted({bar.row for bar in bars}):
        own = sorted((bar for bar in bars if bar.row == row), key=lambda bar: bar.start)
        yield list(_join_bars(own, _MAX_JOINED_GAP * end)) if row else own
