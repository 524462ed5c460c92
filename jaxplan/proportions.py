"""Shares of successes, and how far off they may be."""


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson interval of a success rate.

    Args:
        successes: how many there were.
        trials: of how many.

    Returns:
        Lower and upper bound, from 0 to 1; both ends of it without trials.
    """
    from scipy.stats import binomtest

    if trials == 0:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)
