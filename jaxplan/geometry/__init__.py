"""The algebra that everything else computes with: of rotations, of directions, of small vectors.

Each function computes with numpy or with JAX, whichever its arguments are of (`vectors.array_module`).
"""

from jaxplan.runtime.cache import keep_by_default

keep_by_default()  # here, since whatever this package has compiled computes with these
