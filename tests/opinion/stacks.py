"""Opinions of every kind that a law must hold for, made from a drawn seed."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from blackboard.opinion.grid import Array
from blackboard.opinion.laws import KINDS, SHAPES
from blackboard.opinion.laws import draw as make

__all__ = ["KINDS", "SHAPES", "few", "make", "stacks", "weighted"]

few = settings(max_examples=15)


@st.composite
def stacks(draw: st.DrawFn, kinds: tuple[str, ...] = KINDS, least: int = 1, most: int = 5) -> Array:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, shape = draw(st.integers(least, most)), draw(st.sampled_from(SHAPES))
    return make(draw(st.sampled_from(kinds)), n, shape, rng)


@st.composite
def weighted(draw: st.DrawFn, kinds: tuple[str, ...] = KINDS, most: int = 5) -> tuple[Array, Array]:
    """A stack and a positive weight for each of its opinions."""
    stack = draw(stacks(kinds, most=most))
    weights = draw(st.lists(st.floats(0.01, 10), min_size=len(stack), max_size=len(stack)))
    return stack, np.array(weights)
