"""A motion as one C99 file and its header, which evaluate the certified polynomials and need nothing else.

The templates are `evaluator.c` and `evaluator.h` beside this file. Names between ``@`` stand in them for the
numbers and names of a motion, which are filled in here. The space and time that the code needs are known
beforehand and stated in the header: all its loops have fixed length, except one that finds a piece by
bisection.
"""

import re
from collections.abc import Iterable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.flight import Flight
from jaxplan.exporting.messages import plain
from jaxplan.exporting.pieces import Pieces, pieces_of
from jaxplan.exporting.sampled import Sampling
from jaxplan.version import __version__

LONGEST_PREFIX = 18  # characters: C99 distinguishes external names by 31, of which _evaluate takes 9
# Most operations of a call of evaluator.c, without those of the polynomials and of finding the pieces.
_MULTIPLICATIONS, _ADDITIONS, _DIVISIONS, _SINES, _ROOTS = 389, 271, 26, 6, 3
_NUMBERS_PER_LINE = 4  # numbers on a line of a table

_JOINT_TABLES = """
static const double JOINT_BREAKS[JOINT_PIECES + 1] = {
@JOINT_BREAKS@};
"""
_JOINT_POLYNOMIALS = """
static const double Q[JOINT_PIECES][JOINT_POWERS][@UPPER@_JOINTS] = {
@JOINT_COEFFICIENTS@};
"""
_JOINT_FUNCTION = """
static void joints(double t, @PREFIX@_state *state)
{
    const uint32_t piece = piece_at(@BREAKS_OF_JOINTS@, JOINT_PIECES, t);
    double x;
    double slope;
    uint32_t i;
    uint32_t k;

    place(@BREAKS_OF_JOINTS@, piece, t, &x, &slope);
    for (i = 0U; i < (uint32_t)@UPPER@_JOINTS; i++)
    {
        double value = 0.0;
        double first = 0.0;
        double second = 0.0; /* half of it */
        for (k = JOINT_POWERS; k > 0U; k--)
        {
            second = (second * x) + first;
            first = (first * x) + value;
            value = (value * x) + Q[piece][k - 1U][i];
        }
        state->joints[i] = value;
        state->joint_rates[i] = first * slope;
        state->joint_accelerations[i] = 2.0 * second * slope * slope;
    }
}
"""
_JOINT_REST = """        for (i = 0U; i < (uint32_t)@UPPER@_JOINTS; i++)
        {
            state->joint_rates[i] = 0.0;
            state->joint_accelerations[i] = 0.0;
        }
"""
_JOINT_FIELDS = """    double joints[@UPPER@_JOINTS];              /* rad */
    double joint_rates[@UPPER@_JOINTS];         /* rad/s */
    double joint_accelerations[@UPPER@_JOINTS]; /* rad/s^2 */
"""


def write_code(sampling: Sampling, folder: Path) -> None:
    """Write ``NAME.c`` and ``NAME.h``; NAME is the object's name or that of the scenario in lower case.

    Args:
        sampling: the motion's sampling; its instants are not used.
        folder: an empty one.
    """
    flight = sampling.flight
    own, title = pieces_of(flight.trajectory), sampling.names.object_name or flight.name
    prefix = prefix_of(title)
    known = _template_values(flight, own, prefix)
    known |= {
        "TITLE": _to_comment(title),
        "EPOCH": "none is known" if sampling.start is None else f"{sampling.start} UTC",
    }
    for ending in ("h", "c"):
        text = files("jaxplan.exporting").joinpath(f"evaluator.{ending}").read_text(encoding="ascii")
        filled = re.sub(r"@([A-Z_]+)@", lambda found: known[found[1]], text)
        (folder / f"{prefix}.{ending}").write_text(filled, encoding="ascii")


def what_is_needed(flight: Flight) -> str:
    """Return a phrase on the space and time that the code of a motion needs."""
    own = pieces_of(flight.trajectory)
    space = f"{len(own.breaks) - 1} pieces, {_table_bytes(own)} bytes of tables"
    return f"{space}; a call takes {_describe_operations(own)} at most"


def prefix_of(title: str) -> str:
    """Return the prefix of all names in a motion's code, made from a title: ``[a-z][a-z0-9_]*``."""
    word = re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_") or "motion"
    return (word if word[0].isalpha() else f"m_{word}")[:LONGEST_PREFIX].rstrip("_")


def _template_values(flight: Flight, own: Pieces, prefix: str) -> dict[str, str]:
    """Return what replaces each name between ``@`` in the templates, except the title and the epoch."""
    count = own.joint_count
    duration = float(flight.trajectory.duration)
    names = [_to_comment(name) for name in flight.spacecraft.joint_names]
    values = {
        "VERSION": __version__,
        "PREFIX": prefix,
        "PREFIX_UPPER": prefix.upper(),
        "GUARD": f"{prefix.upper()}_H",
        "DURATION": f"{duration:.9g}",
        "DURATION_LITERAL": repr(duration),
        "JOINTS": f"{count}",
        "JOINT_LIST": ", ".join(names) or "none",
        "PIECES": f"{len(own.breaks) - 1}",
        "JOINT_PIECES": f"{len(own.joint_breaks) - 1 if count else 0}",
        "POWERS": f"{own.coefficients.shape[1]}",
        "CHARTS": f"{len(own.starts)}",
        "BYTES": f"{_table_bytes(own)}",
        "STATE_BYTES": f"{8 * (4 + 9 + 3 + 3 + 3 * count)}",
        "OPERATIONS": _describe_operations(own),
        "BREAKS": _format_numbers(own.breaks),
        "COEFFICIENTS": _format_nested(own.coefficients),
        "CHART": _wrap_words(f"{number}U" for number in own.chart.tolist()),
        "CHART_ROWS": _format_nested(np.column_stack([own.quaternions, own.starts, own.rates])),
    }
    pieces, powers = len(own.joint_breaks) - 1, own.joint_coefficients.shape[1]
    parts = {
        "JOINT_MACROS": f"#define JOINT_PIECES ({pieces})\n#define JOINT_POWERS ({powers})\n",
        "JOINT_TABLES": ("" if own.shares_breaks else _JOINT_TABLES) + _JOINT_POLYNOMIALS,
        "JOINT_FUNCTION": _JOINT_FUNCTION,
        "JOINT_CALL": "    joints(time, state);\n",
        "JOINT_REST": _JOINT_REST,
        "JOINT_FIELDS": _JOINT_FIELDS,
    }
    inner = {
        "UPPER": prefix.upper(),
        "PREFIX": prefix,
        "BREAKS_OF_JOINTS": "BREAKS" if own.shares_breaks else "JOINT_BREAKS",
        "JOINT_BREAKS": _format_numbers(own.joint_breaks),
        "JOINT_COEFFICIENTS": _format_nested(own.joint_coefficients) if count else "",
    }
    filled = {
        name: re.sub(r"@([A-Z_]+)@", lambda found: inner[found[1]], part) if count else ""
        for name, part in parts.items()
    }
    return values | filled


def _table_bytes(own: Pieces) -> int:
    """Number of bytes of the constant tables: doubles, and the chart of each piece in 32 bits."""
    return 8 * own.numbers + 4 * len(own.chart)


def _describe_operations(own: Pieces) -> str:
    """Return words for the most operations of a call: those of evaluator.c with its loops at their longest.

    The numbers that do not depend on the motion are constants; a test counts them by running the code.
    """
    count = own.joint_count
    steps = 3 * own.coefficients.shape[1] + count * own.joint_coefficients.shape[1]  # of Horner's scheme
    searched = [len(own.breaks) - 1, *([len(own.joint_breaks) - 1] if count else [])]
    found = len(searched)
    multiplications = _MULTIPLICATIONS + 3 * steps + 4 * (3 + count) + found
    additions = _ADDITIONS + 3 * steps + 3 * found
    halvings = sum(int(np.ceil(np.log2(pieces))) for pieces in searched)
    return (
        f"{multiplications} multiplications, {additions} additions, "
        f"{_DIVISIONS + found} divisions, {_SINES} sines "
        f"and cosines, {_ROOTS} roots, {halvings} halvings"
    )


def _to_comment(text: str) -> str:
    """Return a text in a form that may stand in a C comment."""
    return plain(text).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")


def _format_numbers(values: np.ndarray) -> str:
    """Format doubles with all their digits, as lines of a C table."""
    return _wrap_words(map(repr, np.asarray(values, np.float64).tolist()))


def _wrap_words(words: Iterable[str]) -> str:
    """Format words as lines of `_NUMBERS_PER_LINE` words with commas."""
    every = list(words)
    rows = (every[first : first + _NUMBERS_PER_LINE] for first in range(0, len(every), _NUMBERS_PER_LINE))
    return "".join(f"    {', '.join(row)},\n" for row in rows)


def _format_nested(table: np.ndarray) -> str:
    """Format an array of two or more axes as nested C braces; each line has one row of its last axis."""
    return "".join(_nested_lines(np.asarray(table, np.float64).tolist(), "    "))


def _nested_lines(table: list[Any], indent: str) -> Iterator[str]:
    """Yield the lines of nested lists, in braces."""
    for row in table:
        if isinstance(row[0], list):
            yield f"{indent}{{\n"
            yield from _nested_lines(row, f"{indent}    ")
            yield f"{indent}}},\n"
        else:
            yield f"{indent}{{{', '.join(map(repr, row))}}},\n"
