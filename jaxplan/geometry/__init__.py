"""Algebra of rotations, of directions and of small vectors.

Each function computes with numpy or with JAX, depending on its arguments (`vectors.array_module`).
"""

from jaxplan.runtime.cache import keep_by_default

keep_by_default()  # here, since every module with compiled kernels imports this package
