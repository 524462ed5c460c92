"""Outcomes of planning: one word each, and what it means for the user."""

from enum import Enum


class Status(Enum):
    """How a plan, or a step of it, ended; the value says what it means."""

    OK = "a certified plan"
    INVALID_START = "the start breaks a constraint"
    INVALID_GOAL = "the goal breaks a constraint"
    GOAL_UNREACHABLE = "no attitude lets all terminals point at their targets within their limits"
    NO_PATH = "it is proved that no path exists"
    NODE_LIMIT = "no path was found within search.max_expansions"
    TIME_LIMIT = "no path was found within search.time_limit_s"
    LIMITS_TOO_TIGHT = "the manoeuvre does not fit into trajectory.duration_s within the limits"
    INFEASIBLE = "a quadratic program of the trajectory has no solution"
    UNCERTIFIED = "a trajectory was found but could not be proved safe"
