"""Times between goals for schedulers: how long each slew from one goal to another takes at least, certified.

    >>> times = jp.slew_times(spacecraft, {"vela": {"telescope": vela}, "crab": {"telescope": crab}})
    >>> print(times)

`problem` says in which state the spacecraft leaves each goal, and makes a planning problem of each pair;
`matrix` plans them as a study, and `result` says what came of it.
"""

from jaxplan.slew_matrix.matrix import slew_times
from jaxplan.slew_matrix.result import SlewTimes, load_slew_times

__all__ = ["SlewTimes", "load_slew_times", "slew_times"]
