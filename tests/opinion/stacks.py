"""Opinions of every kind that a law must hold for, made from a drawn seed."""

from __future__ import annotations

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from blackboard.opinion.grid import Array

few = settings(max_examples=15)

KINDS = ("random", "sparse", "one-hot", "near-zero", "identical", "mixed")
SHAPES = ((5,), (3, 4), (2, 2, 3))


def make(kind: str, n: int, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """A stack of n opinions, shape (n, *shape)."""
    if kind == "mixed":
        return np.stack([make(str(rng.choice(KINDS[:4])), 1, shape, rng)[0] for _ in range(n)])
    p = rng.random((n, *shape))
    if kind == "sparse":
        p *= rng.random(p.shape) < 0.4
    elif kind == "near-zero":
        p *= 10.0 ** -rng.uniform(0, 300, p.shape)
    elif kind == "identical":
        p[:] = p[0]
    flat = p.reshape(n, -1)
    chosen = rng.integers(flat.shape[1], size=n)
    if kind == "one-hot":
        flat[:] = 0.0
    flat[np.arange(n), chosen] += 0.5  # none is empty
    return np.asarray(p / flat.sum(axis=1).reshape(n, *(1,) * len(shape)))


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
