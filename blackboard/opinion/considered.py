"""Which cells and components of the Cooperative Opinion Pool can matter, so that only these are computed.

With weights that sum to 1, C_q (V-.2) of a cell is at most (N-1 over q-1) T^q, where T is the largest opinion there: each opinion is in
(N-1 over q-1) subsets of q. The exact components at the N peaks of the opinions show what the best cell reaches at least. So a
threshold for T says of a cell that none of its components comes within the margin of the best, and the largest T of all says the same
of a component. The margin is chosen such that all that is left out is together less than the rounding of a double.

Beliefs that were on the wire have an even floor: cells in which every opinion is at its least are alike, and one stands for all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blackboard.opinion.components import log_components
from blackboard.opinion.grid import Array

ROUNDING = 53 * math.log(2.0)  # nats from 1 to the rounding of a double
MANY = 0.5  # of all cells: with more left, they are not copied out, but alike ones are looked for

Cells = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Bounds:
    """What opinions (N, cells) reach at least and at most, from their largest in each cell and the components at their peaks.

    first: the first q of which a component can matter in COP; the others are left out. reached: ln C_q at the best peak, shape (N,).
    """

    top: Array  # (cells,): the largest opinion in each cell
    subsets: Array  # (N,): the logarithm of (N-1 over q-1), minus q ln(v_ref / v_cell)
    reached: Array
    alpha: Array
    margin: float
    first: int

    def heavy(self, power: float = 1.0) -> float:
        """The largest opinion that a cell needs, so that C_q^(power / alpha_q) can matter for some q."""
        best = float((self.reached / self.alpha).max()) - self.margin / power
        return self._least(self.alpha * best)

    def wanted(self, exponents: Array) -> float:
        """The largest opinion that a cell needs, so that norm(C_q^(e_q)) can matter for some q, exponents e (N,)."""
        return self._least(self.reached - self.margin / exponents)

    def _least(self, logs: Array) -> float:
        """The largest opinion with which ln C_q can be above logs[q] for some q that matters."""
        return math.exp(min(0.0, float(_largest(logs, self.subsets)[self.first - 1 :].min())))


def bounds(p: Array, weights: Array | None, alpha: Array, cell_ratio: float = 1.0) -> Bounds:
    """The bounds for opinions (N, cells) with weights (N,), the alphas (N,) and cell_ratio = v_ref / v_cell of the pool."""
    n, cells = p.shape
    q = np.arange(1.0, n + 1)
    choices = np.concatenate([[0.0], np.cumsum(np.log((n - q[:-1]) / q[:-1]))])  # ln (N-1 over q-1)
    subsets = choices + q * math.log(cell_ratio)
    reached = log_components(p[:, np.unique(p.argmax(axis=1))], weights, cell_ratio).max(axis=1)
    margin = ROUNDING + math.log(n * cells)
    top = p.max(axis=0)
    needed = _largest(alpha * (float((reached / alpha).max()) - margin), subsets)
    first = int(np.argmax(needed <= math.log(top.max()))) + 1
    return Bounds(top, subsets, reached, alpha, margin, first)


def above(top: Array, least: float) -> Cells | slice:
    """The cells whose largest opinion is at least `least`; all of them, as a slice, where they are many."""
    near = top >= least
    return slice(None) if np.count_nonzero(near) > MANY * len(top) else np.flatnonzero(near)


def alike(p: Array) -> npt.NDArray[np.bool_]:
    """The cells in which every one of the opinions (N, cells) is at its least, shape (cells,): their columns are equal."""
    return np.asarray((p == p.min(axis=1, keepdims=True)).all(axis=0))


def _largest(logs: Array, subsets: Array) -> Array:
    """ln T for which the bound (N-1 over q-1) T^q on C_q is exp(logs), shape (N,)."""
    return np.asarray((logs - subsets) / np.arange(1.0, len(logs) + 1))
