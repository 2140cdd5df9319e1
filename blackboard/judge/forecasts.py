"""Forecasts of events (probabilities) against what happened: Brier score, AUROC and calibration. Pure; counts in bins."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

OUTSIDE = 0.99  # a robot is lost where the truth is outside of the region of this share of its agreed belief
BINS = 200  # of a probability, for its order
EDGES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 0.8, 1.0)  # of the table of calibration


class Forecasts:
    """Takes forecasts one by one; `summary` is the scorecard's block "lost"."""

    def __init__(self) -> None:
        self._counts = np.zeros((BINS, 3))  # of each bin: forecasts, events that happened, sum of the probabilities
        self._squares = 0.0

    def add(self, told: float, happened: bool) -> None:
        """Take the forecast probability of an event, and whether the event happened."""
        self._counts[min(BINS - 1, int(told * BINS))] += (1.0, happened, told)
        self._squares += (told - happened) ** 2

    @staticmethod
    def merged(parts: "Iterable[Forecasts]") -> "Forecasts":
        """The forecasts of several together, as a new one."""
        whole = Forecasts()
        for part in parts:
            whole._counts += part._counts
            whole._squares += part._squares
        return whole

    def summary(self) -> dict[str, Any]:
        """The number of forecasts, the share that happened, the mean probability, Brier score, AUROC and calibration table.

        The AUROC is the probability that a forecast of what happened is above one of what did not, None where one kind is missing.
        Empty without forecasts.
        """
        n, happened, told = self._counts.sum(axis=0).tolist()
        if not n:
            return {}
        yes, no = self._counts[:, 1], self._counts[:, 0] - self._counts[:, 1]
        below = np.concatenate([[0.0], np.cumsum(no)[:-1]])
        pairs = float(yes.sum() * no.sum())
        auroc = float(yes @ (below + no / 2)) / pairs if pairs else None
        return {
            "n": round(n),
            "share": happened / n,
            "told": told / n,
            "brier": self._squares / n,
            "auroc": auroc,
            "calibration": self._table(),
        }

    def _table(self) -> list[dict[str, float]]:
        """For the forecasts between two edges: their number, their mean probability, and the share that happened."""
        rows = []
        for low, high in pairwise(EDGES):
            first, last = round(low * BINS), round(high * BINS)
            n, happened, told = self._counts[first:last].sum(axis=0).tolist()
            if n:
                rows.append({"from": low, "to": high, "n": round(n), "told": told / n, "share": happened / n})
        return rows
