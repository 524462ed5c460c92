"""The figure of Table 4: rates, times and lengths at their values, for any kinds and planners."""

from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from scipy.stats import binomtest

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.plotting import comparison_figure
from jaxplan.plotting.style import WIDTH
from jaxplan.search import PLANNERS
from jaxplan.study.printed_planners import Row, printed_rows


def make_row(
    kind: str = "keep_out", planner: str = "mha", *, scenes: int = 12, found: int = 9, clear: int = 7
) -> Row:
    rng = np.random.default_rng((scenes, found, clear))
    return Row(
        kind=kind,
        planner=planner,
        scenes=scenes,
        found=found,
        clear=clear,
        solved=rng.permutation(scenes) < clear,
        seconds=np.exp(rng.normal(-4, 1, scenes)),
        nodes=rng.integers(5, 40, clear),
        steps=rng.uniform(5, 40, clear),
    )


def dots(axes: mpl.axes.Axes, line: int, *, filled: bool) -> np.ndarray:
    """Where the scenes of a line are drawn."""
    marks = [
        mark.get_xydata()
        for mark in axes.lines
        if mark.get_marker() == "o" and same_color(mark.get_markerfacecolor(), "white") != filled
    ]
    points = np.concatenate([np.zeros((0, 2)), *marks])
    return np.sort(points[np.abs(points[:, 1] - line) < 0.5, 0])


def means(axes: mpl.axes.Axes) -> dict[float, float]:
    bars = [mark for mark in axes.lines if mark.get_marker() == "|" and mark.get_linestyle() == "None"]
    return {float(bar.get_ydata()[0]): float(bar.get_xdata()[0]) for bar in bars}


def test_times_and_lengths_of_every_scene_stand_at_their_values():
    rows = [make_row(planner="mha"), make_row(planner="wastar", scenes=60, found=60, clear=60)]
    _, seconds, steps, nodes = jp.plot.table4(rows)
    for line, row in enumerate(rows):
        np.testing.assert_allclose(dots(seconds, line, filled=True), np.sort(row.seconds[row.solved]))
        np.testing.assert_allclose(dots(seconds, line, filled=False), np.sort(row.seconds[~row.solved]))
        np.testing.assert_allclose(dots(steps, line, filled=True), np.sort(row.steps))
        np.testing.assert_allclose(dots(nodes, line, filled=True), np.sort(row.nodes))
        for axes, values in ((seconds, row.seconds), (steps, row.steps), (nodes, row.nodes)):
            assert means(axes)[line] == pytest.approx(np.mean(values))
            low, high = axes.get_xlim()
            assert low < np.min(values) <= np.max(values) < high
    assert seconds.get_xscale() == "log"
    assert len(seconds.get_xticks()) >= 2


def test_rates_stand_between_the_ends_of_their_intervals():
    row = make_row(scenes=20, found=18, clear=11)
    axes = jp.plot.table4([row])[0]
    marks = {
        mark.get_marker(): float(mark.get_xdata()[0]) for mark in axes.lines if len(mark.get_xdata()) == 1
    }
    assert marks == pytest.approx({"D": 90.0, "o": 55.0})
    spans = [tuple(line.get_xdata()) for line in axes.lines if len(line.get_xdata()) == 2]
    for span, count in zip(spans, (18, 11), strict=True):
        wilson = binomtest(count, 20).proportion_ci(method="wilson")
        assert span == pytest.approx((100 * wilson.low, 100 * wilson.high))


def test_rows_known_from_print_span_least_to_largest_below_the_others():
    printed = printed_rows(["keep_in"])
    success, seconds, steps, nodes = jp.plot.table4([*printed, make_row("keep_in")])
    assert [label.get_text() for label in success.get_yticklabels()] == ["mha"] + [r.planner for r in printed]
    for axes, values in ((seconds, [r.seconds for r in printed]), (nodes, [r.nodes for r in printed])):
        spans = [tuple(line.get_xdata()) for line in axes.lines if len(line.get_xdata()) == 2]
        assert spans == [(least, largest) for least, largest, _ in values]
        assert [means(axes)[line] for line in (1, 2, 3)] == [mean for _, _, mean in values]
    assert [text.get_text() for text in steps.texts] == ["not printed"] * 3
    assert success.get_title(loc="left") == "keep_in: 12 scenes, 20 as printed"
    assert [row.kind for row in printed_rows(["hard_keep_in", "keep_out"])] == ["keep_out"] * 3


def test_a_planner_has_one_colour_whichever_are_compared():
    colours: dict[str, set[str]] = {name: set() for name in PLANNERS}
    for names in (list(PLANNERS), *([name] for name in PLANNERS), ["rrt_connect", "mha"]):
        for axes in jp.plot.table4([make_row(planner=name) for name in names])[:3]:
            for mark in (line for line in axes.lines if line.get_marker() == "o"):
                colours[names[round(float(np.mean(mark.get_ydata())))]].add(mark.get_color())
    assert all(len(found) == 1 for found in colours.values())
    assert len(set.union(*colours.values())) == len(PLANNERS)


@pytest.mark.parametrize(("kinds", "planners"), [(1, 1), (2, 5), (5, 1), (5, 5)])
def test_any_kinds_and_planners_fit_on_the_page(kinds, planners):
    names = SKY_KINDS[:kinds]
    rows = [make_row(kind, planner) for kind in names for planner in list(PLANNERS)[:planners]]
    figure = comparison_figure([*rows, *printed_rows(names)])
    figure.draw_without_rendering()
    assert len(figure.axes) == 4 * kinds
    assert figure.get_figwidth() == WIDTH
    (legend,) = (one.get_window_extent() for one in figure.legends)
    assert not any(legend.overlaps(axes.get_window_extent()) for axes in figure.axes)
    labels = [axes.xaxis.get_label() for axes in figure.axes[-4:]]
    assert not any(legend.overlaps(label.get_window_extent()) for label in labels)
    assert not any(
        one.get_window_extent().overlaps(other.get_window_extent()) for one, other in pairwise(labels)
    )
    assert legend.x0 >= -1
    assert legend.x1 <= figure.bbox.x1 + 1
    assert legend.y0 >= figure.bbox.y0 - 1
    for axes in figure.axes:
        assert axes.get_tightbbox().x0 >= -1
        ticks = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
        assert axes not in figure.axes[-4:] or not any(one.overlaps(other) for one, other in pairwise(ticks))
        names_beside = [label.get_window_extent() for label in axes.get_yticklabels() if label.get_visible()]
        assert not any(one.overlaps(other) for one, other in pairwise(names_beside))
    lowest = figure.axes[-4:]
    assert all(axes.get_xlabel().endswith(")") for axes in lowest)
    assert not any(axes.get_xlabel() for axes in figure.axes[:-4])
    for column in range(4):
        assert len({axes.get_xlim() for axes in figure.axes[column::4]}) == 1


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (make_row(scenes=5, found=0, clear=0), ["", "", "no clear path", "no clear path"]),
        (make_row(scenes=0, found=0, clear=0), ["no scenes"] * 4),
        (make_row(scenes=1, found=1, clear=1), [""] * 4),
    ],
    ids=["nothing found", "no scenes", "one scene"],
)
def test_an_empty_line_says_why(row, words):
    for beside in ([], [make_row(planner="wastar")]):
        axes = jp.plot.table4([row, *beside])
        axes[0].figure.draw_without_rendering()
        assert ["".join(text.get_text() for text in one.texts) for one in axes] == words
        if not beside:
            assert all(len(one.get_xticks()) == 0 for one in axes[1:] if one.texts)
    if row.scenes:
        assert len(dots(axes[1], 0, filled=row.clear > 0)) == row.scenes


def test_the_legend_explains_what_is_drawn_and_nothing_else():
    def words(*rows):
        return " ".join(text.get_text() for text in jp.plot.table4(rows)[3].figure.legends[0].get_texts())

    every = words(make_row(), *printed_rows(["keep_out"]))
    for word in ("found", "clear\nalong whole edges", "Wilson", "without", "mean", "printed"):
        assert word in every
    assert "printed" not in words(make_row())
    assert "without" not in words(make_row(found=12, clear=12))
    assert "along whole edges" not in words(*printed_rows(["keep_out"]))
    assert jp.plot.table4([make_row()], legend=False)[3].figure.legends == []


def test_it_is_drawn_where_it_is_told_to_be():
    before = dict(mpl.rcParams)
    rows = [make_row("keep_out"), make_row("held_links")]
    given = list(Figure().subplots(2, 4).ravel())
    assert jp.plot.table4(rows, ax=given) == given
    assert all(axes.has_data() and axes.get_xlabel() for axes in given)
    left, _ = Figure(layout="constrained").subfigures(1, 2)
    assert jp.plot.table4(rows, ax=left) == left.axes
    with pytest.raises(ValueError, match="8 panels, but 4 axes"):
        jp.plot.table4(rows, ax=given[:4])
    with pytest.raises(ValueError, match="no rows"):
        jp.plot.table4([])
    assert dict(mpl.rcParams) == before


def test_names_of_planners_are_shown_letter_by_letter():
    axes = jp.plot.table4([make_row(planner="_$x^{")])
    axes[0].figure.draw_without_rendering()
    assert axes[0].get_yticklabels()[0].get_text() == "_$x^{"
