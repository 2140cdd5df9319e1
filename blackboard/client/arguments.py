"""Arguments of a program's calls, checked before anything is done with them. Pure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blackboard.wire.types import LARGEST, LEAST

SMALLEST = 1e-9  # the smallest eigenvalue of a covariance, of its scale


class Call:
    """The arguments of a call, checked. ValueError: one that cannot be, by its name, in one sentence."""

    def __init__(self, method: str) -> None:
        self._method = method

    def number(self, name: str, value: Any, least: float = -LARGEST) -> float:
        found = self._float(value)
        if not (math.isfinite(found) and least <= found <= LARGEST):
            bound = "" if least < 0 else f" of at least {least:g}"
            raise self.wrong(name, value, f"give a finite number{bound}")
        return found

    def angle(self, name: str, value: Any) -> float:
        return math.remainder(self.number(name, value), math.tau)

    def bearing(self, name: str, value: Any) -> float:
        if abs(found := self.number(name, value)) > math.tau:
            raise self.wrong(name, value, "give radians; this is more than a whole turn")
        return math.remainder(found, math.tau)

    def share(self, name: str, value: Any) -> float:
        found = self._float(value)
        if not 0.0 < found <= 1.0:
            raise self.wrong(name, value, "give a number above 0 and at most 1")
        return found

    def sigma(self, name: str, value: Any) -> float | None:
        return None if value is None else self.number(name, value, least=LEAST)

    def numbers(self, name: str, value: Any, shape: tuple[int, ...]) -> Any:
        try:
            found = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            found = np.array(np.nan)
        if found.shape != shape or not np.isfinite(found).all() or np.abs(found).max() > LARGEST:
            raise self.wrong(name, value, f"give {' x '.join(str(n) for n in shape)} finite numbers")
        return tuple(found.tolist())

    def covariance(self, name: str, value: Any, size: int) -> Any:
        found = np.array(self.numbers(name, value, (size, size)))
        scale = np.sqrt(np.maximum(np.diag(found), LEAST**2))
        symmetric = np.abs(found - found.T).max() <= 1e-6 * np.abs(found).max()
        if not symmetric or np.linalg.eigvalsh(found / np.outer(scale, scale))[0] < SMALLEST:
            raise self.wrong(name, value, "give a symmetric matrix with positive eigenvalues")
        return found

    def array(self, name: str, value: Any, columns: int) -> Any:
        shape = np.shape(value)
        if len(shape) != 2 or shape[1] != columns or not shape[0]:
            raise self.wrong(name, shape, f"give an array of shape (N, {columns})")
        return np.array(self.numbers(name, value, shape))

    def weights(self, name: str, value: Any, count: int) -> Any:
        found = np.array(self.numbers(name, value, (count,)))
        if (found < 0).any() or not found.sum() > 0:
            raise self.wrong(name, value, "give numbers of at least 0, not all 0")
        return found

    def _float(self, value: Any) -> float:
        try:
            return math.nan if isinstance(value, bool | str) else float(value)
        except (TypeError, ValueError, OverflowError):
            return math.nan

    def wrong(self, name: str, value: Any, cure: str) -> ValueError:
        shown = " ".join(repr(value).split())  # that of an array has lines
        return ValueError(f"{self._method}({name}={shown}): {cure}")
