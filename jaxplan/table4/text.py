"""Table 4 as text."""

from collections.abc import Iterable

from jaxplan.table4.rows import Row, printed_rows, spread


def format_table(rows: Iterable[Row]) -> str:
    """The rows as text, those of a kind together with the paper's.

    Rates with their 95 % Wilson intervals; times in seconds, lengths in interior nodes and in steps: least,
    largest and mean.
    """
    lines, kind = [], None
    for row in rows:
        if row.kind != kind:
            kind = row.kind
            lines += ["", f"{kind}", _HEAD, *(_line(paper) for paper in printed_rows([kind]))]
        lines.append(_line(row))
    return "\n".join(lines[1:])


_HEAD = (
    f"  {'planner':<14}{'found':>10}  {'95 %':>14}{'clear':>11}  {'95 %':>14}"
    f"{'MinT':>9}{'MaxT':>9}{'AT':>9}{'MinL':>6}{'MaxL':>6}{'AL':>7}{'steps: min':>12}{'max':>7}{'mean':>7}"
)


def _line(row: Row) -> str:
    printed = row.steps is None
    seconds = [9, 9, 9], (".1f" if printed else ".4f")
    return (
        f"  {row.planner:<14}"
        + _rate(row, row.found, 10)
        + (_rate(row, row.clear, 11) if row.clear is not None else " " * 27)
        + _numbers(spread(row.seconds, printed), *seconds)
        + _numbers(spread(row.nodes, printed), [6, 6, 7], ".0f", ".1f")
        + ("" if row.steps is None else _numbers(spread(row.steps, False), [12, 7, 7], ".2f"))
    ).rstrip()


def _rate(row: Row, count: int, width: int) -> str:
    """A count with its Wilson interval."""
    low, high = row.interval(count)
    return f"{f'{count}/{row.scenes:<4}':>{width}}  {100 * low:5.1f} to {100 * high:5.1f}"


def _numbers(
    values: tuple[float, float, float] | None, widths: list[int], form: str, mean_form: str | None = None
) -> str:
    """Least, largest and mean in columns; dashes where there is nothing."""
    if values is None:
        return "".join(f"{'-':>{width}}" for width in widths)
    forms = [form, form, mean_form or form]
    return "".join(f"{value:{width}{f}}" for value, width, f in zip(values, widths, forms, strict=True))
