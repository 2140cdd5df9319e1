"""GOSPA, the distance of a set of tracks from the things that are there, and its parts. Pure.

A. S. Rahmathullah, A. F. Garcia-Fernandez, L. Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017, with
alpha = 2. It is the least value of (sum of d^p over assigned pairs + c^p / 2 for each thing and each track left over)^(1/p),
over all assignments of tracks to things.
"""

import math
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.grid import Array

POWER = 2  # p


@dataclass(frozen=True)
class Gospa:
    """One comparison. `localisation`, `missed` and `false` are the sums of p-th powers that each kind of error adds."""

    pairs: tuple[tuple[int, int], ...]  # thing and track, by index, in the order of things
    localisation: float  # unit^p, of the pairs
    missed: float  # unit^p: c^p / 2 for each thing without a track
    false: float  # unit^p: c^p / 2 for each track without a thing

    @property
    def distance(self) -> float:
        """The metric itself, in the unit of the places."""
        return float((self.localisation + self.missed + self.false) ** (1.0 / POWER))


def gospa(things: Array, tracks: Array, cut: float) -> Gospa:
    """Compare places, arrays of shape (n, 2) and (m, 2), with the cut-off distance c = `cut`, all in one unit.

    ValueError: `cut` is not positive.
    """
    if not cut > 0:
        raise ValueError(f"cut {cut:g}: give a positive one")
    distances = np.hypot(*np.moveaxis(things[:, None, :] - tracks[None, :, :], -1, 0))
    # A pair at the cut costs what the two cost that are left over, so all are assigned and the far ones let go.
    costs = np.minimum(distances, cut) ** POWER
    pairs = tuple((i, j) for i, j in assignment(costs) if distances[i, j] < cut)
    each = cut**POWER / 2
    near = math.fsum(float(costs[pair]) for pair in pairs)
    return Gospa(pairs, near, each * (len(things) - len(pairs)), each * (len(tracks) - len(pairs)))


def assignment(costs: Array) -> list[tuple[int, int]]:
    """Pairs of a row and a column, min(n, m) of them, at the least sum of their `costs`, shape (n, m); sorted by row.

    Shortest augmenting paths: R. Jonker, A. Volgenant, Computing 38 (1987), 325-340.
    """
    n, m = costs.shape
    if n > m:
        return sorted((i, j) for j, i in assignment(costs.T))
    of_row, of_column = np.zeros(n), np.zeros(m)  # the dual variables
    row_of = np.full(m, -1)
    for start in range(n):
        least, before = np.full(m, np.inf), np.full(m, -1)
        done = np.zeros(m, dtype=bool)
        column, row = -1, start
        while row >= 0:  # until a column is reached that has no row yet
            shorter = (costs[row] - of_row[row] - of_column) + (least[column] if column >= 0 else 0.0)
            better = ~done & (shorter < least)
            least[better], before[better] = shorter[better], column
            column = int(np.argmin(np.where(done, np.inf, least)))
            done[column] = True
            row = int(row_of[column])
        way = least[column]
        of_row[start] += way
        for j in np.flatnonzero(done & (row_of >= 0)):
            of_row[row_of[j]] += way - least[j]
        of_column[done] -= way - least[done]
        while column >= 0:
            other = int(before[column])
            row_of[column] = start if other < 0 else row_of[other]
            column = other
    return sorted((int(i), j) for j, i in enumerate(row_of) if i >= 0)
