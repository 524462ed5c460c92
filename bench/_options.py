"""Types of options for argparse, which refuse what makes no sense, and the message on a missing package."""

import argparse
import math

# with the names of the package and of the extra
MISSING = "{} is missing: install the extra that brings it with pip install -e '.[{}]'"


def positive(text: str) -> int:
    """Read an integer of at least 1."""
    return _at_least(1, text)


def not_negative(text: str) -> int:
    """Read an integer of at least 0."""
    return _at_least(0, text)


def angle(text: str) -> float:
    """Read an angle in rad, from 0 to pi."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= math.pi:
        raise argparse.ArgumentTypeError(f"{text!r} must be an angle in rad, from 0 to pi")
    return value


def share(text: str) -> float:
    """Read a share in percent, from 0 to less than 100."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < 100:
        raise argparse.ArgumentTypeError(f"{text!r} must be a share in percent, from 0 to less than 100")
    return value


def _at_least(least: int, text: str) -> int:
    """Read an integer of at least `least`."""
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text!r} must be an integer of at least {least}")
    return int(text)
