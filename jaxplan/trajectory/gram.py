"""The matrix ``M = G H^-1 G^T`` of a program's rows, and the solution of systems ``(M + D) y = r``.

``D`` is a positive diagonal. Programs of `step_programs` have r rows ``G`` on the k free coefficients of each
of A axes and on the relative change of the duration, and the same Hessian ``H`` (k, k) for every axis. A
row's slopes are a sum of P products of an array (r, P, A) of the axes and one (r, P, k) of the basis
(`constraints`). Where few rows are near their bounds, the matrix is formed and factored as it is
(`DenseGram`). The platform's limits may bind at most of its places, which gives many more rows than the
platform has unknowns; then (`PlatformGram`) the system is solved for those unknowns ``u`` instead:

    (H + G^T D^-1 G) u = G^T D^-1 r        y = D^-1 (r - G u)

Each row touches the few coefficients about its place, so that most of ``G^T D^-1 G`` is zero. Rows that touch
joints, mostly a few dozen, are kept as rows beside that system: for them a matrix ``E``, of what they share
through the joints, takes the place of D.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

PLATFORM = 3  # axes; the others are the joints'

_MIN_ROWS_FOR_BLOCK_SOLVE = 190  # rows; the matrix of fewer is formed and factored as it is
_MIN_ROWS_PER_UNKNOWN = 1.3  # rows of the platform for each of its unknowns; with more, these are solved for
_REFINEMENT_THRESHOLD = 1e-10  # of added diagonals (the matrix's own is 1): below it solutions are refined
_MIN_DIAGONAL = 1e-12  # least number of an added diagonal that is divided by
_CHUNK_ROWS = 64  # rows of the platform whose squares are summed at once

Solve = Callable[[np.ndarray], np.ndarray]


class Gram(Protocol):
    """Protocol of a program's matrix ``M``, (r, r) for r rows, which is positive semidefinite.

    Its diagonal is positive.
    """

    def diagonal(self) -> np.ndarray:
        """Return its diagonal (r,)."""

    def scaled(self, scale: np.ndarray) -> "Gram":
        """Return the matrix with rows and columns multiplied by positive numbers (r,), in the same form."""

    def is_finite(self) -> bool:
        """Return whether all numbers are finite."""

    def times(self, y: np.ndarray) -> np.ndarray:
        """Return its product (r,) with ``y`` (r,)."""

    def factored(self, diagonal: np.ndarray) -> Solve | None:
        """Return a function that solves systems of the matrix plus a positive diagonal (r,).

        The function takes a right-hand side (r,) to the solution (r,). None if the factorisation fails.
        """


@dataclass(frozen=True, eq=False)
class DenseGram:
    """A program's matrix (r, r), stored as it is.

    Attributes:
        matrix: (r, r) symmetric.
    """

    matrix: np.ndarray

    def diagonal(self) -> np.ndarray:
        """See `Gram`."""
        return self.matrix.diagonal()

    def scaled(self, scale: np.ndarray) -> "DenseGram":
        """See `Gram`."""
        matrix = self.matrix * scale
        matrix *= scale[:, None]
        return DenseGram(matrix)

    def is_finite(self) -> bool:
        """See `Gram`."""
        return bool(np.isfinite(self.matrix).all())

    def times(self, y: np.ndarray) -> np.ndarray:
        """See `Gram`."""
        return np.asarray(self.matrix @ y)

    def factored(self, diagonal: np.ndarray) -> Solve | None:
        """See `Gram`."""
        from scipy.linalg.lapack import dpotrf, dpotrs

        factor, failed = dpotrf(
            _add_diagonal(self.matrix, diagonal).T, lower=True, overwrite_a=True, clean=False
        )
        if failed:
            return None

        def solve(right: np.ndarray) -> np.ndarray:
            found: np.ndarray = dpotrs(factor, right, lower=True)[0]
            return found

        return solve


class _Chunk(NamedTuple):
    """Some c rows of the platform at places close to each other.

    Attributes:
        rows: slice of the rows among all rows of the platform.
        columns: slice of the w unknowns that they touch.
        slopes: (c, w) derivatives of the rows in these unknowns.
    """

    rows: slice
    columns: slice
    slopes: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatformGram:
    """The matrix of p rows of the platform alone, sorted by place, followed by q rows that touch joints.

    The n = 3 k + 1 unknowns are the platform's 3 k coefficients, the three axes of one coefficient side by
    side, and last the relative change of the duration. The last z of the q rows touch the platform, too.

    Attributes:
        slopes: (p, n) derivatives of the first p rows in the unknowns.
        time: (q,) derivatives of the other rows in the relative change of the duration.
        coupled: (z, 3 k) derivatives of the last z rows in the platform's coefficients.
        joint: (q, q) part of the matrix that the q rows share through the joints.
        hessian: (n, n) of the unknowns.
        inverse: (k, k) inverse Hessian of one axis.
        chunks: the first p rows again in parts, without the duration.
    """

    slopes: np.ndarray
    time: np.ndarray
    coupled: np.ndarray
    joint: np.ndarray
    hessian: np.ndarray
    inverse: np.ndarray
    chunks: list[_Chunk]

    @property
    def _coupled_rows(self) -> slice:
        """Slice of the rows, among the q, that touch the platform."""
        return slice(len(self.joint) - len(self.coupled), len(self.joint))

    def diagonal(self) -> np.ndarray:
        """See `Gram`."""
        time = np.concatenate([self.slopes[:, -1], self.time])
        found = time**2 / self.hessian[-1, -1]
        first, other = found[: len(self.slopes)], found[len(self.slopes) :]
        first += _gram_diagonal(self.slopes[:, :-1], self.inverse)
        other += self.joint.diagonal()
        other[self._coupled_rows] += _gram_diagonal(self.coupled, self.inverse)
        return found

    def scaled(self, scale: np.ndarray) -> "PlatformGram":
        """See `Gram`."""
        first, other = np.split(scale, [len(self.slopes)])
        return replace(
            self,
            slopes=self.slopes * first[:, None],
            time=self.time * other,
            coupled=self.coupled * other[self._coupled_rows, None],
            joint=self.joint * other[:, None] * other,
            chunks=[own._replace(slopes=own.slopes * first[own.rows, None]) for own in self.chunks],
        )

    def is_finite(self) -> bool:
        """See `Gram`."""
        parts = self.slopes, self.time, self.coupled, self.joint, self.hessian, self.inverse
        return all(bool(np.isfinite(part).all()) for part in parts)

    def times(self, y: np.ndarray) -> np.ndarray:
        """See `Gram`."""
        count, joined = len(self.slopes), self._coupled_rows
        first, other = y[:count], y[count:]
        pull = first @ self.slopes
        pull[:-1] += other[joined] @ self.coupled
        change = np.empty_like(pull)
        np.dot(self.inverse, pull[:-1].reshape(-1, PLATFORM), out=change[:-1].reshape(-1, PLATFORM))
        change[-1] = (pull[-1] + self.time @ other) / self.hessian[-1, -1]
        found = np.empty_like(y)
        np.dot(self.slopes, change, out=found[:count])
        rest = found[count:]
        np.dot(self.joint, other, out=rest)
        rest += change[-1] * self.time
        rest[joined] += self.coupled @ change[:-1]
        return found

    def factored(self, diagonal: np.ndarray) -> Solve | None:
        """See `Gram`."""
        from scipy.linalg.lapack import dpotrf, dtrtrs

        count = len(self.slopes)
        weight = 1 / np.maximum(diagonal[:count], _MIN_DIAGONAL)
        root = np.sqrt(weight)[:, None]
        whole = self.hessian.copy()
        for rows, columns, slopes in self.chunks:
            part = slopes * root[rows]
            whole[columns, columns] += part.T @ part
        whole[-1] += (weight * self.slopes[:, -1]) @ self.slopes
        own, time, coupled = self.joint, self.time, self.coupled
        if len(own):
            own, failed = dpotrf(
                _add_diagonal(own, diagonal[count:]).T, lower=True, overwrite_a=True, clean=False
            )
            if failed:
                return None
            time, _ = dtrtrs(own, time, lower=True)
            whole[-1, -1] += time @ time
        if len(coupled):
            joined = self._coupled_rows
            coupled, _ = dtrtrs(own[joined, joined], coupled, lower=True)
            whole[:-1, :-1] += coupled.T @ coupled
            whole[-1, :-1] += time[joined] @ coupled
        factor, failed = dpotrf(whole.T, lower=False, overwrite_a=True, clean=False)
        if failed:
            return None
        found = _PlatformFactors(self, diagonal, weight, own, time, coupled, factor)
        return found.solve if diagonal.min() > _REFINEMENT_THRESHOLD else found.refined


class _PlatformFactors(NamedTuple):
    """The factors by which systems of a `PlatformGram` plus a diagonal are solved.

    Attributes:
        gram: the matrix.
        diagonal: (p + q,) that is added.
        weight: (p,) one over the first p numbers of the diagonal.
        own: (q, q) lower Cholesky factor of what the q rows share through joints, plus their diagonal.
        time: (q,) derivatives of these rows in the duration, multiplied by the inverse of `own`.
        coupled: (z, 3 k) those of the last z of them in the platform's coefficients, likewise.
        factor: (n, n) upper Cholesky factor of the matrix of the unknowns.
    """

    gram: PlatformGram
    diagonal: np.ndarray
    weight: np.ndarray
    own: np.ndarray
    time: np.ndarray
    coupled: np.ndarray
    factor: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve for a right-hand side (p + q,); the solution has the same shape."""
        from scipy.linalg.lapack import dpotrs, dtrtrs

        slopes, count, joined = self.gram.slopes, len(self.weight), self.gram._coupled_rows
        found = np.empty_like(right)
        first, other = right[:count], right[count:]
        pull = (self.weight * first) @ slopes
        if len(other):
            other, _ = dtrtrs(self.own, other, lower=True)
            pull[-1] += self.time @ other
            pull[:-1] += other[joined] @ self.coupled
        change, _ = dpotrs(self.factor, pull, lower=False, overwrite_b=True)
        np.multiply(self.weight, first - slopes @ change, out=found[:count])
        if len(other):
            other -= change[-1] * self.time
            other[joined] -= self.coupled @ change[:-1]
            found[count:], _ = dtrtrs(self.own, other, lower=True, trans=1)
        return found

    def refined(self, right: np.ndarray) -> np.ndarray:
        """Solve, and correct the solution (p + q,) once, since a tiny diagonal costs it digits."""
        found = self.solve(right)
        found += self.solve(right - self.gram.times(found) - self.diagonal * found)
        return found


def _gram_diagonal(slopes: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Diagonal (r,) of the matrix of r rows of the platform.

    Args:
        slopes: (r, 3 k) derivatives of the rows in the platform's coefficients, k on each of three axes.
        inverse: (k, k) inverse Hessian of one axis.
    """
    by_axis = slopes.reshape(len(slopes), len(inverse), PLATFORM).swapaxes(1, 2).reshape(-1, len(inverse))
    squares = np.einsum("ri,ri->r", by_axis @ inverse, by_axis)
    return np.asarray(np.sum(squares.reshape(-1, PLATFORM), axis=1))


def _add_diagonal(matrix: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """Return a copy of a square matrix with a diagonal added."""
    found = matrix.copy()
    found.reshape(-1)[:: len(found) + 1] += diagonal
    return found


def gram_of(
    axes: np.ndarray,
    along: np.ndarray,
    time: np.ndarray,
    hessian: np.ndarray,
    inverse: np.ndarray,
    duration_hessian: float,
    count: int,
) -> Gram:
    """Make the matrix of a program's rows, in the form in which it is solved fastest.

    Args:
        axes: (r, P, A) of the rows.
        along: (r, P, k) of the rows, in the free coefficients.
        time: (r,) derivatives in the relative change of the duration; zero where the duration is given.
        hessian: (k, k) of one axis.
        inverse: (k, k) its inverse.
        duration_hessian: second derivative in the relative change of the duration, or any positive number.
        count: number of the first rows for which the platform's unknowns are solved for, from
            `order_by_place`; 0 for none, which gives a `DenseGram`.
    """
    if not count:
        matrix = gram(axes, along, inverse)
        if np.any(time):
            matrix += np.outer(time, time) / duration_hessian
        return DenseGram(matrix)
    platform = _platform_slopes(axes, along)
    size, touching = platform.shape[1], np.any(axes[count:, :, :PLATFORM], axis=(1, 2))
    whole = np.zeros((size + 1, size + 1))
    for axis in range(PLATFORM):
        whole[axis:size:PLATFORM, axis:size:PLATFORM] = hessian
    whole[-1, -1] = duration_hessian
    return PlatformGram(
        slopes=np.column_stack([platform[:count], time[:count]]),
        time=time[count:],
        coupled=platform[len(platform) - np.count_nonzero(touching) :],
        joint=gram(axes[count:, :, PLATFORM:], along[count:], inverse),
        hessian=whole,
        inverse=inverse,
        chunks=_cut_into_chunks(platform[:count]),
    )


def order_by_place(axes: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, int]:
    """Decide in which order rows go into a `PlatformGram`, if that is faster than a `DenseGram`.

    Args:
        axes: (r, P, A) of the rows.
        along: (r, P, k) of the rows, in the free coefficients.

    Returns:
        The numbers (r,) of the rows in that order, and how many of the first ones concern the platform alone;
        that count is 0 where the matrix is to be formed as it is.
    """
    every = np.arange(len(axes))
    if len(axes) < _MIN_ROWS_FOR_BLOCK_SOLVE:
        return every, 0
    joints = np.any(axes[:, :, PLATFORM:], axis=(1, 2))
    count = len(axes) - int(np.count_nonzero(joints))
    if count <= _MIN_ROWS_PER_UNKNOWN * PLATFORM * along.shape[2]:
        return every, 0
    place = np.argmax(along.any(axis=1), axis=1)
    platform = np.any(axes[:, :, :PLATFORM], axis=(1, 2))
    return np.lexsort((place, np.where(joints, 1 + platform, 0))), count


def _platform_slopes(axes: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Derivatives (r, 3 k) of r rows in the platform's coefficients, k on each of three axes.

    The three axes of one coefficient are side by side. Arguments are those of `gram`.
    """
    found = along[:, 0, :, None] * axes[:, 0, None, :PLATFORM]
    for product in range(1, axes.shape[1]):
        found += along[:, product, :, None] * axes[:, product, None, :PLATFORM]
    return found.reshape(len(axes), -1)


def _cut_into_chunks(slopes: np.ndarray) -> list[_Chunk]:
    """Cut rows into parts that touch few unknowns each; rows that touch none are left out.

    `slopes` (p, 3 k) are derivatives of p rows, sorted by place, in the platform's coefficients.
    """
    found = []
    for begin in range(0, len(slopes), _CHUNK_ROWS):
        rows = slice(begin, min(begin + _CHUNK_ROWS, len(slopes)))
        touched = np.flatnonzero(slopes[rows].any(axis=0))
        if not len(touched):
            continue
        columns = slice(int(touched[0]), int(touched[-1]) + 1)
        found.append(_Chunk(rows, columns, slopes[rows, columns].copy()))
    return found


def gram(axes: np.ndarray, along: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Compute the matrix ``G H^-1 G^T`` (r, r) of rows.

    For rows with a single product it is the matrix of their rows of the basis times, element by element, that
    of their rows of the axes. The other rows are mostly of the platform alone, so only the axes that they
    touch are used.

    Args:
        axes: (r, P, A) of the rows.
        along: (r, P, k) of the rows, in the free coefficients.
        inverse: (k, k) inverse of the Hessian of one axis.
    """
    more = np.any(axes[:, 1:], axis=(1, 2)) if axes.shape[1] > 1 else np.zeros(len(axes), dtype=bool)
    several, single = np.flatnonzero(more), np.flatnonzero(~more)
    matrix = np.empty((len(axes), len(axes)))
    first, value = along[single, 0], axes[single, 0]
    weighed = first @ inverse
    matrix[np.ix_(single, single)] = (weighed @ first.T) * (value @ value.T)
    if len(several):
        touched = np.flatnonzero(np.any(axes[several], axis=(0, 1)))
        own = np.swapaxes(axes[several][:, :, touched], 1, 2) @ along[several]  # (r', a, k)
        flat = own.reshape(len(several), -1)
        matrix[np.ix_(several, several)] = times(own, inverse).reshape(flat.shape) @ flat.T
        beside = (value[:, touched, None] * weighed[:, None]).reshape(len(single), flat.shape[1])
        both = flat @ beside.T
        matrix[np.ix_(several, single)], matrix[np.ix_(single, several)] = both, both.T
    return matrix


def times(parts: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Multiply r matrices (r, P, n), of P products each, by one matrix (n, k), in one call to BLAS."""
    return (parts.reshape(-1, parts.shape[2]) @ matrix).reshape(*parts.shape[:2], matrix.shape[1])
