"""Table 4 as text."""

from collections.abc import Iterable

import numpy as np

from jaxplan.table4.rows import Row, printed_rows, spread


def format_table(rows: Iterable[Row]) -> str:
    """The rows as text, those of a kind together with the paper's.

    Times in seconds, lengths in interior nodes and in steps: least, largest and mean.
    """
    lines, kind = [], None
    for row in rows:
        if row.kind != kind:
            kind = row.kind
            lines += ["", f"{kind}", _HEAD, *(_line(paper) for paper in printed_rows([kind]))]
        lines.append(_line(row))
    return "\n".join(lines[1:])


_HEAD = (
    f"  {'planner':<14}{'found':>10}{'clear':>10}  {'95 % of clear':>14}"
    f"{'MinT':>9}{'MaxT':>9}{'AT':>9}{'MinL':>7}{'MaxL':>6}{'AL':>7}{'steps':>8}"
)


def _line(row: Row) -> str:
    judged = row.found if row.clear is None else row.clear
    low, high = row.interval(judged)
    printed = row.steps is None
    seconds = [f"{value:9.1f}" if printed else f"{value:9.4f}" for value in spread(row.seconds, printed)]
    nodes = spread(row.nodes, printed)
    steps = "" if row.steps is None or not len(row.steps) else f"{np.mean(row.steps):8.2f}"
    return (
        f"  {row.planner:<14}{row.found:>5}/{row.scenes:<4}"
        + (f"{'':>10}" if row.clear is None else f"{row.clear:>5}/{row.scenes:<4}")
        + f"  {100 * low:5.1f} to {100 * high:5.1f}"
        + "".join(seconds)
        + f"{nodes[0]:7.0f}{nodes[1]:6.0f}{nodes[2]:7.1f}{steps}"
    )
