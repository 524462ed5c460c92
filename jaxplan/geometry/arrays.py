"""The module to compute with: numpy, or JAX as soon as one argument is an array of JAX or is traced by it.

So one line of code serves both. Plain numbers are computed in float64 whatever precision JAX is set to, and
come back as arrays of numpy; inside ``jit``, ``vmap`` and ``grad`` the same line is traced.
"""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

AnyArray: TypeAlias = Any
"""An array of numpy or of JAX."""


def array_module(*values: Any) -> Any:
    """`jax.numpy` if any of the values is an array of JAX or is traced, else `numpy`."""
    for value in values:
        if type(value) is not np.ndarray and isinstance(value, jax.Array):
            return jnp
    return np


def arrays(*values: Any) -> tuple[Any, ...]:
    """The module to compute with, and the values as floating-point arrays of it.

    Args:
        values: arrays, lists of numbers, or numbers.

    Returns:
        `array_module` of the values, then each of them. Floating-point arrays keep their dtype. For numpy
        a list or an array of integers becomes float64, and a number of Python takes the dtype of the others;
        for JAX both are of the precision that it is set to.
    """
    for value in values:
        if type(value) is not np.ndarray or value.dtype.kind != "f":
            break
    else:
        return np, *values  # nearly always: searches call this very often
    xp = array_module(*values)
    if xp is jnp:
        given = [jnp.asarray(value) for value in values]
        return xp, *(a if jnp.issubdtype(a.dtype, jnp.inexact) else a.astype(float) for a in given)
    known = [value if isinstance(value, int | float) else np.asarray(value) for value in values]
    common = np.result_type(0.0, *known)
    return xp, *(np.asarray(value, None if _is_floating(value) else common) for value in known)


def _is_floating(value: Any) -> bool:
    return isinstance(value, np.ndarray | np.generic) and bool(np.issubdtype(value.dtype, np.inexact))
