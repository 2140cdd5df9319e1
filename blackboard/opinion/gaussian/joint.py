"""A joint Gaussian belief over named blocks, in one mean and one covariance: what a Kalman filter keeps.

A block is any hashable name with a few states. Every operation is linear algebra on the blocks it names; what the states
mean is the callers' (`vehicle`, `relation`). Units are the callers' too.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from blackboard.opinion.gaussian.covariance import Covariance
from blackboard.opinion.grid import Array

Block = Hashable

FARTHEST = 1e12  # of squared distances: no test asks whether something is farther


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean, shape (n,), and covariance, shape (n, n), of a Gaussian."""

    mean: Array
    covariance: Array

    def of(self, state: int) -> tuple[float, float]:
        """Mean and variance of one state."""
        return float(self.mean[state]), float(self.covariance[state, state])


def squared_distance(apart: Array, covariance: Array) -> float:
    """The squared Mahalanobis distance of a difference, shape (m,), by its covariance, shape (m, m): 0 to `FARTHEST`.

    A difference that is claimed to have no error, so that the covariance is singular, is as far as can be.
    """
    try:
        if len(apart) == 2:  # by hand, because a team asks this for every sighting and every pair
            (dx, dy), ((a, b), (c, d)) = apart.tolist(), covariance.tolist()
            squared = (d * dx * dx - (b + c) * dx * dy + a * dy * dy) / (a * d - b * c)
        else:
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
    def freedom(self) -> int:
        """The degrees of freedom, m."""
        return len(self.residual)

    @property
    def squared(self) -> float:
        """The squared Mahalanobis distance, chi-squared with m degrees of freedom where all models hold."""
        return squared_distance(self.residual, self.covariance)


@dataclass(frozen=True, eq=False)
class Expected:
    """H P, shape (m, n), and H P H^T, shape (m, m), of a measurement of m numbers on n states."""

    cross: Array
    spread: Array

    def innovation(self, factor: Factor) -> Innovation:
        """What the measurement says beyond this."""
        return Innovation(factor.residual, self.spread + factor.noise)

    def of(self, rows: npt.NDArray[np.intp]) -> Expected:
        """What is expected of some rows of the measurement."""
        return Expected(self.cross[rows], self.spread[rows[:, np.newaxis], rows])


@dataclass(frozen=True, eq=False)
class Factor:
    """A measurement, linearised at the mean of a joint belief: residual = sum of jacobian @ (error of the block) + noise.

    `residual` has shape (m,), `noise` (m, m), the derivatives of what is expected, by block, (m, states of the block) each.
    `priors` are of the blocks that come with the measurement, if the joint does not have them. `anchors` are means of blocks that
    are not known at all: such a mean is arbitrary, and the measurement is linearised there. `of_place`: of a
    place alone, without information on a heading.
    """

    residual: Array
    jacobians: Mapping[Block, Array]
    noise: Array
    priors: Mapping[Block, Moments] = field(default_factory=dict)
    anchors: Mapping[Block, Array] = field(default_factory=dict)
    of_place: bool = False

    def widened(self, by: float) -> Factor:
        """The same measurement with its noise times a factor."""
        return Factor(self.residual, self.jacobians, self.noise * by, self.priors, self.anchors, self.of_place)


def together(factors: Sequence[Factor]) -> Factor:
    """Measurements as one, in the order given, with noise that is independent between them."""
    if len(factors) == 1:
        return factors[0]
    residual = np.concatenate([factor.residual for factor in factors])
    noise, jacobians, first = np.zeros((len(residual),) * 2), dict[Block, Array](), 0
    for factor in factors:
        mine = slice(first, first + len(factor.residual))
        noise[mine, mine], first = factor.noise, mine.stop
        for block, part in factor.jacobians.items():
            if block not in jacobians:
                jacobians[block] = np.zeros((len(residual), part.shape[1]))
            jacobians[block][mine] = part
    priors = {block: prior for factor in factors for block, prior in factor.priors.items()}
    return Factor(
        residual, jacobians, noise, priors, {b: mean for factor in factors for b, mean in factor.anchors.items()}
    )


class Joint:
    """Mutable: blocks come and go, and keep their order of arrival. KeyError where a block is not there.

    The covariance is symmetric to the bit, whatever is done to it.
    """

    def __init__(self) -> None:
        self.blocks: dict[Block, slice] = {}
        self.mean: Array = np.zeros(0)
        self._covariance = Covariance(np.zeros((0, 0)))
        self._firsts: dict[int, Array] = {}  # what `firsts` found since the blocks changed last

    @classmethod
    def of(cls, blocks: Mapping[str, Moments]) -> Self:
        """The belief of blocks that are independent of each other."""
        joint, first = cls(), 0
        joint.mean = np.concatenate([np.zeros(0), *(moments.mean for moments in blocks.values())])
        joint.covariance = np.zeros((len(joint.mean),) * 2)
        for block, moments in blocks.items():
            at = joint.blocks[block] = slice(first, first + len(moments.mean))
            joint.covariance[at, at], first = _symmetric(moments.covariance), at.stop
        return joint

    def __contains__(self, block: Block) -> bool:
        return block in self.blocks

    @property
    def covariance(self) -> Array:
        """Of all states, shape (n, n)."""
        return self._covariance.matrix

    @covariance.setter
    def covariance(self, matrix: Array) -> None:
        self._covariance = Covariance(matrix)

    @property
    def variances(self) -> Array:
        """The diagonal of `covariance`, shape (n,), for less."""
        return self._covariance.diagonal()

    def gather(self) -> None:
        """Apply all changes that wait, because much is asked before the next one."""
        self._covariance.gather()

    def copy(self) -> Joint:
        """The same belief, which may be changed without changing this one."""
        other = Joint()
        other.blocks, other.mean, other.covariance = dict(self.blocks), self.mean.copy(), self.covariance.copy()
        other._firsts = dict(self._firsts)
        return other

    def firsts(self, states: int) -> Array:
        """The index of the first state of every block that has so many states, shape (blocks,)."""
        if states not in self._firsts:
            wide = [place.start for place in self.blocks.values() if place.stop - place.start == states]
            self._firsts[states] = np.array(wide, dtype=np.intp)
        return self._firsts[states]

    def among(self, blocks: Iterable[Block]) -> Joint:
        """The belief of some blocks alone, in the order given: a joint of its own."""
        marginal, states = Joint(), list[int]()
        for block in blocks:
            first = len(states)
            states.extend(range(self.blocks[block].start, self.blocks[block].stop))
            marginal.blocks[block] = slice(first, len(states))
        index = np.array(states, dtype=np.intp)
        marginal.mean, marginal.covariance = self.mean[index], self._covariance.among(index)
        return marginal

    def among_each(self, index: npt.NDArray[np.intp]) -> Array:
        """The covariances of the states of some whole blocks at a time, by their indices, shape (k, n): shape (k, n, n)."""
        return self._covariance.among(index)

    def indices(self, blocks: Sequence[Block], states: int) -> npt.NDArray[np.intp]:
        """Where the first states of some blocks stand, shape (blocks, states). KeyError: one is not in it."""
        first = np.array([self.blocks[block].start for block in blocks], dtype=np.intp)
        return np.asarray(first[:, np.newaxis] + np.arange(states))

    def moments(self, *blocks: Block) -> Moments:
        """The marginal of some blocks, in the order given."""
        if len(blocks) == 1:
            at = self.blocks[blocks[0]]
            return Moments(self.mean[at].copy(), self._covariance.block(at))
        local = self.among(blocks)
        return Moments(local.mean, local.covariance)

    # --- blocks ---------------------------------------------------------------------------------------------------------

    def add(self, block: Block, moments: Moments, follows: Mapping[Block, Array] | None = None) -> None:
        """A new block, independent of all others but for those that it `follows`.

        Its covariance is what `moments` has, and what comes of their errors times the matrices, (states of the new one, of the other).
        """
        n, m = len(self.mean), len(moments.mean)
        if block in self.blocks:
            raise ValueError(f"{block!r} is in the joint already")
        covariance = np.zeros((n + m, n + m))
        covariance[:n, :n], covariance[n:, n:] = self.covariance, _symmetric(moments.covariance)
        if follows:
            cross = sum((by @ self.covariance[self.blocks[other]] for other, by in follows.items()), np.zeros((m, n)))
            spread = sum((cross[:, self.blocks[other]] @ by.T for other, by in follows.items()), np.zeros((m, m)))
            covariance[n:, :n], covariance[:n, n:] = cross, cross.T
            covariance[n:, n:] += _symmetric(spread)
        self.mean, self.covariance = np.concatenate([self.mean, moments.mean]), covariance
        self.blocks[block] = slice(n, n + m)
        self._firsts = {}

    def drop(self, block: Block) -> None:
        """Remove a block (marginalise it out): the other blocks keep their means and covariances."""
        gone = self.blocks.pop(block)
        keep = np.r_[0 : gone.start, gone.stop : len(self.mean)]
        self.mean, self.covariance = self.mean[keep], self.covariance[np.ix_(keep, keep)]
        width = gone.stop - gone.start
        for name, place in self.blocks.items():
            if place.start > gone.start:
                self.blocks[name] = slice(place.start - width, place.stop - width)
        self._firsts = {}

    def rename(self, block: Block, name: Block) -> None:
        """A block has another name from now on."""
        self.blocks = {name if other == block else other: place for other, place in self.blocks.items()}

    # --- time -----------------------------------------------------------------------------------------------------------

    def move(self, block: Block, mean: Array, transition: Array, noise: Array) -> None:
        """A block goes to a new mean; `transition` is the derivative of new by old, `noise` the covariance that is added."""
        at = self.blocks[block]
        self.mean[at] = mean
        rows = transition @ self.covariance[at, :]
        rows[:, at] = _symmetric(rows[:, at] @ transition.T + noise)
        self.covariance[at, :] = rows
        self.covariance[:, at] = rows.T

    def keep(self, block: Block, by: Array, noise: Array, total: Block) -> None:
        """Add noise, covariance (k, k), to the sum in the block `total`, (k,). `block` has it already, times `by`, (states, k)."""
        errors = np.zeros((len(self.mean), len(noise)))
        errors[self.blocks[block]], errors[self.blocks[total]] = by, np.eye(len(noise))
        at, added = self.blocks[block], _symmetric(errors @ noise @ errors.T)
        added[at, at] = 0.0
        self.covariance += added

    def shear(self, to: Array, by: Array, factors: Array) -> None:
        """Add `factors` times the states `by` to the states `to`; indices and factors have shape (k,), none is in both.

        The means stay, because a mean that has moved is what calls for this (`vehicle.correct`).
        """
        self._covariance.shear(to, by, factors)

    def mean_of(self, states: int | Sequence[int]) -> tuple[float, float]:
        """Mean and variance of one state, or of the mean of some, by their indices."""
        at = np.atleast_1d(states)
        return float(self.mean[at].mean()), float(self.covariance[np.ix_(at, at)].mean())

    def regression(self, states: int | Sequence[int]) -> Array:
        """The regression coefficients of all states on one, or on the mean of some, by their indices: shape (n,)."""
        at = np.atleast_1d(states)
        covariance = self.covariance[at].mean(axis=0)
        return np.asarray(covariance / covariance[at].mean())

    def widen(self, states: int | Sequence[int], variance: float, moved: Array) -> None:
        """Replace the variance of one state, or of the mean of some, by their indices, by a larger one.

        All other covariances follow by regression on it. The means of all states move by `moved`, shape (n,).
        """
        coefficients, (_, before) = self.regression(states), self.mean_of(states)
        self.mean = self.mean + moved
        self.covariance = self.covariance + np.outer(coefficients, coefficients) * (variance - before)

    def restore(self, states: Sequence[int], known: Moments) -> Array:
        """Give some states, by their indices, this mean and covariance, shape (k,) and (k, k); all else follows by regression on them.

        Returned is by how much all means have moved, shape (n,).
        """
        before = self.covariance[np.ix_(states, states)]
        coefficients = self.covariance[:, states] @ np.linalg.pinv(before, hermitian=True)
        moved: Array = coefficients @ (known.mean - self.mean[states])
        added = coefficients @ (known.covariance - before) @ coefficients.T
        self.mean = self.mean + moved
        self.covariance = self.covariance + (added + added.T) / 2
        return moved

    def decay(self, keep: Mapping[Block, float]) -> None:
        """Blocks of mean zero forget: the share `keep` of each stays, and noise brings back the stationary variance of 1."""
        if not keep:
            return
        factor = np.ones(len(self.mean))
        for block, share in keep.items():
            factor[self.blocks[block]] = share
        self.mean *= factor
        covariance = self.covariance
        covariance *= np.outer(factor, factor)
        covariance[np.diag_indices_from(self.covariance)] += 1 - factor**2

    # --- evidence -------------------------------------------------------------------------------------------------------

    def expected(self, factor: Factor) -> Expected:
        """What is expected of a measurement, but for its noise; it changes nothing."""
        places = [(self.blocks[block], rows) for block, rows in factor.jacobians.items() if block in self.blocks]
        cross = self._covariance.rows(places)
        parts = (
            cross[:, self.blocks[block]] @ rows.T
            if block in self.blocks
            else rows @ factor.priors[block].covariance @ rows.T
            for block, rows in factor.jacobians.items()
        )
        return Expected(cross, sum(parts, np.zeros((len(cross),) * 2)))

    def innovation(self, *factors: Factor) -> Innovation:
        """What measurements say together beyond what is expected, with all that their errors share; it changes nothing."""
        whole = together(factors)
        return self.expected(whole).innovation(whole)

    def innovations(self, factors: Sequence[Factor]) -> list[Innovation]:
        """What each measurement says by itself; those of one shape are worked out at once."""
        alike: dict[tuple[int, ...], list[int]] = {}
        for number, factor in enumerate(factors):
            widths = [part.shape[1] for block, part in factor.jacobians.items() if block in self.blocks]
            alike.setdefault((len(factor.residual), *widths), []).append(number)
        by_number: dict[int, Innovation] = {}
        for (_, *widths), numbers in alike.items():
            its = [factors[number] for number in numbers]
            known = [[block for block in factor.jacobians if block in self.blocks] for factor in its]
            first = np.array([[self.blocks[block].start for block in blocks] for blocks in known], dtype=np.intp)
            states = np.concatenate([np.arange(width) for width in widths])
            covariance = self.among_each(np.repeat(first, widths, axis=1) + states)
            rows = np.array(
                [np.hstack([factor.jacobians[b] for b in blocks]) for factor, blocks in zip(its, known, strict=True)]
            )
            spreads = rows @ covariance @ rows.swapaxes(1, 2)
            for number, factor, spread in zip(numbers, its, spreads, strict=True):
                new = [
                    (part, factor.priors[block].covariance)
                    for block, part in factor.jacobians.items()
                    if block in factor.priors
                ]
                more = sum((part @ prior @ part.T for part, prior in new), factor.noise)
                by_number[number] = Innovation(factor.residual, spread + more)
        return [by_number[number] for number in range(len(factors))]

    def begin(self, priors: Mapping[Block, Moments], anchors: Mapping[Block, Array] | None = None) -> None:
        """Add the blocks that are not there, and put means that are arbitrary at their anchors."""
        for block, prior in priors.items():
            if block not in self.blocks:
                self.add(block, prior)
        for block, anchor in (anchors or {}).items():
            self.mean[self.blocks[block]] = anchor

    def update(self, factor: Factor, only: Collection[Block] | None = None, expected: Expected | None = None) -> Array:
        """Kalman's update, as P - W^T W with W = L^-1 H P, where L L^T is the innovation's covariance H P H^T + R.

        Of `only` some blocks, if given: the others are considered (Schmidt 1966), their means and covariances stay. What is `expected`
        is worked out where it is not given. Returned is by how much the mean moved. LinAlgError: that covariance is not positive.
        """
        self.begin(factor.priors, factor.anchors)
        residual, noise, before = factor.residual, factor.noise, self.mean
        expected = expected or self.expected(factor)
        cross, spread = expected.cross, expected.spread + noise
        if not spread.any():  # without an error on either side nothing can be learnt
            return np.zeros_like(before)
        root = np.linalg.cholesky(spread)
        white = np.linalg.solve(root, np.concatenate([cross, residual[:, np.newaxis]], axis=1))
        gained = white[:, :-1]
        if only is not None:
            return self._consider(white[:, -1], gained, only)
        self.mean = before + white[:, -1] @ gained
        if not self._covariance.subtract(gained):
            places = [(self.blocks[block], rows) for block, rows in factor.jacobians.items()]
            self.covariance = self._by_josephs_form(cross, np.linalg.solve(root.T, gained).T, places, noise)
        return self.mean - before

    def _consider(self, residual: Array, gained: Array, only: Collection[Block]) -> Array:
        """The update of some blocks alone, and of their covariances with all; by the white residual (m,) and W, (m, n)."""
        mine = np.zeros(len(self.mean), dtype=bool)
        for block in only:
            mine[self.blocks[block]] = True
        moved = np.where(mine, residual @ gained, 0.0)
        self.mean = self.mean + moved
        covariance = self.covariance
        covariance -= np.where(mine | mine[:, np.newaxis], gained.T @ gained, 0.0)
        return moved

    def _by_josephs_form(self, cross: Array, gain: Array, places: Sequence[tuple[slice, Array]], noise: Array) -> Array:
        """The covariance after an update, as (I - K H) P (I - K H)^T + K R K^T: exact also where hardly any of P is left.

        `cross` is H P, `gain` K, shape (n, m); `places` are where the rows of H belong.
        """
        part = self.covariance - gain @ cross
        seen = sum((part[:, place] @ rows.T for place, rows in places), np.zeros_like(gain))
        return _symmetric(part - seen @ gain.T + gain @ noise @ gain.T)


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))


def pairs_of(names: Sequence[str], some: Sequence[str]) -> npt.NDArray[np.intp]:
    """Where x and y of some names are in a vector that has two numbers of each name, shape (2 some,)."""
    first = 2 * np.array([names.index(name) for name in some], dtype=np.intp)
    return np.asarray((first[:, np.newaxis] + np.arange(2)).ravel())
