"""The paper's Table 4 again: how often, how fast and how near the shortest each planner of step 2 is.

Every planner gets the same scenes, goals and settings, and one search for each scene: the nearest goal of
step 1, no retries. A path is *found* when its planner says so, and *clear* when no edge of it breaks a
zone: checked here over every whole edge by the bound of `path.edge_margins`, whatever the planner itself has
looked at. Scenes that are proved to have no path are counted apart and left out of the rate. Times are those
of the search alone, compiled before, on the machine at hand; lengths are those of the paths that are clear,
in interior nodes, which is what the paper seems to count, and in steps (`path.step_cost`).
"""

from jaxplan.proportions import success_interval
from jaxplan.table4.comparison import TOLERANCE, compare, is_clear, least_margins, make_problem
from jaxplan.table4.rows import PAPER, PAPER_KINDS, Row, printed_rows
from jaxplan.table4.text import format_table

__all__ = [
    "PAPER",
    "PAPER_KINDS",
    "TOLERANCE",
    "Row",
    "compare",
    "format_table",
    "is_clear",
    "least_margins",
    "make_problem",
    "printed_rows",
    "success_interval",
]
