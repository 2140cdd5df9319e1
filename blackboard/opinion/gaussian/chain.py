"""Measurements that are judged one after the other, each given those before it that are taken, and then taken in one update."""

from collections.abc import Sequence

import numpy as np

from blackboard.opinion.gaussian.joint import Expected, Factor, Innovation, Joint, together


class Chain:
    """Mutable: `next` for each measurement, in order, and `add` after those that are taken.

    All are linearised at one mean. What one says given others is found in the small covariance of all that they say, so that the
    joint changes once.
    """

    def __init__(self, joint: Joint, factors: Sequence[Factor]) -> None:
        whole = together(factors)
        self._coming, self._expected = list(reversed(factors)), joint.expected(whole)
        self._residual, self._spread = whole.residual.copy(), self._expected.spread + whole.noise
        self._noise, self._mine = whole.noise, slice(0, 0)  # rows of the newest measurement
        self._taken: list[Factor] = []
        self._rows: list[int] = []  # of what is taken

    def next(self) -> Innovation:
        """What the next measurement says beyond what is expected."""
        first = self._mine.stop
        self._mine = slice(first, first + len(self._coming.pop().residual))
        return Innovation(self._residual[self._mine], self._spread[self._mine, self._mine])

    def add(self, factor: Factor) -> None:
        """The newest one is taken, as a factor whose noise may be wider. LinAlgError: what it says has no positive covariance."""
        mine, rest = self._mine, slice(self._mine.stop, None)
        spread = self._spread[mine, mine] + (factor.noise - self._noise[mine, mine])
        if not spread.any():  # without an error on either side nothing can be learnt
            return
        gain = np.linalg.solve(spread, self._spread[mine, rest]).T
        self._residual[rest] -= gain @ self._residual[mine]
        self._spread[rest, rest] -= gain @ self._spread[mine, rest]
        self._taken.append(factor)
        self._rows += range(mine.start, mine.stop)

    def taken(self) -> tuple[Factor, Expected] | None:
        """All that is taken as one measurement, with what is expected of it; None: nothing."""
        rows = np.array(self._rows, dtype=np.intp)
        return (together(self._taken), self._expected.of(rows)) if self._taken else None
