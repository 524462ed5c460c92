"""Outcomes of planning: for each a name, its meaning, and what the user may change."""

from enum import Enum


class Status(Enum):
    """How a plan, or a step of it, ended; the value says what it means."""

    OK = "a certified plan"
    INVALID_START = "the start breaks a constraint"
    INVALID_GOAL = "the goal breaks a constraint"
    GOAL_UNREACHABLE = "no attitude within reach lets all devices point at their targets within their limits"
    NO_PATH = "it is proved that no path exists"
    NODE_LIMIT = "no path was found within search.max_expansions"
    TIME_LIMIT = "no path was found within search.time_limit_s"
    LIMITS_TOO_TIGHT = "a motion does not fit into its time within the limits"
    GOAL_MISSED = "no duration was found after which the motion meets the moving goal"
    OUT_OF_WINDOW = "an activity of a timeline does not fit into its window"
    INFEASIBLE = "a quadratic program of the trajectory has no solution"
    UNCERTIFIED = "a trajectory was found but could not be proved safe"

    @property
    def step(self) -> str:
        """The step of planning at which it ended, one of `STEPS`.

        A certified plan went through all of them.
        """
        return _STEP_BY_STATUS[self]

    @property
    def advice(self) -> str:
        """What a user may change, in a sentence or two; empty for a certified plan."""
        return _ADVICE_BY_STATUS[self]


STEPS = ("start", "goal", "path", "trajectory", "certificate")
"""The steps of planning, in order."""

_STEP_BY_STATUS = {
    Status.OK: "certificate",
    Status.INVALID_START: "start",
    Status.INVALID_GOAL: "goal",
    Status.GOAL_UNREACHABLE: "goal",
    Status.NO_PATH: "path",
    Status.NODE_LIMIT: "path",
    Status.TIME_LIMIT: "path",
    Status.LIMITS_TOO_TIGHT: "trajectory",
    Status.GOAL_MISSED: "trajectory",
    Status.OUT_OF_WINDOW: "trajectory",
    Status.INFEASIBLE: "trajectory",
    Status.UNCERTIFIED: "certificate",
}

_ADVICE_BY_STATUS = {
    Status.OK: "",
    Status.INVALID_START: "Correct the state in [start], or the zone or limit that it breaks.",
    Status.INVALID_GOAL: (
        "Correct [goal], or the zone or limit that it breaks. Of a goal with targets a larger "
        "search.max_goals lets more attitudes be tried. A hidden target is seen at another "
        "trajectory.duration_s, which the message names."
    ),
    Status.GOAL_UNREACHABLE: (
        "Change goal.targets, widen spacecraft.terminal[i].yaw_limit_deg or pitch_limit_deg (or those of "
        "[goal]), shrink the zone in the way, or allow more time."
    ),
    Status.NO_PATH: (
        "No search can help: shrink or move a zone of the ring that the message names, do not bind the "
        "device to it, or change the goal."
    ),
    Status.NODE_LIMIT: (
        "Try another search.seed, raise search.max_expansions or search.max_goals, or take another "
        "search.method."
    ),
    Status.TIME_LIMIT: "Raise search.time_limit_s, or search.heuristic_weight for a hastier search.",
    Status.LIMITS_TOO_TIGHT: (
        'Set a longer trajectory.duration_s, or "stretched" or "minimum" to have it found, or raise the '
        "limits of rate and acceleration."
    ),
    Status.GOAL_MISSED: (
        "Give a number for trajectory.duration_s, or directions over a longer time: more of times_s, or a "
        "longer sky.for_duration_s."
    ),
    Status.OUT_OF_WINDOW: (
        "Let the activity's window end later or begin earlier, ask for less time in it, or for less before."
    ),
    Status.INFEASIBLE: (
        'Set a longer trajectory.duration_s, take trajectory.method = "global", or smaller search steps; '
        "with narrow joint ranges, keep start and goal farther inside."
    ),
    Status.UNCERTIFIED: (
        "The message says what could not be proved, and what to set, the most promising first: "
        "goal.clearance_deg where a margin is lost at the goal, search.clearance_deg where it is on the way, "
        "a longer trajectory.duration_s for limits."
    ),
}
