"""A covariance that gathers its changes: of a large one, many small products cost more than one large product.

Each sighting takes a product of two rows from the covariance, and lets positions turn with headings. Done at once, that reads and
writes the whole matrix for each sighting. So both wait: the covariance is S (M - W^T W) S^T with the matrix M as it was, the rows W
and the shear S. What is asked for meanwhile is computed for the states that are asked for. The sums are the same, in another order,
and when they are taken depends on the changes and on `matrix` alone: so equal steps give equal bits.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from blackboard.opinion.grid import Array

Index = npt.NDArray[np.intp]

CANCELLED = 1e-8  # of a variance: a change that leaves less is refused, because rounding could make it negative
LARGE = 200  # states from which on changes wait; 100 and 400 cost 24 robots as much, within 4 %
MOST = 64  # rows that wait; 32 and 128 cost 48 robots as much, within 4 %


class Covariance:
    """Mutable: a matrix, shape (n, n), symmetric to the bit."""

    def __init__(self, matrix: Array) -> None:
        self._matrix = matrix
        self._forget()

    def _forget(self) -> None:
        """Nothing waits any more."""
        self._rows: Array = np.zeros((0, len(self._matrix)))  # W
        self._variances: Array | None = None  # of M - W^T W, if rows wait
        self._lean: Array | None = None  # S: times how much of another state is added to each one, if any is
        self._on: Index = np.arange(len(self._matrix))  # which other state that is
        self._diagonal: Array | None = None  # where it was asked for since the last change
        self._waits = False

    # --- what is asked for ------------------------------------------------------------------------------------------------

    @property
    def matrix(self) -> Array:
        """The whole, with all that waited; it may be changed in place."""
        if self._waits:
            self.gather()
        return self._matrix

    def gather(self) -> None:
        """Apply all that waits."""
        if self._waits:
            if len(self._rows):
                self._matrix -= self._rows.T @ self._rows
            if self._lean is not None:
                to = np.flatnonzero(self._lean)
                _shear(self._matrix, to, self._on[to], self._lean[to])
            self._forget()

    def block(self, place: slice) -> Array:
        """The covariance of the states of a whole block, shape (n, n)."""
        if self._waits:
            return self.among(np.arange(place.start, place.stop))
        return self._matrix[place, place].copy()

    def among(self, index: Index) -> Array:
        """The covariance of the states of some whole blocks, by their indices, shape (n,): shape (n, n); or of k such sets, (k, n)."""
        part: Array = self._matrix[index[..., np.newaxis], index[..., np.newaxis, :]]
        if not self._waits:
            return part
        rows = np.moveaxis(self._rows[:, index], 0, -1)
        part -= rows @ rows.swapaxes(-1, -2)
        shear = self._local(index)
        part = shear @ part @ shear.swapaxes(-1, -2)
        return np.asarray(0.5 * (part + part.swapaxes(-1, -2)))

    def rows(self, blocks: Sequence[tuple[slice, Array]]) -> Array:
        """H P, shape (m, n), by the blocks where H, shape (m, n), is not zero, and what it is there."""
        product: Array = np.zeros((len(blocks[0][1]), len(self._matrix)))
        if not self._waits:
            for place, part in blocks:
                product += part @ self._matrix[place]
            return product
        index = [np.arange(place.start, place.stop) for place, _ in blocks]
        there = np.hstack([part @ self._local(states) for (_, part), states in zip(blocks, index, strict=True)])
        states = np.concatenate(index)
        product = there @ self._matrix[states] - (there @ self._rows[:, states].T) @ self._rows
        return product if self._lean is None else product + product[:, self._on] * self._lean

    def diagonal(self) -> Array:
        """The variances, shape (n,)."""
        plain = self._matrix.diagonal() if self._variances is None else self._variances
        if self._lean is None:
            return plain
        if self._diagonal is None:
            to = np.flatnonzero(self._lean)
            by, lean = self._on[to], self._lean[to]
            ties = self._matrix[to, by] - (self._rows[:, to] * self._rows[:, by]).sum(axis=0)
            self._diagonal = plain.copy()
            self._diagonal[to] += lean * (2 * ties + lean * plain[by])
        return self._diagonal

    def _local(self, index: Index) -> Array:
        """S of the states of some whole blocks, by their indices, as in `among`."""
        shear = np.zeros((*index.shape, index.shape[-1]))
        shear[..., np.arange(index.shape[-1]), np.arange(index.shape[-1])] = 1.0
        if self._lean is not None:
            to = np.nonzero(self._lean[index])
            states = index[to]
            shear[(*to, to[-1] + self._on[states] - states)] = self._lean[states]
        return shear

    # --- changes ----------------------------------------------------------------------------------------------------------

    def subtract(self, rows: Array) -> bool:
        """Take R^T R away, by the rows R, shape (m, n); False: that would cancel a variance, and nothing is changed."""
        if len(self._rows) + len(rows) > MOST:
            before = self.matrix.diagonal()
        else:
            before = self._matrix.diagonal() if self._variances is None else self._variances
        if self._lean is not None:
            rows = rows - rows[:, self._on] * self._lean  # R S^-T
        left = before - np.square(rows).sum(axis=0)
        if (left < CANCELLED * before).any():
            return False
        if len(self._matrix) < LARGE:
            self._matrix -= rows.T @ rows  # of which NumPy computes one triangle
        else:
            self._rows, self._variances, self._diagonal = np.concatenate([self._rows, rows]), left, None
            self._waits = True
        return True

    def shear(self, to: Index, by: Index, factors: Array) -> None:
        """Add `factors` times the states `by` to the states `to`, shape (k,) each; none is in both.

        A state leans on one other state of its block, always the same.
        """
        if len(self._matrix) < LARGE:
            _shear(self._matrix, to, by, factors)
            return
        lean = np.zeros(len(self._matrix)) if self._lean is None else self._lean
        lean[to] += factors
        self._on[to] = by
        self._lean, self._diagonal, self._waits = lean, None, True


def _shear(matrix: Array, to: Index, by: Index, factors: Array) -> None:
    """`Covariance.shear` of a matrix, in place."""
    added = factors[:, np.newaxis] * matrix[by, :]
    half = added[:, to] + 0.5 * added[:, by] * factors
    rows = matrix[to, :] + added
    rows[:, to] = matrix[to[:, np.newaxis], to] + (half + half.T)
    matrix[to, :] = rows
    matrix[:, to] = rows.T
