"""Kernels that are ready soon: a first plan waits for their compilation much longer than for its results.

XLA writes the loops of a fused computation on the CPU in one of two ways. The newer one, through a language
of its own for loops, takes two to three times as long to compile kernels such as ours, and what it makes of
them is no quicker. `quick_jit` asks for the older one where the installed XLA still has it, and is `jax.jit`
otherwise.
"""

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

import jax

Answer = TypeVar("Answer")

_SOON: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}


def quick_jit(function: Callable[..., Answer], **options: Any) -> Callable[..., Answer]:
    """Jit a function so that it compiles in about half the time.

    Args:
        function: to be jitted; inside other traced functions it is as if jitted by `jax.jit`.
        options: of `jax.jit`.

    Returns:
        The same function, jitted.
    """
    traced = jax.jit(function, **options)
    jitted: list[Callable[..., Answer]] = []

    @wraps(function)
    def kernel(*args: Any, **kwargs: Any) -> Answer:
        if not jitted:  # at the first call, since asking XLA starts it
            jitted.append(jax.jit(function, **options, compiler_options=_SOON) if _known() else traced)
        try:
            return jitted[0](*args, **kwargs)
        except ValueError:  # JAX takes such options at the outermost level alone
            return traced(*args, **kwargs)

    return kernel


@cache
def _known() -> bool:
    """Tell whether kernels run on the CPU, by an XLA that knows these options."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=_SOON).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
