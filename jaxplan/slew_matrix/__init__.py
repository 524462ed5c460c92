"""Slew times for schedulers: the shortest certified time of the slew from each goal to each other.

    >>> times = jp.slew_times(spacecraft, {"vela": {"telescope": vela}, "crab": {"telescope": crab}})
    >>> print(times)

`problem` finds the state in which the spacecraft leaves each goal, and makes a planning problem of each pair
of goals; `matrix` plans them as a study, and `result` holds the matrix of their times.
"""

from jaxplan.slew_matrix.matrix import slew_times
from jaxplan.slew_matrix.result import SlewTimes, load_slew_times

__all__ = ["SlewTimes", "load_slew_times", "slew_times"]
