"""How far estimates are from the truth, in bounded memory: few distances are kept, many are counted in bins. Pure."""

import math
from typing import Final

import numpy as np

from blackboard.opinion.grid import Array
from blackboard.opinion.scores import errors

KEPT = 4096  # distances, 32 KiB; beyond them they are counted
#: Distances outside of these count as one of them in the quantile; in the unit of the grid.
LEAST, MOST = (1e-4, 1e4)
WIDTH = 0.002  # of a bin, in ln of the distance: the quantile is off by 0.1 % at most
BINS: Final = math.ceil(math.log(MOST / LEAST) / WIDTH)  # 36 KiB
SHARE = 0.95  # of the quantile


class Distances:
    """Distances in the unit of a grid; `summary` is what `blackboard.opinion.scores.errors` says of them.

    The memory for those that are kept is taken, and touched, at once: a world that has run for long holds no more than a new one.
    """

    def __init__(self) -> None:
        self._kept = np.full(KEPT, 0.0)
        self._bins: np.ndarray[tuple[int], np.dtype[np.int32]] | None = None  # once they are counted
        self._n, self._sum, self._squares, self._most = 0, 0.0, 0.0, 0.0

    def __len__(self) -> int:
        return self._n

    def add(self, distance: float) -> None:
        self._extend(np.array([distance]))

    def add_all(self, other: "Distances") -> None:
        """Take in all of another one."""
        if other._bins is None:
            self._extend(other._kept[: other._n])
            return
        self._count(np.zeros(0))
        assert self._bins is not None
        self._bins += other._bins
        self._n, self._sum = self._n + other._n, self._sum + other._sum
        self._squares, self._most = self._squares + other._squares, max(self._most, other._most)

    def summary(self) -> dict[str, float]:
        """Their rmse, mean, p95 and max, of at least one; where they are counted p95 is that of a bin, and at most the max."""
        if self._bins is None:
            return errors(self._kept[: self._n])
        place = int(np.searchsorted(np.cumsum(self._bins), SHARE * (self._n - 1), side="right"))
        p95 = min(self._most, LEAST * math.exp(WIDTH * (place + 0.5)))
        return {"rmse": math.sqrt(self._squares / self._n), "mean": self._sum / self._n, "p95": p95, "max": self._most}

    def _extend(self, distances: Array) -> None:
        """Keep these while all fit, else count them."""
        if self._bins is None and self._n + len(distances) <= len(self._kept):
            self._kept[self._n : self._n + len(distances)] = distances
            self._n += len(distances)
        else:
            self._count(distances)

    def _count(self, distances: Array) -> None:
        """Count these, and those that were kept until now."""
        if self._bins is None:
            kept, self._kept, self._n = self._kept[: self._n], np.zeros(0), 0
            self._bins = np.zeros(BINS, dtype=np.int32)
            self._count(kept)
        if not len(distances):
            return
        places = np.log(np.clip(distances, LEAST, MOST) / LEAST) / WIDTH
        np.add.at(self._bins, np.minimum(places.astype(np.intp), BINS - 1), 1)
        self._n, self._sum = self._n + len(distances), self._sum + float(distances.sum())
        self._squares += float(distances @ distances)
        self._most = max(self._most, float(distances.max()))
