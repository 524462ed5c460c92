import time

import jax
import numpy as np

from jaxplan.runtime.jit import working_time


def test_the_clock_stands_still_while_jax_compiles_and_runs_otherwise():
    def slow_to_compile(x):
        for k in range(300):
            x = jax.numpy.sin(x + k) @ x
        return x

    argument = np.eye(7)
    begin, began = time.monotonic(), working_time()
    np.asarray(jax.jit(slow_to_compile)(argument))
    wall, working = time.monotonic() - begin, working_time() - began
    assert working < 0.5 * wall
    begin, began = time.monotonic(), working_time()
    time.sleep(0.05)
    assert abs((working_time() - began) - (time.monotonic() - begin)) < 1e-3
