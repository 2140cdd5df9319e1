"""A joint Gaussian belief over named blocks, in one mean and one covariance: what a Kalman filter keeps.

A block is any hashable name with a few states. Every operation is linear algebra on the blocks it names; what the states
mean is the callers' (`vehicle`, `relation`). Units are the callers' too.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.grid import Array

Block = Hashable

FARTHEST = 1e12  # of squared distances: no test asks whether something is farther


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean, shape (n,), and covariance, shape (n, n), of a Gaussian."""

    mean: Array
    covariance: Array


def squared_distance(apart: Array, covariance: Array) -> float:
    """The squared Mahalanobis distance of a difference, shape (m,), by its covariance, shape (m, m): 0 to `FARTHEST`.

    A difference that is claimed to have no error, so that the covariance is singular, is as far as can be.
    """
    try:
        squared = float(apart @ np.linalg.solve(covariance, apart))
    except (ArithmeticError, np.linalg.LinAlgError):
        squared = FARTHEST if apart.any() else 0.0
    return max(0.0, squared) if squared < FARTHEST else FARTHEST


@dataclass(frozen=True, eq=False)
class Innovation:
    """What a measurement says beyond what was expected: the residual z - h(x), shape (m,), and its covariance."""

    residual: Array
    covariance: Array

    @property
    def squared(self) -> float:
        """The squared Mahalanobis distance, chi-squared with m degrees of freedom where all models hold."""
        return squared_distance(self.residual, self.covariance)


class Joint:
    """Mutable: blocks come and go, and keep their order of arrival. KeyError where a block is not there."""

    def __init__(self) -> None:
        self.blocks: dict[Block, slice] = {}
        self.mean: Array = np.zeros(0)
        self.covariance: Array = np.zeros((0, 0))

    def __contains__(self, block: Block) -> bool:
        return block in self.blocks

    def copy(self) -> Joint:
        """The same belief, which may be changed without changing this one."""
        other = Joint()
        other.blocks, other.mean, other.covariance = dict(self.blocks), self.mean.copy(), self.covariance.copy()
        return other

    def moments(self, *blocks: Block) -> Moments:
        """The marginal of some blocks, in the order given."""
        if len(blocks) == 1:
            at = self.blocks[blocks[0]]
            return Moments(self.mean[at].copy(), self.covariance[at, at].copy())
        index = self._index(blocks)
        return Moments(self.mean[index], self.covariance[np.ix_(index, index)])

    # --- blocks ---------------------------------------------------------------------------------------------------------

    def add(self, block: Block, moments: Moments) -> None:
        """A new block that is independent of all others."""
        n, m = len(self.mean), len(moments.mean)
        if block in self.blocks:
            raise ValueError(f"{block!r} is in the joint already")
        covariance = np.zeros((n + m, n + m))
        covariance[:n, :n], covariance[n:, n:] = self.covariance, moments.covariance
        self.mean, self.covariance = np.concatenate([self.mean, moments.mean]), covariance
        self.blocks[block] = slice(n, n + m)

    def drop(self, block: Block) -> None:
        """Remove a block (marginalise it out): the other blocks keep their means and covariances."""
        gone = self.blocks.pop(block)
        keep = np.r_[0 : gone.start, gone.stop : len(self.mean)]
        self.mean, self.covariance = self.mean[keep], self.covariance[np.ix_(keep, keep)]
        width = gone.stop - gone.start
        for name, place in self.blocks.items():
            if place.start > gone.start:
                self.blocks[name] = slice(place.start - width, place.stop - width)

    # --- time -----------------------------------------------------------------------------------------------------------

    def move(self, block: Block, mean: Array, transition: Array, noise: Array) -> None:
        """A block goes to a new mean; `transition` is the derivative of new by old, `noise` the covariance that is added."""
        at = self.blocks[block]
        self.mean[at] = mean
        self.covariance[at, :] = transition @ self.covariance[at, :]
        self.covariance[:, at] = self.covariance[:, at] @ transition.T
        self.covariance[at, at] += noise

    def decay(self, keep: Mapping[Block, float], variance: float = 1.0) -> None:
        """Blocks of mean zero forget: the share `keep` of each stays, and noise brings back the stationary `variance`."""
        factor = np.ones(len(self.mean))
        for block, share in keep.items():
            factor[self.blocks[block]] = share
        self.mean *= factor
        self.covariance *= np.outer(factor, factor)
        self.covariance[np.diag_indices_from(self.covariance)] += (1 - factor**2) * variance

    # --- evidence -------------------------------------------------------------------------------------------------------

    def innovation(self, residual: Array, jacobians: Mapping[Block, Array], noise: Array) -> Innovation:
        """A measurement's residual with its covariance; `jacobians` are the derivatives of what is expected, by block."""
        row = self._row(jacobians, len(residual))
        return Innovation(residual, row @ self.covariance @ row.T + noise)

    def innovation_of(self, measurements: Sequence[tuple[Array, Mapping[Block, Array], Array]]) -> tuple[float, int]:
        """The squared Mahalanobis distance of several measurements together, and its degrees of freedom."""
        row = np.concatenate([self._row(jacobians, len(residual)) for residual, jacobians, _ in measurements])
        covariance = row @ self.covariance @ row.T
        first = 0
        for residual, _, noise in measurements:
            place = slice(first, first + len(residual))
            covariance[place, place] += noise
            first = place.stop
        residual = np.concatenate([residual for residual, _, _ in measurements])
        return Innovation(residual, covariance).squared, len(residual)

    def update(self, residual: Array, jacobians: Mapping[Block, Array], noise: Array) -> None:
        """Kalman's update (Joseph's form, so that the covariance stays positive)."""
        row = self._row(jacobians, len(residual))
        cross = self.covariance @ row.T
        gain = np.linalg.solve(row @ cross + noise, cross.T).T
        self.mean = self.mean + gain @ residual
        left = gain @ cross.T
        covariance = self.covariance - left  # P - left - left^T + K S K^T, in place: a team's covariance is large
        covariance -= left.T
        covariance += np.matmul(gain @ (row @ cross + noise), gain.T, out=left)
        self.covariance = covariance + covariance.T
        self.covariance *= 0.5

    # --- inside ---------------------------------------------------------------------------------------------------------

    def _index(self, blocks: Iterable[Block]) -> Array:
        return np.concatenate([np.arange(self.blocks[b].start, self.blocks[b].stop) for b in blocks])

    def _row(self, jacobians: Mapping[Block, Array], rows: int) -> Array:
        whole = np.zeros((rows, len(self.mean)))
        for block, part in jacobians.items():
            whole[:, self.blocks[block]] += part
        return whole
