"""How far estimates are from the truth, in bounded memory: few distances are kept, many are counted in bins. Pure."""

from __future__ import annotations

import math
from array import array
from typing import Final

import numpy as np

from blackboard.opinion.scores import errors

KEPT = 4096  # distances, 32 KiB; beyond them they are counted
LEAST, MOST = (
    1e-4,
    1e4,
)  # of a distance that is told from smaller and larger ones in the quantile, in the unit of the grid
WIDTH = 0.002  # of a bin, in ln of the distance: the quantile is off by 0.1 % at most
BINS: Final = math.ceil(math.log(MOST / LEAST) / WIDTH)  # 36 KiB
SHARE = 0.95  # of the quantile


class Distances:
    """Distances in the unit of a grid; `summary` is what `blackboard.opinion.scores.errors` says of them."""

    def __init__(self) -> None:
        self._kept: array[float] = array("d")
        self._bins: np.ndarray[tuple[int], np.dtype[np.int32]] | None = None  # once they are counted
        self._n, self._sum, self._squares, self._most = 0, 0.0, 0.0, 0.0

    def __len__(self) -> int:
        return self._n if self._bins is not None else len(self._kept)

    def add(self, distance: float) -> None:
        """Take in one."""
        if self._bins is None and len(self._kept) < KEPT:
            self._kept.append(distance)
            return
        self._count(np.array([distance]))

    def take(self, other: Distances) -> None:
        """Take in all of another one."""
        if self._bins is None and other._bins is None and len(self) + len(other) <= KEPT:
            self._kept.extend(other._kept)
            return
        self._count(np.asarray(other._kept))
        if self._bins is not None and other._bins is not None:
            self._bins += other._bins
            self._n, self._sum = self._n + other._n, self._sum + other._sum
            self._squares, self._most = self._squares + other._squares, max(self._most, other._most)

    def summary(self) -> dict[str, float]:
        """Their rmse, mean, p95 and max, of at least one; where they are counted p95 is that of a bin, and at most the max."""
        if self._bins is None:
            return errors(self._kept)
        place = int(np.searchsorted(np.cumsum(self._bins), SHARE * (self._n - 1), side="right"))
        p95 = min(self._most, LEAST * math.exp(WIDTH * (place + 0.5)))
        return {"rmse": math.sqrt(self._squares / self._n), "mean": self._sum / self._n, "p95": p95, "max": self._most}

    def _count(self, distances: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        """Count these, and those that were kept until now."""
        if self._bins is None:
            self._bins = np.zeros(BINS, dtype=np.int32)
            kept, self._kept = np.asarray(self._kept), array("d")
            self._count(kept)
        if not len(distances):
            return
        places = np.log(np.clip(distances, LEAST, MOST) / LEAST) / WIDTH
        np.add.at(self._bins, np.minimum(places.astype(np.intp), BINS - 1), 1)
        self._n, self._sum = self._n + len(distances), self._sum + float(distances.sum())
        self._squares += float(distances @ distances)
        self._most = max(self._most, float(distances.max()))
