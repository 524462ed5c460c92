"""Kernels that are ready soon are ordinary jitted functions."""

import gc
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxplan.runtime import jit as quick
from jaxplan.runtime.jit import quick_jit


@quick_jit
def cubed(x):
    if x.ndim > 1:
        raise ValueError("too many axes")
    return jnp.sin(x) * x**2


def test_it_computes_what_the_function_does_at_top_level_and_inside_other_functions():
    x = np.linspace(0.5, 1, 4)
    np.testing.assert_allclose(cubed(x), np.sin(x) * x**2, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(lambda y: cubed(y) + 1)(x), np.sin(x) * x**2 + 1, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(cubed)(x), np.sin(x) * x**2, rtol=1e-12)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(jax.grad(cubed)))(x), np.cos(x) * x**2 + 2 * x * np.sin(x), rtol=1e-12
    )


def test_faults_of_the_function_itself_are_raised():
    with pytest.raises(ValueError, match="too many axes"):
        cubed(np.ones((2, 2)))


def test_static_arguments_are_static():
    power = quick_jit(lambda x, n: x**n, static_argnums=1)
    assert power(2.0, 3) == 8


def test_options_that_an_xla_does_not_have_are_left_out_and_others_kept(monkeypatch):
    monkeypatch.setattr(quick, "_QUICK_OPTIONS", {"xla_no_such_option": False})
    assert quick_jit(lambda x: x + 1)(1.0) == 2
    assert quick_jit(lambda x: x + 1, level=1)(1.0) == 2
    some = {"xla_no_such_option": False, "xla_backend_optimization_level": 1}
    assert quick.known_options(**some) == {"xla_backend_optimization_level": 1}


@pytest.mark.parametrize("before", [True, False])
def test_no_garbage_is_looked_for_while_kernels_are_traced_and_all_is_as_before_afterwards(before):
    found, first_is_traced, go_on = [], threading.Event(), threading.Event()

    @quick_jit
    def slow(x):
        first_is_traced.set()
        go_on.wait(10)
        found.append(gc.isenabled())
        return x + 1

    @quick_jit
    def quick_one(x):
        found.append(gc.isenabled())
        return x + 2

    def fails(x):
        raise ArithmeticError(x)

    enabled = gc.isenabled()
    (gc.enable if before else gc.disable)()
    try:
        thread = threading.Thread(target=slow, args=(1.0,))
        thread.start()
        assert first_is_traced.wait(10)
        assert quick_one(1.0) == 3
        with pytest.raises(ArithmeticError):
            quick_jit(fails)(1.0)
        assert not gc.isenabled()  # the other thread is still at it
        go_on.set()
        thread.join()
        assert found == [False, False]
        assert gc.isenabled() == before
    finally:
        (gc.enable if enabled else gc.disable)()


def test_a_kernel_is_compiled_although_another_trace_does_not_end(monkeypatch):
    """What that trace waits for may be this kernel; and a trace that fails holds nobody up."""
    monkeypatch.setattr(quick, "_LONGEST_WAIT", 0.05)
    begun, over, told = threading.Event(), threading.Event(), []

    def trace():
        with quick._turn_to_trace():
            begun.set()
            told.append(over.wait(20))

    other = threading.Thread(target=trace)
    other.start()
    try:
        assert begun.wait(60)
        assert float(quick_jit(lambda x: x + 1)(1.5)) == 2.5
    finally:
        over.set()
        other.join()
    assert told == [True]  # the kernel came before the trace gave up
    with pytest.raises(KeyError), quick._turn_to_trace():
        raise KeyError
    free = []

    def trace_again():
        if quick._tracing.acquire(timeout=5):
            free.append(True)
            quick._tracing.release()

    again = threading.Thread(target=trace_again)
    again.start()
    again.join()
    assert free
