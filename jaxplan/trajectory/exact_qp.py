"""Small dense quadratic programs with linear inequalities, which tell exactly which rows bind.

They are solved by nonnegative least squares (`least_change`). Forms that are not convex are first made
convex, without a change where rows bind. `downward_way` leads away from a saddle. In shapes, n counts the
unknowns and r the rows, which are the inequalities.
"""

from contextlib import suppress

import numpy as np

# Weights of the squares of binding rows, relative to the Hessian; tried in turn until it is positive.
_SQUARE_WEIGHTS = tuple(10.0**power for power in range(-2, 7))
_RANK_TOLERANCE = 1e-9  # of the largest singular value of rows; directions with smaller ones count as free
_CURVATURE_TOLERANCE = 1e-10  # of the mean curvature of a Hessian; smaller negative curvature counts as none
_MAX_TRIALS = 8  # most guesses of which rows bind
_ROW_TOLERANCE = 1e-10  # in a row's unit; rounding may break it by as much
_MIN_EIGENVALUE_RATIO = 1e-6  # of the largest eigenvalue, least size to which others are raised


def least_change(
    hessian: np.ndarray,
    gradient: np.ndarray,
    slopes: np.ndarray,
    excess: np.ndarray,
    binding: np.ndarray,
    *,
    downwards: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise ``d^T H d / 2 + g^T d`` subject to ``G d + e <= 0``, exactly.

    With ``H = L L^T`` and ``u = L^T d + L^-1 g`` the task is to find the least ``|u|`` within half-spaces,
    which nonnegative least squares do (Lawson and Hanson, chapter 23).

    Args:
        hessian: (n, n) ``H``, symmetric. If it is not positive definite it is made so: by adding squares of
            rows that are assumed to bind, or of the directions that these fix, which changes nothing where
            they do, or else from the sizes of its eigenvalues. Where it is positive along all that the rows
            found to bind leave free, the result is that of the given ``H``.
        gradient: (n,) ``g``.
        slopes: (r, n) ``G``.
        excess: (r,) ``e``, the rows' values at ``d = 0``, positive where a row is broken.
        binding: (r,) bool, which rows are assumed to bind.
        downwards: whether negative curvature along what the binding rows leave free has only its sign
            changed, so that a change moves away from a maximum along it, about doubling its distance each
            time.

    Returns:
        The change ``d`` (n,) and the multipliers of the rows (r,); none of the rows with a positive one
        follows from the others. If no change satisfies all rows, or the iteration fails, the change ignores
        the rows and the multipliers are zero.
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    convex = _cholesky(hessian)
    factor, pull = convex, gradient
    if factor is None:
        form = _flip_negative_curvature(hessian, slopes[binding]) if downwards else hessian
        factor, pull = _convex_factor(form, gradient, slopes[binding], excess[binding])
    normals = solve_triangular(factor, slopes.T, lower=True)
    down = solve_triangular(factor, pull, lower=True)
    depth = excess - normals.T @ down
    size = max(1.0, float(np.linalg.norm(down)))
    pushes = np.zeros(len(excess))
    if len(excess):  # nnls crashes on none
        with suppress(RuntimeError):  # raised after too many iterations
            found, _ = nnls(np.vstack([-normals, depth / size]), np.eye(len(down) + 1)[-1])
            left = 1 - depth / size @ found  # zero where no change satisfies all rows
            pushes = size * found / left if left > np.finfo(float).eps else pushes
    change = solve_triangular(factor, -normals @ pushes - down, lower=True, trans=1)
    exact = _solve_active_set(hessian, gradient, slopes, excess, pushes > 0) if convex is None else None
    return exact or (change, pushes)


def _solve_active_set(
    hessian: np.ndarray, gradient: np.ndarray, slopes: np.ndarray, excess: np.ndarray, binding: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Compute what `least_change` returns for a form as it is, starting from a guess of the rows that bind.

    Where the form curves upwards along all that the binding rows leave free, its minimum there is found,
    however it curves elsewhere. Rows that this breaks bind in the next trial; rows whose multiplier is not
    positive do not.

    Returns:
        The change (n,) and multipliers (r,); None where the form curves downwards, rows follow from others,
        or no trial confirms its own rows.
    """
    from scipy.linalg import cho_factor, cho_solve, qr, solve_triangular

    for _ in range(_MAX_TRIALS):
        rows, size = slopes[binding], int(np.sum(binding))
        both, corner = qr(rows.T)
        fixed, free, corner = both[:, :size], both[:, size:], corner[:size]
        pivots = np.abs(np.diag(corner))
        if size > len(hessian) or np.any(pivots <= _RANK_TOLERANCE * np.max(np.abs(corner), initial=0.0)):
            return None
        change = fixed @ solve_triangular(corner, -excess[binding], trans=1)
        try:
            curved = cho_factor(free.T @ hessian @ free)
        except np.linalg.LinAlgError:
            return None
        change = change - free @ cho_solve(curved, free.T @ (gradient + hessian @ change))
        pushes = np.zeros(len(excess))
        pushes[binding] = solve_triangular(corner, -fixed.T @ (gradient + hessian @ change))
        wanted = (pushes > 0) | ~binding & (slopes @ change + excess > _ROW_TOLERANCE)
        if np.array_equal(wanted, binding):
            return change, pushes
        binding = wanted
    return None


def downward_way(hessian: np.ndarray, slopes: np.ndarray) -> np.ndarray | None:
    """Find where a quadratic form curves downwards most among directions that leave some rows as they are.

    At a saddle it leads away from it.

    Args:
        hessian: (n, n) of the form.
        slopes: (r, n) gradients of the rows, to which the direction is perpendicular.

    Returns:
        A unit vector (n,), of either sign; None where the form curves upwards along all that the rows leave
        free.
    """
    from scipy.linalg import eigh, null_space

    if _cholesky(hessian) is not None:
        return None
    ways = null_space(slopes, rcond=_RANK_TOLERANCE) if len(slopes) else np.eye(len(hessian))
    if not ways.size:
        return None
    (bend,), way = eigh(ways.T @ hessian @ ways, subset_by_index=(0, 0))
    return ways @ way[:, 0] if bend < -_CURVATURE_TOLERANCE * np.trace(hessian) / len(hessian) else None


def _cholesky(hessian: np.ndarray) -> np.ndarray | None:
    """Lower Cholesky factor of a Hessian; None where it is not positive definite."""
    with suppress(np.linalg.LinAlgError):
        return np.linalg.cholesky(hessian)
    return None


def _flip_negative_curvature(hessian: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Change the sign of a Hessian's negative curvatures along directions in which no row changes.

    `slopes` (r, n) are the derivatives of the r rows in the n unknowns.
    """
    _, sizes, right = np.linalg.svd(slopes)
    free = right[int(np.sum(sizes > _RANK_TOLERANCE * np.max(sizes, initial=0.0))) :].T
    bends, ways = np.linalg.eigh(free.T @ hessian @ free)
    least = _RANK_TOLERANCE * np.max(np.abs(bends), initial=0.0)
    ways = free @ ways
    more = np.where(bends > 0, 0.0, np.maximum(-bends, least) - bends)
    return np.asarray(hessian + (ways * more) @ ways.T)


def _convex_factor(
    hessian: np.ndarray, gradient: np.ndarray, slopes: np.ndarray, excess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lower Cholesky factor of a Hessian made positive definite, and the gradient that goes with it.

    Arguments are those of `least_change`; `slopes` and `excess` are of the rows assumed to bind alone.
    """
    squares = slopes.T @ slopes
    unit = np.trace(hessian) / (np.trace(squares) or 1.0)
    for weight in unit * np.array([0.0, *_SQUARE_WEIGHTS]):
        with suppress(np.linalg.LinAlgError):
            return np.linalg.cholesky(hessian + weight * squares), gradient + weight * slopes.T @ excess
    # Where many rows nearly follow from others their squares are tiny along some directions. A weight that is
    # the same along all directions that they fix changes the minimum as little.
    left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
    kept = sizes > _RANK_TOLERANCE * np.max(sizes, initial=0.0)
    fixed = right[kept].T
    pull = fixed @ (left[:, kept].T @ excess / sizes[kept])
    unit = np.trace(hessian) / len(hessian)
    for weight in unit * np.array(_SQUARE_WEIGHTS):
        with suppress(np.linalg.LinAlgError):
            return np.linalg.cholesky(hessian + weight * fixed @ fixed.T), gradient + weight * pull
    sizes, vectors = np.linalg.eigh(hessian)
    sizes = np.abs(sizes).clip(_MIN_EIGENVALUE_RATIO * np.max(np.abs(sizes)))
    return np.linalg.cholesky((vectors * sizes) @ vectors.T), gradient
