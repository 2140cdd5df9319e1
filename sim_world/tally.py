"""The scores of many beliefs as running sums, for a world that runs for long. Pure."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEVELS, Score, errors


def _nothing() -> Array:
    return np.zeros(2 + len(LEVELS))


@dataclass
class Tally:
    """What `Score.summary` says, of entries that are not kept.

    Only the errors are kept, 8 bytes each, because their 95 % quantile cannot be had from a sum.
    """

    _errors: array[float] = field(default_factory=lambda: array("d"))
    _sums: Array = field(
        default_factory=_nothing
    )  # entropies and log scores in nats, regions of each level that held the truth

    def add(self, score: Score) -> None:
        """Take in a score of one entry."""
        self._errors.append(score.errors[0])
        self._sums += (score.entropies[0], score.log_scores[0], *(score.held(level)[0] for level in LEVELS))

    @staticmethod
    def merged(parts: Iterable[Tally]) -> Tally:
        """The entries of several, as a new one."""
        whole = Tally()
        for part in parts:
            whole._errors.extend(part._errors)
            whole._sums += part._sums
        return whole

    def summary(self) -> dict[str, Any]:
        """The block S of a scorecard, as `Score.summary` has it, but for the last bits of sums."""
        n = len(self._errors)
        if not n:
            return Score().summary()
        entropy, log_score, *held = (self._sums / n).tolist()
        return {
            "n": n,
            **errors(self._errors),
            "entropy": entropy,
            "log_score": log_score,
            "coverage": {str(level): share for level, share in zip(LEVELS, held, strict=True)},
        }
