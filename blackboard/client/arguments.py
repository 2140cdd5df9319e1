"""Arguments of a program's calls, checked before anything is done with them. Pure.

What cannot be is a ValueError of one sentence that names the argument.
"""

import math
from collections.abc import Callable, Mapping
from numbers import Real
from os import PathLike
from typing import Any

import numpy as np

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.types import LARGEST, LEAST

SMALLEST = 1e-9  # the smallest eigenvalue of a covariance, of its scale
SHOWN = 100  # characters of a value that a message shows


class Call:
    """A call of a method. Each check returns the value as a float or floats."""

    def __init__(self, method: str, warn: Callable[[str, str], None] = lambda name, text: None) -> None:
        """`warn` is called with the argument and a sentence where an angle may be in degrees."""
        self._method, self._warn = method, warn

    def number(self, name: str, value: Any, least: float = -LARGEST) -> float:
        number = self._float(value)
        if math.isfinite(number) and abs(number) > LARGEST:
            raise self.wrong(name, value, f"is larger than {LARGEST:g}, which no message holds: has it another unit?")
        if not (math.isfinite(number) and least <= number):
            bound = "" if least < 0 else f" of at least {least:g}"
            raise self.wrong(name, value, f"give a finite number{bound}")
        return number

    def turn(self, name: str, value: Any) -> float:
        angle = self.number(name, value)
        if abs(angle) > math.tau:
            where = f"{self._method}({name})"
            self._warn(where, f"{self._method}({name}={angle:g}): is more than a whole turn; give radians")
        return angle

    def angle(self, name: str, value: Any) -> float:
        return math.remainder(self.turn(name, value), math.tau)

    def bearing(self, name: str, value: Any) -> float:
        if abs(angle := self.number(name, value)) > math.tau:
            raise self.wrong(name, value, "give radians; this is more than a whole turn")
        return math.remainder(angle, math.tau)

    def share(self, name: str, value: Any) -> float:
        share = self._float(value)
        if not 0.0 < share <= 1.0:
            raise self.wrong(name, value, "give a number above 0 and at most 1")
        return share

    def sigma(self, name: str, value: Any) -> float | None:
        return None if value is None else self.number(name, value, least=LEAST)

    def noise(self, name: str, value: Any) -> float | None:
        """A sigma of what was driven; 0 where the robot stands."""
        return None if value is None else self.number(name, value, least=0.0)

    def numbers(self, name: str, value: Any, shape: tuple[int, ...]) -> Any:
        numbers = self._floats(value)
        if numbers.shape != shape or not np.isfinite(numbers).all() or np.abs(numbers).max() > LARGEST:
            raise self.wrong(name, value, f"give {' x '.join(str(n) for n in shape)} finite numbers")
        return tuple(numbers.tolist())

    def covariance(self, name: str, value: Any, size: int) -> Array:
        matrix = np.array(self.numbers(name, value, (size, size)))
        if np.diag(matrix).min() < LEAST**2:
            raise self.wrong(
                name, value, f"give variances of at least {LEAST**2:g}, in a matrix with positive eigenvalues"
            )
        scale = np.sqrt(np.maximum(np.diag(matrix), LEAST**2))
        symmetric = np.abs(matrix - matrix.T).max() <= 1e-6 * np.abs(matrix).max()
        if not symmetric or np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] < SMALLEST:
            raise self.wrong(name, value, "give a symmetric matrix with positive eigenvalues")
        return matrix

    def array(self, name: str, value: Any, columns: int) -> Array:
        shape = self.shape(value)
        if len(shape) != 2 or shape[1] != columns or not shape[0]:
            raise self.wrong(name, shape or value, f"give an array of shape (N, {columns})")
        return np.array(self.numbers(name, value, shape))

    def weights(self, name: str, value: Any, count: int) -> Array:
        weights = np.array(self.numbers(name, value, (count,)))
        if (weights < 0).any() or not weights.sum() > 0:
            raise self.wrong(name, value, "give numbers of at least 0, not all 0")
        return weights

    def shape(self, value: Any) -> tuple[int, ...]:
        """That of an array of numbers; () of what is none."""
        return self._floats(value).shape

    def wrong(self, name: str, value: Any, cure: str) -> ValueError:
        """The error of an argument: its value, and what to give instead."""
        return ValueError(f"{self._method}({name}={shown(value)}): {cure}")

    def _float(self, value: Any) -> float:
        try:
            return math.nan if isinstance(value, bool | np.bool_ | str | bytes) else float(value)
        except (TypeError, ValueError, OverflowError):
            return math.nan

    def _floats(self, value: Any) -> Array:
        """An array of a value; a number that is none where it holds something else than numbers."""
        try:
            array = np.asarray(value)
            if array.dtype.kind in "iuf" and (array is value or not _has_truths(value)):
                return array.astype(np.float64)
            return np.array(np.nan) if array.dtype.kind != "O" else np.vectorize(self._float, [float])(array)
        except (TypeError, ValueError, OverflowError):
            return np.array(np.nan)


def _has_truths(value: Any) -> bool:
    """Whether booleans are among the items of a sequence, which an array of numbers would take for 0 and 1."""
    if isinstance(value, list | tuple):
        return any(map(_has_truths, value))
    return isinstance(value, bool | np.bool_)


#: What a member of a team is made of: of which kinds, and in words.
KINDS: Mapping[str, tuple[tuple[type, ...], str]] = {
    "robot": ((str,), "a name"),
    "team": ((str,), "a name"),
    "scenario": ((str, PathLike, Scenario, type(None)), "a file, the name of a scenario, or a Scenario"),
    "sub_team": ((str, list, tuple, type(None)), "a name, or a list of names"),
    "endpoint": ((str, list, tuple), "a text, or a list of texts"),
    "grid": ((Grid, type(None)), "a Grid"),
    "keys": ((str, PathLike, type(None)), "a directory"),
    "patience": ((Real,), "seconds, at least 0"),
}


def check_kinds(made: str, **arguments: object) -> None:
    """UserError: an argument of what is made is of a kind that cannot be."""
    for name, value in arguments.items():
        kinds, cure = KINDS[name]
        texts = not isinstance(value, list | tuple) or all(isinstance(text, str) for text in value)
        if not isinstance(value, kinds) or not texts or (isinstance(value, Real) and not float(value) >= 0):
            raise UserError(f"{made}({name}={shown(value)}): give {cure}")


def shown(value: object) -> str:
    """A value as a message shows it: on one line, the beginning of a long one."""
    return cut(" ".join(repr(value).split()))  # an array is shown on several lines


def cut(text: str) -> str:
    """A text, or the beginning of a long one."""
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
