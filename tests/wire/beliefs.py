"""Beliefs of every kind that the coding must bear, for property tests."""

import math

import numpy as np
from hypothesis import strategies as st

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.arrays import STEP

KINDS = ("random", "sparse", "one-hot", "modes", "flat", "tails", "brink")


@st.composite
def beliefs(draw: st.DrawFn) -> Belief:
    """A belief of some kind on a 1-D, 2-D or 3-D grid of at most 400 cells."""
    ndim = draw(st.integers(1, 3))
    most = {1: 400, 2: 20, 3: 7}[ndim]
    shape = tuple(draw(st.integers(1, most)) for _ in range(ndim))
    grid = Grid(shape, draw(st.sampled_from([1.0, 0.1])), tuple(float(i) for i in range(ndim)), "m")
    kind = draw(st.sampled_from(KINDS))
    return belief_of(kind, grid, np.random.default_rng(draw(st.integers(0, 1 << 32))))


def belief_of(kind: str, grid: Grid, rng: np.random.Generator) -> Belief:
    shape = grid.shape
    if kind == "random":
        mass = rng.random(shape)
    elif kind == "sparse":
        mass = rng.random(shape) * (rng.random(shape) < 0.1)
    elif kind == "one-hot":
        mass = np.zeros(shape)
    elif kind == "modes":
        mass = _bump(grid, rng) + 1e-4 * _bump(grid, rng)
    elif kind == "flat":
        mass = 1.0 + 1e-3 * rng.random(shape)
    elif kind == "tails":
        mass = np.exp(-700.0 * rng.random(shape))
    else:  # all that is left out just misses being kept, all that is kept rounds up
        mass = np.exp(np.where(rng.random(shape) < rng.random(), -254.501, -0.499) * STEP)
        mass.flat[0] = 1.0
    mass.flat[rng.integers(mass.size)] = mass.max() or 1.0
    return Belief(grid, mass / math.fsum(mass.ravel()))


def _bump(grid: Grid, rng: np.random.Generator) -> Array:
    exponent: Array = np.zeros(grid.shape)
    for axis, n in zip(np.indices(grid.shape, sparse=True), grid.shape, strict=True):
        exponent = exponent - 0.5 * ((axis - n * rng.random()) / (0.3 + 3 * rng.random())) ** 2
    return np.exp(exponent)
