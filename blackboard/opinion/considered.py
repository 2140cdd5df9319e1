"""Which cells and components of the Cooperative Opinion Pool can matter, so that only these are computed.

With weights that sum to 1, C_q (V-.2) of a cell is at most (N-1 over q-1) T^q, where T is the largest opinion there, for each is in
(N-1 over q-1) subsets of q. The exact components at the N peaks of the opinions show what the best cell reaches at least. So a
threshold for T says of a cell that none of its components comes within the margin of the best, and the largest T of all says the same
of a component. The margin is chosen such that all that is left out is together less than the rounding of a double.

Beliefs that were on the wire have an even floor: cells in which every opinion is at its least are alike, and one stands for all.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blackboard.opinion.components import log_components, memberships, relative_to_peak
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import positive

ROUNDING = 53 * math.log(2.0)  # nats from 1 to the rounding of a double
NOTHING = 1e-13  # of all mass: what a component with less can change is far below what its logarithm is rounded by
MANY = 0.5  # of all cells: where more are left, they are not copied out
#: Steps of the recursion: where there are fewer, one pass costs less than looking first which components have mass.
AT_ONCE = 1 << 18
SMALL = 4096  # a grid of so many cells is pooled as a whole: bounds would take longer than they save

Places = npt.NDArray[np.intp]  # in ascending order


@dataclass(frozen=True, eq=False)
class Cells:
    """Some of the `size` cells of a grid: `where` they are, None for all; the last one stands for all `others`, which are alike."""

    size: int
    where: Places | None = None
    others: Places = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def only(self, chosen: Places) -> "Cells":
        """The chosen of these cells, in ascending order."""
        if self.where is None:
            return Cells(self.size, chosen)
        last = len(chosen) > 0 and chosen[-1] == len(self.where) - 1
        return Cells(self.size, self.where[chosen], self.others if last else self.others[:0])

    def of(self, values: Array) -> Array:
        """These cells of values (N, size), shape (N, cells)."""
        return values if self.where is None else values.take(self.where, axis=1)

    def normalised(self, values: Array) -> Array:
        """Values (cells,) divided by their sum on the whole grid."""
        total = values.sum()
        if len(self.others):
            total += (len(self.others) - 1) * values[-1]
        return np.asarray(values / total)

    def counted(self, values: Array) -> Array:
        """Values (N, cells) in which the last one counts for all that are alike."""
        if len(self.others):
            values = values.copy()
            values[:, -1] *= len(self.others)
        return values

    def spread(self, values: Array) -> Array:
        """Values (cells,) on the whole grid, (size,): 0 in the cells that are left out."""
        if self.where is None:
            return values
        full = np.zeros(self.size)
        if len(self.others):
            full[self.others] = values[-1]
        full[self.where] = values
        return full


@dataclass(frozen=True, eq=False)
class Chosen:
    """What COP makes of opinions in the cells that can matter: arrays (N, cells), or from q = first on, (N - first + 1, cells).

    opinions: as they count in the choice. logs: ln C_q. terms: ln C_q^(1/alpha_q). wide: for norm(C_q^(e_q)), where that is
    asked for and takes more cells.
    """

    opinions: Array
    weights: Array | None
    first: int
    logs: Array
    terms: Array
    cells: Cells
    wide: "Wide | None" = None

    @cached_property
    def mass(self) -> Array:
        """C_q^(1/alpha_q) relative to the largest of all."""
        return np.asarray(np.exp(self.terms - self.terms.max()))

    @cached_property
    def masses(self) -> Array:
        """The sum of `mass` over the grid, shape (N - first + 1,)."""
        return np.asarray(self.cells.counted(self.mass).sum(axis=1))

    def belief(self) -> Array:
        """COP itself, on the whole grid, shape (size,)."""
        return self.cells.spread(self.cells.normalised(self.mass.sum(axis=0)))  # (V-.2)

    def members(self) -> Array:
        """The mass of the coalitions that each opinion is in, shape (N,)."""
        return memberships(self.opinions, self.weights, self.cells.counted(self.mass), self.first, self.cells.size)

    def shares(self) -> Array:
        """The share of each component in all mass, shape (N,)."""
        return np.concatenate([np.zeros(self.first - 1), self.masses / self.masses.sum()])


@dataclass(frozen=True, eq=False)
class Wide:
    """Ln C_q, q = first..N, (N - first + 1, cells), in the cells that can matter to norm(C_q^(e_q)); q below `first` has no mass."""

    first: int
    logs: Array
    cells: Cells


def choose(
    opinions: Array,
    weights: Array | None,
    alpha: Array,
    cell_ratio: float,
    *,
    gate: float | None = None,
    exponents: Array | None = None,
    power: float = 1.0,
) -> Chosen:
    """What COP makes of checked opinions (N, *grid shape), in the cells that can matter.

    With a gate each opinion counts with mass exp(-gate) at its peak. The cells are those that can matter to C_q^(power / alpha_q),
    and where exponents e (N,) are given, in `wide`, to norm(C_q^(e_q)).
    """
    p = opinions.reshape(len(opinions), -1)
    large = p.shape[1] > SMALL
    # norm(C_q^(e_q)) is wide, and only cells that are alike can be left out of it; C_q^(1/alpha_q) is far narrower than its opinions
    cells = unlike(p) if large and exponents is not None else Cells(p.shape[1])
    taken = cells.of(p)
    if gate is not None:
        taken = relative_to_peak(taken, gate)
    if not large:
        return _chosen(taken, weights, alpha, cell_ratio, 1, cells)
    within = bounds(taken, weights, alpha, positive(cell_ratio, "cell_ratio"))
    least = within.heavy(power)
    at_once = exponents is not None and len(taken) * taken.size <= AT_ONCE
    if exponents is not None and at_once:
        least = min(least, within.wanted(exponents))
    some, some_cells = _kept(taken, cells, within.top >= least)
    chosen = _chosen(some, weights, alpha, cell_ratio, within.first, some_cells)
    if exponents is None or at_once:
        return chosen
    first = chosen.first + int(np.argmax(chosen.masses > NOTHING * chosen.masses.sum()))
    some, some_cells = _kept(taken, cells, within.top >= replace(within, first=first).wanted(exponents))
    if some is chosen.opinions:
        return replace(chosen, wide=Wide(first, chosen.logs[first - chosen.first :], some_cells))
    return replace(chosen, wide=Wide(first, log_components(some, weights, cell_ratio, first), some_cells))


def _chosen(
    opinions: Array, weights: Array | None, alpha: Array, cell_ratio: float, first: int, cells: Cells
) -> Chosen:
    logs = log_components(opinions, weights, cell_ratio, first)
    terms = logs / alpha[first - 1 :, np.newaxis]  # (V-.2): ln C_q^(1/alpha_q)
    return Chosen(opinions, weights, first, logs, terms, cells)


def _kept(taken: Array, cells: Cells, wanted: npt.NDArray[np.bool_]) -> tuple[Array, Cells]:
    """Opinions (N, cells) in the wanted cells, or in all where most are."""
    chosen = np.flatnonzero(wanted)
    return (taken, cells) if len(chosen) > MANY * len(wanted) else (taken.take(chosen, axis=1), cells.only(chosen))


@dataclass(frozen=True, eq=False)
class Bounds:
    """What opinions (N, cells) reach at least and at most, from their largest in each cell and the components at their peaks.

    top (cells,): the largest opinion in each cell. subsets (N,): ln of (N-1 over q-1) (v_ref / v_cell)^q. reached (N,): ln C_q at the
    best of the peaks. margin: in nats. first: the first q whose component can matter in COP.
    """

    top: Array
    subsets: Array
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
        return math.exp(min(0.0, float(_needed(logs, self.subsets)[self.first - 1 :].min())))


def bounds(p: Array, weights: Array | None, alpha: Array, cell_ratio: float = 1.0) -> Bounds:
    """The bounds for opinions (N, cells) with weights and alphas (N,); cell_ratio = v_ref / v_cell."""
    n, cells = p.shape
    q = np.arange(1.0, n + 1)
    choices = np.concatenate([[0.0], np.cumsum(np.log((n - q[:-1]) / q[:-1]))])  # ln (N-1 over q-1)
    subsets = choices + q * math.log(cell_ratio)
    top = p.max(axis=0)
    reached = log_components(p[:, np.unique(p.argmax(axis=1))], weights, cell_ratio).max(axis=1)
    margin = ROUNDING + math.log(n * cells)
    needed = _needed(alpha * (float((reached / alpha).max()) - margin), subsets)
    first = int(np.argmax(needed <= math.log(top.max()))) + 1
    return Bounds(top, subsets, reached, alpha, margin, first)


def unlike(p: Array) -> Cells:
    """All cells, and where they are many without those that are alike: every one of the opinions (N, cells) is at its least there."""
    same = np.ones(p.shape[1], dtype=bool)
    for opinion in p:  # one after another, as each fits in the processor's cache
        same &= opinion == opinion.min()
        if np.count_nonzero(same) < (1.0 - MANY) * len(same):
            return Cells(len(same))
    others = np.flatnonzero(same)
    return Cells(len(same), np.append(np.flatnonzero(~same), others[0]), others)


def _needed(logs: Array, subsets: Array) -> Array:
    """Ln T for which the bound (N-1 over q-1) T^q on C_q is exp(logs), shape (N,)."""
    return np.asarray((logs - subsets) / np.arange(1.0, len(logs) + 1))
