"""One spline over the whole manoeuvre, by sequential quadratic programming.

`strategy` chooses durations and which `attempts` are made; `build` makes a task of a path; `sqp` improves the
curves of a `stack` of tasks step by step, each by a `program` over `families` of rows, which look at the
`motion` in its `chart`, and which its `dual` solves. `holding` tells which rows are `binding` at the end,
`refit` follows the curve while its `inputs` change.
"""
