"""Inverses of many small matrices, of which one without an inverse harms no other."""

import numpy as np


def inverses(matrices: np.ndarray) -> np.ndarray:
    """Of square matrices (G, n, n); NaN where there is none."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # of one: the others have theirs
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
        return np.concatenate([inverses(own[None]) for own in matrices])
