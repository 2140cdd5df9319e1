"""What an object holds: how many entries each container has that can be reached from it, so that growth can be told from a table that is full."""

import gc
import types
from array import array
from collections import Counter, deque
from collections.abc import Iterator
from typing import Any

import numpy as np

FUNCTIONS = (types.FunctionType, types.BuiltinFunctionType)
OPAQUE = (type, types.ModuleType, *FUNCTIONS, str, bytes, int, float, bool, type(None))


def holdings(root: object, name: str) -> Counter[str]:
    """Entries by path of attributes; keys of tables and places in lists are left out of a path."""
    sizes: Counter[str] = Counter()
    visited: set[int] = set()
    waiting: list[tuple[str, Any]] = [(name, root)]
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, OPAQUE) or id(value) in visited:
            continue
        visited.add(id(value))
        if isinstance(value, np.ndarray | array):
            sizes[path] += value.size if isinstance(value, np.ndarray) else len(value)
        elif isinstance(value, dict | list | tuple | set | frozenset | deque):
            sizes[path] += len(value)
            entries = [*value.keys(), *value.values()] if isinstance(value, dict) else list(value)
            waiting += [(f"{path}[]", entry) for entry in entries]
        else:
            waiting += [(f"{path}.{key}", value) for key, value in attributes(value)]
    return sizes


def attributes(owner: object) -> Iterator[tuple[str, Any]]:
    """Names and values of an object's own attributes, also of slots; of a function's bindings and the like what the collector sees."""
    slots = [slot for kind in type(owner).__mro__ for slot in getattr(kind, "__slots__", ())]
    own = {
        **getattr(owner, "__dict__", {}),
        **{slot: getattr(owner, slot) for slot in slots if hasattr(owner, slot) and slot != "__dict__"},
    }
    if own:
        yield from own.items()
    elif type(owner).__module__ not in ("builtins", "numpy.random._generator"):
        yield from ((type(other).__name__, other) for other in gc.get_referents(owner))


def grown(before: Counter[str], after: Counter[str]) -> dict[str, tuple[int, int]]:
    """The paths that hold more than before, with both counts."""
    return {path: (before[path], count) for path, count in after.items() if count > before[path]}
