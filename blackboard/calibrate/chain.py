"""Least squares over a chain of ticks with some numbers that all ticks share: the normal equations and their inverse, numpy alone.

The unknowns of a tick are tied to those of the tick before and to the shared ones. So the matrix is block-tridiagonal with a
border, and everything takes a time in proportion to the ticks. The inverse is made only where the matrix is not zero.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from blackboard.opinion.grid import Array


@dataclass(frozen=True, eq=False)
class Factors:
    """Many measurements of one shape: m numbers each, which depend on some poses and on the shared numbers of some robots.

    `poses` and `shared` hold (tick, robot, derivative) and (robot, derivative), one row for each measurement.
    """

    residual: Array  # (M, m): measured minus expected
    weight: Array  # (M, m): one over the variance
    poses: list[tuple[Array, Array, Array]]  # ticks (M,), robots (M,), (M, m, 3): derivatives of what is expected
    shared: list[tuple[Array, Array]]  # robots (M,), (M, m, p)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of K ticks of n unknowns each, and of s shared ones: matrix and right side."""

    diagonal: Array  # (K, n, n)
    before: Array  # (K, n, n): row of a tick, column of the tick before; the first is not used
    border: Array  # (K, n, s)
    corner: Array  # (s, s)
    right: Array  # (K, n)
    shared_right: Array  # (s,)

    @staticmethod
    def of(ticks: int, robots: int, each: int) -> "NormalEquations":
        """Empty equations of robots with a pose and `each` shared numbers."""
        n, s = 3 * robots, each * robots
        blocks = np.zeros((ticks, n, n))
        return NormalEquations(
            blocks, blocks.copy(), np.zeros((ticks, n, s)), np.zeros((s, s)), np.zeros((ticks, n)), np.zeros(s)
        )

    def add(self, factors: Factors) -> None:
        weighted = factors.residual * factors.weight
        three = np.arange(3)
        for tick, robot, by in factors.poses:
            rows = 3 * robot[:, None] + three
            np.add.at(self.right, (tick[:, None], rows), np.einsum("mij,mi->mj", by, weighted))
            for other, mate, also in factors.poses:
                block = np.einsum("mia,mi,mib->mab", by, factors.weight, also)
                columns = 3 * mate[:, None] + three
                for apart, into in ((0, self.diagonal), (1, self.before)):
                    some = tick - other == apart
                    place = (tick[some, None, None], rows[some][:, :, None], columns[some][:, None, :])
                    np.add.at(into, place, block[some])
            for owner, shared in factors.shared:
                columns = shared.shape[2] * owner[:, None] + np.arange(shared.shape[2])
                block = np.einsum("mia,mi,mib->mab", by, factors.weight, shared)
                np.add.at(self.border, (tick[:, None, None], rows[:, :, None], columns[:, None, :]), block)
        for owner, shared in factors.shared:
            rows = shared.shape[2] * owner[:, None] + np.arange(shared.shape[2])
            np.add.at(self.shared_right, rows, np.einsum("mij,mi->mj", shared, weighted))
            for mate, also in factors.shared:
                columns = also.shape[2] * mate[:, None] + np.arange(also.shape[2])
                block = np.einsum("mia,mi,mib->mab", shared, factors.weight, also)
                np.add.at(self.corner, (rows[:, :, None], columns[:, None, :]), block)

    def solved(self) -> "Solved":
        """The solution; numpy.linalg.LinAlgError: something is not determined."""
        ticks, n, s = self.border.shape
        left, inverse, gain = (np.empty_like(self.diagonal) for _ in range(3))
        sides = np.concatenate([self.right[:, :, None], self.border], axis=2)
        for k in range(ticks):
            left[k] = self.diagonal[k]
            if k:
                gain[k] = self.before[k] @ inverse[k - 1]
                left[k] -= gain[k] @ self.before[k].T
                sides[k] -= gain[k] @ sides[k - 1]
            inverse[k] = np.linalg.inv(left[k])
        for k in range(ticks - 1, -1, -1):
            sides[k] = inverse[k] @ (sides[k] if k == ticks - 1 else sides[k] - self.before[k + 1].T @ sides[k + 1])
        alone, by = sides[:, :, 0], sides[:, :, 1:]
        flat = by.reshape(ticks * n, s)
        schur = self.corner - self.border.reshape(ticks * n, s).T @ flat
        covariance = np.linalg.inv(schur) if s else schur
        shared = covariance @ (self.shared_right - self.border.reshape(ticks * n, s).T @ alone.ravel())
        log_determinant = float(np.linalg.slogdet(left)[1].sum() + (np.linalg.slogdet(schur)[1] if s else 0.0))
        return Solved(alone - by @ shared, shared, covariance, log_determinant, by, inverse, gain)


@dataclass(frozen=True, eq=False)
class Solved:
    """The solution of a chain, and its covariance."""

    poses: Array  # (K, n)
    shared: Array  # (s,)
    covariance: Array  # (s, s): of the shared numbers
    log_determinant: float  # of the matrix
    by: Array  # (K, n, s): minus the derivative of the poses by the shared numbers
    _inverse: Array
    _gain: Array

    @cached_property
    def _own(self) -> tuple[Array, Array]:
        """Covariances of each tick, shape (K, n, n), and of each tick with the one before it."""
        own, before = np.empty_like(self._inverse), np.zeros_like(self._inverse)
        for k in range(len(own) - 1, -1, -1):
            own[k] = self._inverse[k]
            if k + 1 < len(own):
                before[k + 1] = -own[k + 1] @ self._gain[k + 1]
                own[k] -= self._gain[k + 1].T @ before[k + 1]
        spread = self.by @ self.covariance
        own = own + np.einsum("kis,kjs->kij", spread, self.by)
        before[1:] += np.einsum("kis,kjs->kij", spread[1:], self.by[:-1])
        return own, before

    def variances(self, factors: Factors) -> Array:
        """The variances, shape (M, m), of what measurements expect, by everything that was measured."""
        own, before = self._own
        three, total = np.arange(3), np.zeros_like(factors.residual)
        spread = -self.by @ self.covariance
        for tick, robot, by in factors.poses:
            rows = 3 * robot[:, None] + three
            for other, mate, also in factors.poses:
                columns = 3 * mate[:, None] + three
                where = (rows[:, :, None], columns[:, None, :])
                later = np.maximum(tick, other)[:, None, None]
                back = before[(later, columns[:, None, :], rows[:, :, None])]
                ahead = before[(later, *where)]
                tied = np.where((tick > other)[:, None, None], ahead, back)
                block = np.where((tick == other)[:, None, None], own[(tick[:, None, None], *where)], tied)
                total += np.einsum("mia,mab,mib->mi", by, block, also)
            for owner, shared in factors.shared:
                columns = shared.shape[2] * owner[:, None] + np.arange(shared.shape[2])
                block = spread[tick[:, None, None], rows[:, :, None], columns[:, None, :]]
                total += 2 * np.einsum("mia,mab,mib->mi", by, block, shared)
        for owner, shared in factors.shared:
            for mate, also in factors.shared:
                rows = shared.shape[2] * owner[:, None] + np.arange(shared.shape[2])
                columns = also.shape[2] * mate[:, None] + np.arange(also.shape[2])
                block = self.covariance[rows[:, :, None], columns[:, None, :]]
                total += np.einsum("mia,mab,mib->mi", shared, block, also)
        return np.maximum(total, 0.0)

    def profile(self, factors: Factors) -> Array:
        """The derivative of what measurements expect by the shared numbers, shape (M, m, s), the poses following them."""
        total = np.zeros((*factors.residual.shape, len(self.shared)))
        for tick, robot, by in factors.poses:
            rows = 3 * robot[:, None] + np.arange(3)
            total -= np.einsum("mia,mas->mis", by, self.by[tick[:, None], rows])
        for owner, shared in factors.shared:
            for number in range(shared.shape[2]):
                np.add.at(
                    total.transpose(0, 2, 1),
                    (np.arange(len(total)), shared.shape[2] * owner + number),
                    shared[:, :, number],
                )
        return total
