"""Whether anything is compiled, or read from what other processes have compiled."""

from contextlib import contextmanager

import numpy as np
import pytest

from jaxplan.runtime import jit
from jaxplan.runtime.jit import kernel_count


@contextmanager
def nothing_new(compilations, *about):
    """Within the block no kernel is compiled, nor read that was compiled by another process."""
    before = kernel_count()
    compilations.clear()
    # Other tests of this worker may have made so many kernels that the next plan would forget some.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jit, "_MOST_MAPS_SHARE", 1.0)
        patch.setattr(jit, "_MOST_KERNELS", np.inf)
        yield
    assert (kernel_count() - before, compilations) == (0, []), about
