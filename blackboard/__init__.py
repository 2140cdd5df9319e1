"""A Zenoh-based distributed blackboard for robot teams. Here: beliefs and the pooling of opinions, which need numpy alone."""

from typing import TYPE_CHECKING

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import POOLS, cooperative_pool, linear_pool, logarithmic_pool
from blackboard.opinion.weights import entropy, entropy_weights

if TYPE_CHECKING:
    from blackboard.opinion.belief import Belief

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


def __getattr__(name: str) -> object:
    """What is loaded when it is asked for: `Belief`, and `__version__`, which takes time to read from the package's metadata."""
    if name == "Belief":
        from blackboard.opinion.belief import Belief

        return Belief
    if name == "__version__":
        from importlib.metadata import version

        return version("cop-blackboard")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
