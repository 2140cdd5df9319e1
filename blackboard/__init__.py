"""A Zenoh-based distributed blackboard for robot teams. Here: the pooling of opinions, which needs numpy alone."""

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import POOLS, cooperative_pool, linear_pool, logarithmic_pool
from blackboard.opinion.weights import entropy, entropy_weights

__all__ = [
    "POOLS",
    "Grid",
    "OpinionError",
    "cooperative_pool",
    "entropy",
    "entropy_weights",
    "linear_pool",
    "logarithmic_pool",
]


def __getattr__(name: str) -> str:
    """`blackboard.__version__`, read from the package's metadata when it is asked for, because reading it takes time."""
    if name == "__version__":
        from importlib.metadata import version

        return version("cop-blackboard")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
