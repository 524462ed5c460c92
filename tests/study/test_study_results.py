"""What a study says: its summary, its comparison with another, its frames and its figures."""

import json
import sys
from dataclasses import replace
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from fake_study import plan_nothing, task
from matplotlib.figure import Figure
from scipy.stats import binom, binomtest

import jaxplan as jp
from jaxplan.plotting import study_figure
from jaxplan.plotting.study_figures import QUANTITIES
from jaxplan.study.run import run_task
from jaxplan.study.store import TABLE, TIMINGS


def make_study(scenes: int = 30, planner: str = "mha", *, failing: int | None = None, **changes) -> jp.Study:
    """One whose scenes fail where their number is a multiple of three, or those below a number."""
    study = run_task(task(scenes, planner), None, None, None, False, plan_nothing)
    if failing is None:
        return replace(study, **changes)
    table = [{**study.table[1], "scene": k, "seed": k, "duration_s": 10.0 + k} for k in range(scenes)]
    for row in table[:failing]:
        row.update(
            status="NODE_LIMIT", certified=False, duration_s=None, length_steps=None, min_margin_deg=None
        )
    return replace(study, _memory_rows={TABLE: table, TIMINGS: study.timings}, **changes)


def test_the_summary_counts_successes_and_takes_quantiles_of_plans_and_of_all_times():
    study = make_study(30)
    summary = study.summary()
    planned = np.array([k for k in range(30) if k % 3])
    wilson = binomtest(20, 30).proportion_ci(method="wilson")
    assert (summary.scenes, summary.done, summary.planned) == (30, 30, 20)
    assert summary.success_rate == 20 / 30
    assert summary.interval == pytest.approx((wilson.low, wilson.high))
    assert summary.statuses == {"OK": 20, "NODE_LIMIT": 10}
    spread = summary.record()["spreads"]
    assert spread["time (s), all scenes"]["values"] == spread["expansions, all scenes"]["values"] == 30
    assert spread["time (s), all scenes"]["95 %"] == pytest.approx(np.quantile(1.0 + np.arange(30), 0.95))
    assert spread["path length (steps)"]["median"] == pytest.approx(np.median(5 + planned / 3))
    assert spread["duration over its bound"]["most"] == pytest.approx((20 + 29 / 9) / 20)
    assert spread["smallest margin (deg)"]["least"] == pytest.approx(0.1 + 1 / 11)
    assert json.loads(json.dumps(summary.record())) == summary.record()


def test_the_summary_lines_up_and_shows_as_html():
    study = make_study(30, settings={"search.seed": 1})
    lines = str(study.summary()).splitlines()
    assert lines[0] == "Study of 30 keep_in scenes by mha, search.seed = 1"
    assert len({len(line) for line in lines[4:]}) == 1
    assert str(study) == str(study.summary())
    html = study._repr_html_()
    assert html.count("<tr>") == len(lines) - 1
    assert "<caption>Study of 30 keep_in" in html
    assert "<script>" not in replace(study, planner="<script>")._repr_html_()


def test_a_study_without_plans_or_scenes_has_a_summary_too():
    nothing = make_study(5, failing=5).summary()
    assert nothing.success_rate == 0
    assert "path length" not in str(nothing)
    empty = replace(make_study(5), _memory_rows={TABLE: [], TIMINGS: []}).summary()
    assert empty.success_rate is None
    assert empty.interval == (0, 1)
    assert "0 done of 5" in str(empty)


@pytest.mark.parametrize(("first", "second"), [(0, 8), (8, 0), (3, 9), (0, 0), (5, 5)])
def test_success_is_compared_by_the_scenes_in_which_it_differs(first, second):
    compared = jp.compare_studies(make_study(30, failing=first), make_study(30, "wastar", failing=second))
    assert (compared.only_first, compared.only_second) == (max(second - first, 0), max(first - second, 0))
    assert (compared.both, compared.neither) == (30 - max(first, second), min(first, second))
    differing = abs(first - second)
    tail = 2 * binom.cdf(0, differing, 0.5) if differing else 1.0
    assert compared.p_value == pytest.approx(min(tail, 1.0))


def test_what_both_plan_is_compared_scene_by_scene():
    one, other = make_study(30, failing=2), make_study(30, "wastar", failing=4)
    for row in other.table[4:]:
        row["duration_s"] += row["scene"] - 6
    compared = jp.compare_studies(one, other)
    change = np.arange(4, 30) - 6.0
    duration = compared.differences["duration (s)"]
    assert duration["scenes"] == 26
    assert duration["difference"] == pytest.approx(change.mean())
    assert duration["median"] == pytest.approx(np.median(change))
    assert duration["5 %"] == pytest.approx(np.quantile(change, 0.05))
    assert duration["second less"] == pytest.approx(np.mean(change < 0))
    lines = str(compared).splitlines()
    assert len({len(line) for line in lines[5:]}) == 1
    assert compared._repr_html_().count("<tr>") == len(lines) - 1
    assert json.loads(json.dumps(compared.record()))["neither"] == 2


def test_studies_are_paired_by_seed_and_only_of_the_same_kind():
    one, other = make_study(10), make_study(30)
    assert jp.compare_studies(one, other).scenes == 10
    with pytest.raises(ValueError, match="different scenes, kind = 'keep_in' and None"):
        jp.compare_studies(one, replace(other, kind=None))
    shifted = replace(
        one, _memory_rows={TABLE: [{**row, "seed": row["seed"] + 50} for row in one.table], TIMINGS: []}
    )
    with pytest.raises(ValueError, match="no scene in common"):
        jp.compare_studies(one, shifted)


def test_frames_and_parquet_files_hold_the_table_and_the_times(tmp_path):
    pd = pytest.importorskip("pandas", reason="needs the extra study")
    pytest.importorskip("pyarrow", reason="needs the extra study")
    study = make_study(9)
    frame = study.to_pandas()
    assert list(frame["scene"]) == list(range(9))
    assert frame["duration_s"].isna().tolist() == [k % 3 == 0 for k in range(9)]
    assert frame["total_s"].tolist() == [1.0 + k for k in range(9)]
    assert frame["interior_nodes"].dtype == "Int64"
    study.to_parquet(tmp_path / "study.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "study.parquet"), frame)
    with pytest.raises(OSError, match="study"):
        study.to_parquet(tmp_path / "study.parquet" / "in-a-file.parquet")
    assert [file.name for file in tmp_path.iterdir()] == ["study.parquet"]


@pytest.mark.parametrize(("package", "call"), [("pandas", "to_pandas"), ("pyarrow", "to_parquet")])
def test_a_missing_package_is_named_with_its_extra(monkeypatch, tmp_path, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    arguments = [tmp_path / "x.parquet"] if call == "to_parquet" else []
    with pytest.raises(ImportError, match=rf"{package} is missing.*jaxplan\[study\]"):
        getattr(make_study(3), call)(*arguments)


def curve(axes: mpl.axes.Axes, place: int = 0) -> np.ndarray:
    return [line for line in axes.lines if line.get_drawstyle().startswith("steps")][place].get_xydata()


def test_curves_count_all_scenes_and_end_at_the_success_rate():
    study = make_study(30)
    axes = jp.plot.distribution(study, "duration_s")
    points = curve(axes)
    assert points[-1, 1] == pytest.approx(100 * 20 / 30)
    durations = np.array([row["duration_s"] for row in study.table if row["duration_s"]])
    for value, share in points[1:]:
        assert share == pytest.approx(100 * np.mean(durations <= value + 1e-12) * 20 / 30)
    dotted = [line for line in axes.lines if line.get_linestyle() == ":"]
    assert [line.get_ydata()[0] for line in dotted] == pytest.approx([100 * 20 / 30])
    assert dotted[0].get_xdata()[1] == axes.get_xlim()[1]
    full = jp.plot.distribution(make_study(10, failing=0), "duration_s")
    assert curve(full)[-1, 1] == 100
    assert not [line for line in full.lines if line.get_linestyle() == ":"]


def test_the_curve_of_margins_counts_scenes_with_at_least_a_margin():
    study = make_study(30)
    points = curve(jp.plot.distribution(study, "min_margin_deg"))
    margins = np.array([row["min_margin_deg"] for row in study.table if row["min_margin_deg"]])
    assert tuple(points[0]) == (0, pytest.approx(100 * 20 / 30))
    assert points[-1, 1] == 0
    for value, share in points[1:-1]:
        assert share == pytest.approx(100 * np.sum(margins >= value - 1e-12) / 30)


def test_small_margins_and_few_expansions_are_told_apart_from_none():
    study = make_study(30)
    rows = [row | {"min_margin_deg": 0.3, "expansions": 4000} for row in study.table[:1] + study.table[2:]]
    rows.append(study.table[1] | {"min_margin_deg": 60.0, "expansions": 0})
    study = replace(study, _memory_rows={TABLE: rows, TIMINGS: study.timings})
    for quantity, small, large in (("min_margin_deg", 0.3, 60), ("expansions", 1, 4000)):
        axes = jp.plot.distribution(study, quantity)
        axes.figure.draw_without_rendering()
        shares = axes.transAxes.inverted().transform(
            axes.transData.transform([(v, 0) for v in (0, small, large)])
        )
        assert shares[0, 0] == pytest.approx(0, abs=1e-9)
        assert shares[1, 0] > 0.05
        assert shares[2, 0] < 1
        labels = {
            label.get_text(): x for x, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
        }
        assert {"0", "1", "10"} <= set(labels)
        assert all(float(text) == value for text, value in labels.items())


def test_broken_lines_lie_over_unbroken_ones_that_coincide():
    planners = ("mha", "mha-paper", "wastar", "rrt_star", "rrt_connect")
    axes = jp.plot.distribution([make_study(12, planner) for planner in planners])
    steps = [line for line in axes.lines if line.get_drawstyle().startswith("steps")]
    unbroken = [line.get_zorder() for line in steps if not line.is_dashed()]
    assert len(unbroken) == 2
    assert max(unbroken) < min(line.get_zorder() for line in steps if line.is_dashed())


def test_success_rates_stand_between_the_ends_of_their_intervals():
    axes = jp.plot.success_rates([make_study(30), make_study(30, "wastar", failing=30)])
    marks = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
    assert marks == pytest.approx([100 * 20 / 30, 0])
    spans = [tuple(line.get_xdata()) for line in axes.lines if line.get_marker() == "None"]
    for span, count in zip(spans, (20, 0), strict=True):
        wilson = binomtest(count, 30).proportion_ci(method="wilson")
        assert span == pytest.approx((100 * wilson.low, 100 * wilson.high), abs=1e-9)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["mha", "wastar"]
    assert {text.get_text() for text in axes.texts} == {"20/30", "0/30"}


def test_bars_of_outcomes_fill_the_line():
    axes = jp.plot.outcomes([make_study(30), make_study(10, failing=10)])
    for line in (0, 1):
        bars = [bar for bar in axes.patches if abs(bar.get_y() + bar.get_height() / 2 - line) < 0.1]
        assert sum(bar.get_width() for bar in bars) == pytest.approx(100)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["OK", "NODE_LIMIT"]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_any_number_of_studies_fits_on_the_page(count):
    studies = [
        make_study(12, planner) for planner in ("mha", "mha-paper", "wastar", "rrt_star", "rrt_connect")
    ]
    figure = study_figure(studies[:count])
    figure.draw_without_rendering()
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 6
    assert all(axes.get_xlabel() for axes in figure.axes)
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert box.x0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1
        names = [label.get_window_extent() for label in axes.get_yticklabels() if label.get_visible()]
        assert not any(one.overlaps(other) for one, other in pairwise(names))
    legends = [axes.get_legend().get_window_extent() for axes in figure.axes if axes.get_legend()]
    assert len(legends) == 2
    assert not legends[0].overlaps(legends[1])
    assert not any(legend.overlaps(axes.get_window_extent()) for legend in legends for axes in figure.axes)


def test_studies_are_named_by_what_tells_them_apart():
    def names(*studies):
        axes = jp.plot.success_rates(studies[0] if len(studies) == 1 else studies)
        return [label.get_text() for label in axes.get_yticklabels()]

    one = make_study(4)
    assert names(one) == ["mha"]
    assert names(one, replace(one, kind="keep_out")) == ["mha, keep_in", "mha, keep_out"]
    assert names(one, replace(one, settings={"search.seed": 1})) == ["mha", "mha, search.seed = 1"]
    assert names(one, one) == ["mha (1)", "mha (2)"]
    assert names({"a": one, "b": one}) == ["a", "b"]


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_has_an_axis_with_numbers_even_without_plans(quantity):
    for failing in (None, 12, 11):
        axes = jp.plot.distribution(make_study(12, failing=failing), quantity)
        axes.figure.draw_without_rendering()
        assert axes.get_xlabel()
        if failing is None and quantity not in ("search_s", "peak"):
            low, high = axes.get_xlim()
            assert sum(low <= tick <= high for tick in axes.get_xticks()) >= 2
    assert [text.get_text() for text in jp.plot.distribution(make_study(3, failing=3), quantity).texts] == [
        "no plans"
    ]


def test_a_single_scene_is_told_in_the_singular():
    assert str(make_study(1)).startswith("Study of 1 keep_in scene by mha")
    assert str(jp.compare_studies(make_study(1), make_study(1))).startswith(
        "Two studies of the same 1 scene\n"
    )
    assert str(make_study(2)).startswith("Study of 2 keep_in scenes by mha")


def test_what_cannot_be_drawn_is_refused_with_a_reason():
    with pytest.raises(ValueError, match="no studies to draw"):
        jp.plot.study([])
    with pytest.raises(ValueError, match="mha has no scenes to draw yet"):
        jp.plot.study(replace(make_study(3), _memory_rows={TABLE: [], TIMINGS: []}))
    with pytest.raises(ValueError, match="quantity = 'speed': must be one of total_s"):
        jp.plot.distribution(make_study(3), "speed")
    with pytest.raises(ValueError, match="6 panels, but 1 axes"):
        jp.plot.study(make_study(3), Figure().subplots())
