"""The figure of a timeline, and the other figures of its plan: what stands where, not pixels."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from builders import make_plan
from days import END, ERROR, RATE, TOLERANCE, day, target, zone
from drawn import assert_apart
from matplotlib.figure import Figure
from reference import angle, direction
from wheels import INERTIA, random_wheels

import jaxplan as jp
from jaxplan.model.status import Status
from jaxplan.plotting import activity_bars
from jaxplan.plotting.day import DayPlan, as_plan, instants
from jaxplan.plotting.sky import BETWEEN, FOLLOWED
from jaxplan.plotting.style import device_style, motion
from jaxplan.plotting.timeline import timeline_size


@pytest.fixture(scope="module")
def plan():
    return day(zone("sun", 90, 20, 10), zone("moon", 205, -30, 5))


@pytest.fixture(scope="module")
def grid(plan):
    return jp.plot.timeline(plan)


def _labels(axes):
    return [label.get_text() for label in axes.get_yticklabels()]


def _spans(axes):
    """The bars of a panel of rows: (start, end, row), by colour."""
    found = {}
    for bars in axes.collections:
        for path in bars.get_paths():
            (left, bottom), (right, top) = path.get_extents().get_points()
            colour = mpl.colors.to_hex(bars.get_facecolor()[0]) if len(bars.get_facecolor()) else "none"
            found.setdefault(colour, []).append((left, right, (bottom + top) / 2))
    return found


def _lines(axes, length=None):
    return [line for line in axes.lines if len(line.get_xdata()) == length or (length is None)]


def test_rows_are_the_activities_and_the_devices_that_follow_something(grid):
    assert _labels(grid[0]) == ["activity", "not planned", "telescope"]
    texts = [text.get_text() for text in grid[0].texts]
    assert texts.count("image") == 1
    assert {"lost", "rest", "site"} <= set(texts)
    assert grid[0].get_title(loc="left") == "day: 2 of 3 activities planned, GOAL_UNREACHABLE"


def test_the_rest_after_the_last_activity_is_drawn_though_nobody_asked_for_it(plan):
    last = next(one for one in reversed(plan.activities) if one.end is not None)
    rest = replace(last, name="rest until the end")
    rested = replace(plan, activities=(*plan.activities, rest))
    assert len(activity_bars.followings(rested)) == len(activity_bars.followings(plan)) > 0
    assert jp.plot.timeline(rested)[0].get_title(loc="left").startswith("day: 2 of 3 activities planned")


def test_bars_stand_where_targets_are_followed_and_are_pale_before_the_window(grid):
    spans = _spans(grid[0])
    colour = device_style(1)["color"].lower()  # of the telescope, which is the second device
    own = sorted(spans[colour])
    np.testing.assert_allclose(own, [(100, 120, 2), (120, 400, 2)])
    failed = [bar for bars in spans.values() for bar in bars if bar[2] == 1]
    np.testing.assert_allclose(failed, [(410, 480, 1)])


def test_hidden_targets_are_hatched_until_the_next_activity_and_after_the_last(grid):
    hatched = [bars for bars in grid[0].collections if bars.get_hatch()]
    spans = [path.get_extents().get_points()[:, 0].tolist() for bars in hatched for path in bars.get_paths()]
    np.testing.assert_allclose(sorted(spans), [(0, 90), (450, 600), (590, 650)])


def test_slews_are_shaded_in_every_panel(grid):
    for axes in grid:
        spans = [bar[:2] for bars in _spans(axes).values() for bar in bars]
        assert (0.0, 100.0) in spans
        assert (400.0, 500.0) in spans


def test_panels_are_those_that_the_spacecraft_has(plan, grid):
    words = [axes.get_ylabel().replace("\n", " ") for axes in grid[1:]]
    assert words == [
        "margin (deg)",
        "pointing error (deg)",
        "platform rate (deg/s)",
        "yaw (deg)",
        "pitch (deg)",
    ]
    craft = replace(plan.timeline.scene.spacecraft, inertia=INERTIA, wheels=random_wheels(4, 3))
    more = jp.plot.timeline(day(craft=craft))
    words = [axes.get_ylabel().replace("\n", " ") for axes in more[1:]]
    assert words[0] == "pointing error (deg)"  # there are no zones
    assert words[-1].startswith("wheel momenta")
    (label,) = {axes.get_xlabel() for axes in more} - {""}
    assert label.startswith("UTC")


def test_the_smallest_margins_are_those_of_the_motion(plan, grid):
    times = motion(plan).times
    looks = direction(RATE * times, np.zeros(len(times)))
    for name, line in zip(("moon", "sun"), _lines(grid[1], len(times)), strict=True):
        own = next(one for one in plan.timeline.scene.keep_out if one.name == name)
        wanted = np.rad2deg(angle(looks, own.direction) - own.half_angle)
        np.testing.assert_allclose(line.get_ydata(), wanted, atol=1e-9)
    names = [text.get_text() for text in grid[1].get_legend().get_texts()]
    assert names[:2] == ["sun", "moon"]


def test_pointing_errors_stand_beside_tolerance_and_what_is_proved(plan, grid):
    times = motion(plan).times
    (line,) = _lines(grid[2], len(times))
    within = (times >= 100) & (times <= 400)
    np.testing.assert_allclose(line.get_ydata()[within], np.rad2deg(ERROR), rtol=1e-5)
    assert np.all(np.isnan(line.get_ydata()[~within]))
    levels = {
        round(float(line.get_ydata()[0]), 9) for line in grid[2].lines if len(line.get_ydata()) in (2, 3)
    }
    assert levels == {round(float(np.rad2deg(value)), 9) for value in (TOLERANCE, 1.1 * ERROR)}
    assert grid[2].get_yscale() == "log"


def test_what_is_followed_for_a_short_while_has_a_dot_of_its_largest_error():
    plan = day()
    image, *others = plan.activities
    short = replace(plan, activities=(replace(image, end=123.0), *others))
    short = replace(
        short,
        segments=tuple(
            replace(one, start=120.0, end=123.0) if one.kind == "track" else one for one in plan.segments
        ),
    )
    axes = jp.plot.timeline(short)[1]
    (dots,) = [line for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dots.get_xdata(), [121.5])
    np.testing.assert_allclose(dots.get_ydata(), [np.rad2deg(ERROR)], rtol=1e-5)


def test_what_is_too_narrow_for_a_curve_is_a_level_of_its_largest_error():
    plan = day()
    image, *others = plan.activities
    short = replace(plan, activities=(replace(image, end=160.0), *others))
    short = replace(
        short,
        segments=tuple(replace(one, end=160.0) if one.kind == "track" else one for one in plan.segments),
    )
    axes = jp.plot.timeline(short)[1]
    colour = device_style(1)["color"]
    own = [
        line for line in axes.lines if line.get_color() == colour and np.any(np.isfinite(line.get_ydata()))
    ]
    (level,) = own
    np.testing.assert_allclose(level.get_xdata()[:2], [100, 160])
    np.testing.assert_allclose(level.get_ydata()[:2], np.rad2deg(ERROR), rtol=1e-5)
    low, high = axes.get_ylim()
    assert low < np.rad2deg(ERROR) < np.rad2deg(TOLERANCE) < high
    for line in axes.lines:  # nothing that goes up or down while no time passes
        times, values = (np.asarray(own, float) for own in line.get_data())
        steps = np.abs(np.diff(values)) > 0
        assert not np.any(steps & (np.diff(times) < 1e-9))


def test_the_legend_says_what_bars_gaps_and_ticks_are_and_slews_have_no_edges_among_curves(grid):
    told = [text.get_text() for text in grid[0].get_legend().get_texts()]
    assert "activity with targets,\na line where it is short" in told
    assert {"device that follows one", "slew", "gap: the device is free"} <= set(told)
    ticked = [text.get_text() for axes in grid[1:] for text in axes.get_legend().get_texts()]
    assert "limit, its ticks on\nthe side beyond it" in ticked
    assert "limit" not in ticked
    for number, axes in enumerate(grid):
        (shade,) = [bars for bars in axes.collections if bars.get_zorder() == activity_bars._SLEW["zorder"]]
        assert bool(len(shade.get_edgecolor())) == (number == 0)


def test_rates_are_thin_in_slews_and_all_there(plan, grid):
    times = motion(plan).times
    (axes,) = [one for one in grid if one.get_ylabel().startswith("platform rate")]
    lines = _lines(axes, len(times))
    slewing = np.zeros(len(times), dtype=bool)
    for start, end in activity_bars.slews(plan):
        slewing |= (times >= start) & (times <= end)
    assert 0.1 < np.mean(slewing) < 0.9
    for bold, thin in zip(lines[:3], lines[3:], strict=True):
        assert thin.get_linewidth() < bold.get_linewidth() / 2
        np.testing.assert_array_equal(np.isfinite(thin.get_ydata()), slewing)
        assert np.all(np.isfinite(bold.get_ydata())[~slewing])
        rate = np.fmax(bold.get_ydata(), thin.get_ydata())
        np.testing.assert_allclose(rate, np.rad2deg(RATE) if bold is lines[2] else 0, atol=1e-9)


def test_on_the_sphere_it_is_bold_where_a_device_follows_its_target(plan):
    axes = jp.plot.sphere(plan)
    own = as_plan(plan)
    assert own.followed[0] == (1, 120.0, 400.0)
    bold = [line for line in axes.lines if line.get_linewidth() == FOLLOWED["linewidth"]]
    assert len(bold) == len(own.followed) == 1
    drawn = bold[0].get_xydata()
    drawn = drawn[np.isfinite(drawn[:, 0])]
    np.testing.assert_allclose(drawn[[0, -1], 0], [60, 200 - 360], atol=1.0)
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "while it follows a target" in told


@pytest.mark.parametrize(
    ("epoch", "labels", "axis"),
    [
        (
            np.datetime64("2026-06-20T23:55:00"),
            ["23:56", "23:58", "00:00\n2026-06-21", "00:02", "00:04", "00:06"],
            "UTC (h:min) from 2026-06-20 on",
        ),
        (None, ["00:00", "00:02", "00:04"], "time from the start (h:min)"),
    ],
)
def test_the_axis_of_time_is_in_utc_where_there_is_an_epoch(epoch, labels, axis):
    axes = jp.plot.timeline(day(epoch=epoch))[-1]
    ticks = axes.get_xticks()
    form = axes.xaxis.get_major_formatter()
    assert [form(tick) for tick in ticks][: len(labels)] == labels
    assert axes.get_xlabel() == axis
    assert len(ticks) < 10
    assert ticks[0] >= 0
    assert ticks[-1] <= END


def test_an_epoch_between_minutes_has_ticks_at_whole_ones():
    axes = jp.plot.timeline(day(epoch=np.datetime64("2026-06-20T09:30:40.5")))[-1]
    ticks, form = axes.get_xticks(), axes.xaxis.get_major_formatter()
    assert ticks[0] == pytest.approx(79.5)
    assert form(ticks[0]) == "09:32"


def test_names_are_shown_letter_by_letter_and_only_where_they_fit():
    name = "$x_1$ of a very long day, far too long for its bar, whichever way it is turned or put aside"
    axes = jp.plot.timeline(day(name="$d$", image=name))[0]
    assert not any(text.get_parse_math() for text in axes.texts)
    assert name not in [text.get_text() for text in axes.texts]
    assert axes.get_title(loc="left").startswith("$d$")


def test_crowded_names_are_turned_and_in_between_stand_beside():
    bars = [
        activity_bars._Bar(row=0, start=10.0 * k, end=10.0 * k + 1, name="image", look={}) for k in range(10)
    ]
    wide = list(activity_bars._places(bars, 10.0, 50.0, 100.0, turned=False))
    assert [place.side for place in wide] == ["left"] * 10
    assert not list(activity_bars._places(bars, 1.0, 50.0, 100.0, turned=False))
    turned = list(activity_bars._places(bars, 1.0, 50.0, 100.0, turned=True))
    assert [place.side for place in turned] == ["left"] * 10
    assert not list(activity_bars._places(bars, 1.0, 5.0, 100.0, turned=True))


def test_bars_of_one_target_in_a_row_are_named_together_and_others_are_not():
    def bars(*named):
        return [
            activity_bars._Bar(row=2, start=start, end=end, name=name, look={}, waiting=not name)
            for start, end, name in named
        ]

    every = bars((0, 9, "a"), (9, 10, ""), (10, 20, "a"), (21, 30, "a"), (30, 40, "b"), (60, 70, "b"))
    found = [(bar.start, bar.end, bar.name) for bar in activity_bars._join_bars(every, 5.0)]
    assert found == [(0, 30, "a"), (30, 40, "b"), (60, 70, "b")]
    pale = bars((0, 9, "a"), (9, 10, ""), (10, 20, "b"))
    assert [(bar.start, bar.name) for bar in activity_bars._join_bars(pale, 5.0)] == [
        (0, "a"),
        (9, ""),
        (10, "b"),
    ]


def test_where_a_crowd_has_no_room_some_names_stand_upon_their_neighbours_that_look_the_same():
    bars = [
        activity_bars._Bar(row=0, start=3.0 * k, end=3.0 * k + 3, name="image", look={}) for k in range(10)
    ]
    placed = list(activity_bars._places(bars, 1.0, 50.0, 30.0, turned=True))
    middles = [place.time for place in placed]
    assert [place.side for place in placed] == ["center"] * len(placed)
    assert len(placed) == 3
    assert np.all(np.diff(middles) >= activity_bars._TURNED)
    mixed = [replace(bar, look={"facecolor": str(number)}) for number, bar in enumerate(bars)]
    assert not list(activity_bars._places(mixed, 1.0, 50.0, 30.0, turned=True))


def test_no_name_stands_upon_bars_with_slews_between_where_it_would_not_be_read():
    look = {"facecolor": "0.35"}
    bars = [
        activity_bars._Bar(row=0, start=9.0 * k, end=9.0 * k + 1, name="image", look=look) for k in range(10)
    ]
    near = [replace(bar, end=bar.start + 8.5) for bar in bars]
    sides = [
        [place.side for place in activity_bars._places(own, 0.5, 50.0, 90.0, True)] for own in (bars, near)
    ]
    assert "center" not in sides[0]
    assert "center" in sides[1]


def test_in_an_upright_row_the_name_of_a_narrow_bar_is_turned(monkeypatch):
    spans = ((0, 30, "star"), (31, 60, "other"), (61, 71, "park"), (71, 100, "rest"))
    look = {"facecolor": "0.35"}
    bars = [activity_bars._Bar(row=0, start=a, end=b, name=name, look=look) for a, b, name in spans]
    monkeypatch.setattr(activity_bars, "_rows_of_bars", lambda *_: [bars])
    axes = Figure().subplots()
    axes.set(xlim=(0, 100), ylim=(-0.5, 0.5))
    activity_bars.write_names(axes, None, 100.0, (100.0, 60.0))
    turned = {text.get_text(): text.get_rotation() == 90 for text in axes.texts}
    assert turned == {"star": False, "other": False, "park": True, "rest": False}


def test_slews_are_drawn_at_many_instants_however_many_there_are():
    for count, fewest in ((1, 24), (96, 24), (4000, 4)):
        segments = [
            jp.Segment(name="", kind=kind, start=900.0 * k + a, end=900.0 * k + b)
            for k in range(count)
            for kind, a, b in (("slew", 0, 10), ("track", 10, 900))
        ]
        times = instants(segments)
        for segment in segments[::2]:
            inside = np.searchsorted(times, segment.end, "right") - np.searchsorted(times, segment.start)
            assert inside > fewest, count


def test_ways_between_very_many_targets_are_left_out_and_the_legend_says_so(plan, monkeypatch):
    def drawn():
        axes = jp.plot.sphere(plan)
        words = " ".join(text.get_text() for text in axes.get_legend().get_texts())
        return [line.get_linewidth() for line in axes.lines], "left out" in words

    widths, told = drawn()
    assert widths.count(BETWEEN["linewidth"]) > 0
    assert not told
    monkeypatch.setattr("jaxplan.plotting.sky.MOST_BETWEEN", 0)
    fewer, told = drawn()
    assert told
    assert fewer.count(FOLLOWED["linewidth"]) == widths.count(FOLLOWED["linewidth"]) == 1
    assert fewer.count(BETWEEN["linewidth"]) < widths.count(BETWEEN["linewidth"])


def test_a_row_names_its_target_though_it_is_never_hidden(plan):
    path = replace(target(hidden=()), called="comet")
    activities = []
    for one in plan.timeline.activities:
        kind = "track" if one.track is not None else "point"
        asked = getattr(one, kind)
        activities.append(
            one if asked is None else replace(one, **{kind: replace(asked, directions=(path,))})
        )
    named = replace(plan, timeline=replace(plan.timeline, activities=tuple(activities)))
    texts = [text.get_text() for text in jp.plot.timeline(named)[0].texts]
    assert "comet" in texts
    assert "site" not in texts


def test_a_plan_without_a_trajectory_has_rows_alone():
    plan = day()
    (axes,) = jp.plot.timeline(
        replace(plan, trajectory=None, segments=(), activities=plan.activities[1:2], certificate=None)
    )
    assert _labels(axes) == ["activity", "not planned", "telescope"]


def test_axes_or_a_figure_may_be_given_and_are_filled(plan, grid):
    figure = Figure(figsize=timeline_size(plan), layout="constrained")
    assert jp.plot.timeline(plan, ax=figure)[0].figure is figure
    own = Figure().subplots(len(grid), 1)
    assert jp.plot.timeline(plan, ax=own, legend=False)[0] is own[0]
    assert own[0].get_legend() is None
    with pytest.raises(ValueError, match="panels"):
        jp.plot.timeline(plan, ax=Figure().subplots())
    with pytest.raises(TypeError, match="plan_timeline"):
        jp.plot.timeline(as_plan(plan))


def test_the_instants_of_a_day_have_the_ends_of_all_segments_and_some_between(plan):
    times = instants(plan.segments)
    assert np.all(np.diff(times) > 0)
    for segment in plan.segments:
        inside = times[(times >= segment.start) & (times <= segment.end)]
        assert inside[0] == segment.start
        assert inside[-1] == segment.end
        assert len(inside) > 300  # half of the instants are shared out evenly
    assert len(times) < 4000


def test_a_day_is_drawn_as_a_plan_from_its_start_to_its_end(plan):
    own = as_plan(plan)
    assert isinstance(own, DayPlan)
    last = plan.trajectory.sample(END)
    np.testing.assert_allclose(own.goal.attitude, last.attitude)
    np.testing.assert_allclose(own.scenario.goal.attitude, last.attitude, atol=1e-12)
    assert (own.status, own.scenario.name) == (Status.GOAL_UNREACHABLE, "day")
    assert as_plan(own) is own
    bare = as_plan(replace(plan, trajectory=None, segments=()))
    assert (bare.goal, bare.trajectory) == (None, None)


def test_other_figures_take_a_day_and_have_its_axis_of_time(plan):
    for figure in (jp.plot.angles, jp.plot.rates, jp.plot.accelerations, jp.plot.margins):
        axes = np.ravel(figure(plan))[-1]
        assert axes.get_xlabel().startswith("UTC")
    assert jp.plot.animate(plan, frames=4).instants.tolist() == [
        int(np.argmin(np.abs(motion(plan).times - time))) for time in np.linspace(0, END, 4)
    ]
    names = [name for name, _ in jp.plot.figures(plan)]
    assert names[0] == "timeline"
    assert {"overview", "sphere", "rates", "margins"} <= set(names)
    assert "timeline" not in [name for name, _ in jp.plot.figures(as_plan(plan))]


def test_the_sphere_shows_zones_and_boresights_at_an_instant():
    times = np.linspace(0.0, END, 100)
    moving = replace(
        zone("sun", 0, 0, 10),
        direction=jp.DirectionPath.through(times, direction(times / 500, np.full(100, 0.3))),
    )
    plan = day(moving)
    axes = jp.plot.sphere(plan, at=250.0)
    dots = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dots[-1], [125.0, 0.0], atol=1e-9)  # of the telescope
    (name,) = [text for text in axes.texts if text.get_text().startswith("sun")]
    assert abs(name.get_position()[0] - np.rad2deg(0.5)) < 10
    said = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "at 2026-06-20 23:59:10 UTC,\nas the zones are" in said
    assert "end" in said
    assert jp.plot.globe(plan, at=0.0).get_legend() is not None


@pytest.mark.parametrize("at", [-1.0, END + 1, np.nan, "noon"])
def test_an_instant_outside_of_the_day_is_refused(plan, at):
    with pytest.raises((TypeError, ValueError), match="at"):
        jp.plot.sphere(plan, at=at)
    with pytest.raises(ValueError, match="no trajectory"):
        jp.plot.globe(replace(plan, trajectory=None, segments=()), at=0.0)


def test_activities_without_room_for_their_names_have_them_above_the_rows(plan):
    spans = ((0.0, 4.0), (6.0, 9.0), (10.0, 10.5), (300.0, 303.0), (641.0, 649.0))
    first = replace(plan.activities[0], status=Status.OK)
    some = [replace(first, name=f"activity {k}", start=a, end=b) for k, (a, b) in enumerate(spans)]
    crowded = replace(plan, activities=(*some, replace(first, name="w" * 99, start=620.0, end=630.0)))
    figure = Figure(figsize=timeline_size(crowded), layout="constrained")
    axes = jp.plot.timeline(crowded, ax=figure)[0]
    texts = [text for text in axes.texts if text.get_text().startswith("activity")]
    assert_apart(figure, texts, least=len(spans))
    panel = axes.get_window_extent()
    above = {text.get_text(): text for text in texts if text.get_rotation() == 90}
    assert {"activity 0", "activity 1", "activity 4"} <= set(above)
    ends = {
        line.get_xydata()[1].tobytes(): line.get_xydata()[0]
        for line in axes.lines
        if len(line.get_xdata()) == 2
    }
    for text in texts:
        start, last = spans[int(text.get_text()[-1])]
        box = text.get_window_extent()
        assert panel.x0 <= box.x0
        assert box.x1 <= panel.x1
        if text.get_text() in above:
            led = ends[np.array(text.get_position()).tobytes()]
            assert led[0] == pytest.approx((start + last) / 2)
            assert box.y1 <= panel.y1 + 1
            assert text.get_position()[1] < -0.5 < led[1] < 0, "from above the rows into that of activities"
    assert any("not all" in text.get_text() for text in axes.texts), "the longest has no room anywhere"


def test_places_are_spread_no_farther_than_need_be():
    places = np.array([1.0, 2.0, 3.0, 50.0, 99.0, 99.5])
    found = activity_bars.spread(places, 10.0, 100.0)
    np.testing.assert_allclose(found, [5.0, 15.0, 25.0, 50.0, 85.0, 95.0])
    np.testing.assert_allclose(activity_bars.spread(np.array([40.0, 42.0]), 10.0, 100.0), [36.0, 46.0])
    assert len(activity_bars.spread(np.array([]), 10.0, 100.0)) == 0


def test_the_legend_of_the_rows_makes_no_gap_below_them(plan):
    figure = Figure(figsize=timeline_size(plan), layout="constrained")
    rows, below, *_ = jp.plot.timeline(plan, ax=figure)
    figure.draw_without_rendering()
    assert rows.get_legend().get_window_extent().y0 >= rows.get_window_extent().y0 - 2
    gap = rows.get_window_extent().y0 - below.get_window_extent().y1
    assert gap < 0.3 * figure.dpi


@pytest.mark.parametrize("figure", [jp.plot.sphere, jp.plot.joint_map])
def test_a_day_has_an_end_and_a_manoeuvre_a_goal(plan, figure):
    for shown, word, other in ((plan, "end", "goal"), (make_plan(1, 1), "goal", "end")):
        axes = np.ravel(figure(shown))[0]
        told = {text.get_text() for text in axes.get_legend().get_texts()}
        assert word in told
        assert other not in told
