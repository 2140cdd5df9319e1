"""Who was seen: the posterior over all assignments of one frame's unnamed sightings to subjects, each seen once at most.

All joint events count, as in Fortmann, Bar-Shalom, Scheffe, *Sonar tracking of multiple targets using joint probabilistic data
association*, IEEE J. Oceanic Eng. 8(3), 1983. Their sum is that of all matchings. It is taken subject set by subject set, which costs
m 2^n for m sightings of n subjects and not n!, and separately for each cluster of pairs that share a sighting or a subject.
In a crowd that is too large for that it is approximated by belief propagation (Williams, Lau, IEEE TAES 50(4), 2014).
How often something is seen that is no known subject is found out for each observer.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from blackboard.opinion.grid import Array

T = TypeVar("T")

CLEAR = 0.95  # of a posterior; of all that are taken fewer are wrong than one in twenty, because most are clearer
MAX_CLUSTER = 10  # sightings, or subjects, whichever are fewer; in a larger cluster beliefs are propagated
# Of belief propagation, at most; and how little (relative) its messages change once it is done.
ROUNDS, CLOSE = 100, 1e-6
MOST = 1e20  # of a weight, so that the products of `MAX_CLUSTER` are finite
# Things that are no known subject, in so many frames: what is expected before anything was seen.
STRANGE, FRAMES = 1.0, 10.0
CLASSES = 64  # of which it is known what an observer sees of them
REMEMBERED = 100.0  # frames after which what was seen is half forgotten, and more
LEAST = 1e-9  # of a rate: what was not seen for hours is not impossible


@dataclass(frozen=True)
class Rate:
    """How often something is seen, as things in a frame that are no known subject: a mean over the last frames."""

    seen: float = STRANGE
    frames: float = FRAMES

    @property
    def rate(self) -> float:
        return max(LEAST, self.seen / self.frames)

    def plus(self, seen: float, frames: float = 1.0) -> "Rate":
        """After one more frame, or so much of one, with so many."""
        kept = 1.0 - frames / REMEMBERED
        return Rate(kept * self.seen + seen, kept * self.frames + frames)


def keep(table: dict[tuple[str, str], T], key: tuple[str, str], value: T) -> None:
    """Keep something of an observer and a class: of one that speaks of more than `CLASSES` the first is forgotten."""
    if key not in table and len(its := [one for one in table if one[0] == key[0]]) >= CLASSES:
        del table[its[0]]
    table[key] = value


def posterior(weights: Array) -> Array:
    """The probability that each sighting is of each subject, shape (m, n).

    `weights`, shape (m, n), are how much likelier a pair is than that the sighting is of something else and the subject is not seen;
    0: it cannot be.
    """
    weights = np.minimum(weights, MOST)
    odds = np.zeros_like(weights)
    for rows, columns in _clusters(weights > 0):
        part = weights[np.ix_(rows, columns)]
        if min(part.shape) > MAX_CLUSTER:
            odds[np.ix_(rows, columns)] = _propagated(part)
        else:
            wide = part.shape[1] > part.shape[0]
            odds[np.ix_(rows, columns)] = _marginals(part.T).T if wide else _marginals(part)
    return odds


def _clusters(pairs: Array) -> list[tuple[list[int], list[int]]]:
    """The connected rows and columns of a matrix of booleans."""
    clusters, left = [], set(np.flatnonzero(pairs.any(axis=1)).tolist())
    while left:
        rows, columns, new = set[int](), set[int](), {min(left)}
        while new:
            rows |= new
            columns |= set(np.flatnonzero(pairs[sorted(new)].any(axis=0)).tolist())
            new = set(np.flatnonzero(pairs[:, sorted(columns)].any(axis=1)).tolist()) - rows
        left -= rows
        clusters.append((sorted(rows), sorted(columns)))
    return clusters


def _marginals(weights: Array) -> Array:
    """`posterior` of one cluster, by all sets of columns that the rows before, and those behind, may have taken."""
    number, width = weights.shape
    sets = np.arange(1 << width)
    free = [sets[sets >> column & 1 == 0] for column in range(width)]
    before = [(sets == 0).astype(float)]
    for row in weights:
        after = before[-1].copy()
        for column in range(width):
            after[free[column] | 1 << column] += row[column] * before[-1][free[column]]
        before.append(after)
    total, behind = before[-1].sum(), np.ones(len(sets))
    marginals = np.zeros((number, width))
    for i in reversed(range(number)):
        earlier = behind.copy()
        for column in range(width):
            rest = weights[i, column] * behind[free[column] | 1 << column]
            marginals[i, column] = (before[i][free[column]] * rest).sum() / total
            earlier[free[column]] += rest
        behind = earlier
    return marginals


def _propagated(weights: Array) -> Array:
    """`posterior` of a cluster of any size, nearly: how much the subjects claim each sighting, and the sightings each subject."""
    free = np.ones_like(weights)
    for _ in range(ROUNDS):
        claims = weights / (1.0 + _others(weights * free))
        before, free = free, 1.0 / (1.0 + _others(claims.T).T)
        if np.abs(free / before - 1.0).max() < CLOSE:
            break
    return np.asarray(claims / (1.0 + claims.sum(axis=1, keepdims=True)))


def _others(values: Array) -> Array:
    """Of each value the sum of all others in its column; without a difference, which would lose small ones beside large ones."""
    sums = np.zeros_like(values)
    sums[1:] += np.cumsum(values, axis=0)[:-1]
    sums[:-1] += np.cumsum(values[::-1], axis=0)[-2::-1]
    return sums
