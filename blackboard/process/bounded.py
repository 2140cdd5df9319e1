"""A table that keeps so many entries: the oldest are forgotten first. Pure."""

from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")


def put(table: dict[K, V], key: K, value: V, most: int) -> None:
    """Set a key as the newest one; the oldest go where there are too many."""
    table.pop(key, None)
    table[key] = value
    while len(table) > most:
        del table[next(iter(table))]
