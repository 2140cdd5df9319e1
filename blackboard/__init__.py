"""A Zenoh-based distributed blackboard for robot teams. Here: beliefs and the pooling of opinions, which need numpy alone."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from blackboard.errors import OpinionError
    from blackboard.opinion.belief import Belief
    from blackboard.opinion.grid import Grid
    from blackboard.opinion.pools import POOLS, cooperative_pool, linear_pool, logarithmic_pool
    from blackboard.opinion.weights import entropy, entropy_weights

    __version__: str

__all__ = [
    "POOLS",
    "Belief",
    "Grid",
    "OpinionError",
    "cooperative_pool",
    "entropy",
    "entropy_weights",
    "linear_pool",
    "logarithmic_pool",
]

#: Where each public name is. It is loaded, and numpy with it, when it is asked for.
_HOMES = {
    "Belief": "opinion.belief",
    "Grid": "opinion.grid",
    "OpinionError": "errors",
    "POOLS": "opinion.pools",
    "cooperative_pool": "opinion.pools",
    "entropy": "opinion.weights",
    "entropy_weights": "opinion.weights",
    "linear_pool": "opinion.pools",
    "logarithmic_pool": "opinion.pools",
}


def __getattr__(name: str) -> object:
    """A public name, or `__version__`, which takes time to read from the package's metadata."""
    if name in _HOMES:
        found = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        return found
    if name == "__version__":
        from importlib.metadata import version

        return version("cop-blackboard")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
