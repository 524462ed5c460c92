"""Derivatives that hold for the first order only, and say so where a second one is asked for."""

from typing import Any, NoReturn

import jax
import jax.numpy as jnp


@jax.custom_jvp
def _once(value: Any) -> Any:
    return value


@_once.defjvp
def _refuse(*_: Any) -> NoReturn:
    raise NotImplementedError(
        "plans have first derivatives only, since what binds is held: take differences of those"
    )


def first_derivatives_only(tree: Any) -> Any:
    """The same tree, whose numbers cannot be differentiated; for use within a rule for tangents."""
    return jax.tree.map(
        lambda leaf: _once(leaf) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else leaf, tree
    )
