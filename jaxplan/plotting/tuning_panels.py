"""The course of a tuning: the objective in the top panel and each number in one below, by step or by trial.

A tuning by gradient proceeds in steps, one without gradient in trials.
"""

from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, ScalarFormatter, SymmetricalLogLocator

from jaxplan.plotting.style import (
    COLOURS,
    GREY,
    KEEP_OUT,
    TEXT,
    Canvas,
    Entries,
    Look,
    legend_beside,
    panels,
    plain,
    plain_numbers,
    tidy,
)
from jaxplan.runtime.arguments import expect_any
from jaxplan.tuning import SearchTuning, Tuning

Row = Mapping[str, float]

_FIGURE_WIDTH, _FIRST_HEIGHT, _OTHER_HEIGHT = 8.0, 2.6, 1.7  # inches; heights of its panels
_LOG_SCALE_RATIO = 10.0  # ratio of largest to least positive objective from which on its axis is logarithmic
_COUNT_COLUMNS = ("step", "trial")
_NOT_TUNED_COLUMNS = (*_COUNT_COLUMNS, "objective", "slope", "success_rate")
_VALUE_LINE: Look = {"color": COLOURS[0], "linewidth": 1.8}
_STEP_MARK: Look = {"marker": ".", "markersize": 6}
_TRIAL_MARK: Look = {"color": GREY, "linestyle": "", "marker": "o", "markersize": 4}
_ANSWER_MARK: Look = {
    "color": "black",
    "linestyle": "",
    "marker": "o",
    "markersize": 11,
    "markerfacecolor": "none",
    "clip_on": False,
}
_FAILED_MARK: Look = {"color": KEEP_OUT, "linestyle": "", "marker": "x", "markersize": 5}


def tuning(result: Tuning | SearchTuning, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw the objective and the tuned numbers by step; or by trial, with the best so far as a line.

    A ring marks the step or trial whose numbers are the answer. Trials are drawn as they were first measured;
    if times are the objective, the last measurement may choose another trial. The objective of a step is that
    of trajectories that are followed from the first plans, that of the answer is that of new plans.

    Args:
        result: of `jaxplan.tuning.tune` or `jaxplan.tune_search`.
        ax: one axes for the objective and one for each tuned number, a figure to put them in, or None for a
            new one.
        legend: whether to name the marks beside the first panel.

    Returns:
        The axes, from top to bottom: the objective, then the numbers.

    Raises:
        TypeError: if it is no result of tuning.
        ValueError: if there is nothing to draw, or another number of axes is given.

    Example:
        >>> jp.plot.tuning(jp.tune_search(range(20), "hard_keep_out", objective="expansions"))
    """
    expect_any("result", result, (Tuning, SearchTuning), "a Tuning or SearchTuning, as jp.tune returns")
    rows = result.history
    if not rows:
        raise ValueError("the tuning has no steps to draw")
    names = [name for name in rows[0] if name not in _NOT_TUNED_COLUMNS]
    heights = [_FIRST_HEIGHT, *[_OTHER_HEIGHT] * len(names)]
    grid = panels(ax, len(heights), (_FIGURE_WIDTH, sum(heights)), heights=heights)
    by_trials = "trial" in rows[0]
    count = "trial" if by_trials else "step"
    chosen = [row for row in rows if row[count] == result.answer]
    for axes, key in zip(grid, ("objective", *names), strict=True):
        tidy(axes)
        if by_trials:
            _draw_trials(axes, rows, key)
        else:
            axes.plot([row[count] for row in rows], [row[key] for row in rows], **_VALUE_LINE, **_STEP_MARK)
        for row in chosen:
            axes.plot([row[count]], [row[key]], **_ANSWER_MARK)
        plain(axes.set_ylabel(_break_name(result.label if key == "objective" else key), fontsize=TEXT))
        axes.yaxis.set_major_formatter(_FullNumberFormatter())
    _choose_scale(grid[0], np.array([row["objective"] for row in rows], dtype=float))
    grid[0].figure.align_ylabels(grid)
    grid[-1].set_xlabel(count, fontsize=TEXT)
    grid[-1].xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if legend:
        ring: Entries = [(Line2D([], [], **_ANSWER_MARK), "the answer")] * bool(chosen)
        legend_beside(grid[0], [*(_entries(rows) if by_trials else []), *ring])
    return grid


def _draw_trials(axes: Axes, rows: Sequence[Row], key: str) -> None:
    """Draw column `key` of all trials: a line for the best so far, dots, crosses for failed trials."""
    best = list(accumulate(rows, _better_trial))
    numbers = np.array([row["trial"] for row in rows])
    values = np.array([row[key] for row in rows], dtype=float)
    failed = _failed_trials(rows)
    axes.step(numbers, [row[key] for row in best], where="post", **_VALUE_LINE)
    axes.plot(numbers[~failed], values[~failed], **_TRIAL_MARK)
    axes.plot(numbers[failed], values[failed], **_FAILED_MARK)


def _failed_trials(rows: Sequence[Row]) -> np.ndarray:
    """Return which trials (k,), bool, planned fewer scenes than the most successful one."""
    rates = np.array([row["success_rate"] for row in rows])
    return rates < np.max(rates)


def _better_trial(first: Row, second: Row) -> Row:
    """Return the better of two trials: the higher success rate wins, then the lower objective."""
    return min(first, second, key=lambda row: (-row["success_rate"], row["objective"]))


def _choose_scale(axes: Axes, values: np.ndarray) -> None:
    """Make the vertical axis logarithmic if values (k,) differ by a factor of `_LOG_SCALE_RATIO` or more.

    If there are zeros the axis is linear up to the least positive value; negative values keep it linear.
    """
    known = values[np.isfinite(values)]
    positive = known[known > 0]
    if not len(positive) or np.any(known < 0) or np.max(known) < _LOG_SCALE_RATIO * np.min(positive):
        return
    subs = (1.0, 2.0, 5.0)
    if len(positive) == len(known):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    else:
        least = float(np.min(positive))
        axes.set_yscale("symlog", linthresh=least)
        axes.yaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=least, subs=subs))
    plain_numbers(axes.yaxis)


class _FullNumberFormatter(ScalarFormatter):
    """Formatter of ticks that writes each number in full, without an offset or power beside the axis."""

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Return labels for ticks at the given values, with as many digits as tell them apart."""
        ticks = np.asarray(values, dtype=float)
        for digits in range(6, 17):
            texts = [f"{tick:.{digits}g}" for tick in ticks]
            wrong = np.abs(np.array(texts, dtype=float) - ticks)
            if np.all(wrong <= 1e-3 * np.min(np.diff(np.sort(ticks)), initial=np.inf)):
                break
        short = (text.replace("e+0", "e").replace("e-0", "e-") for text in texts)
        return [text.replace("-", "\N{MINUS SIGN}") for text in short]


def _entries(rows: Sequence[Row]) -> Entries:
    """Return legend entries for trials, the best so far, and failed trials if there are any."""
    entries: Entries = [
        (Line2D([], [], **_VALUE_LINE), "best so far"),
        (Line2D([], [], **_TRIAL_MARK), "a trial"),
    ]
    return entries + [(Line2D([], [], **_FAILED_MARK), "fewer scenes\nplanned")] * bool(
        np.any(_failed_trials(rows))
    )


def _break_name(name: str) -> str:
    """Break a dotted name, or a sum of objectives, into lines that fit beside a low panel."""
    return name.replace(".", ".\n") if " " not in name else name.replace(" + ", " +\n").replace(" (", "\n(")
