"""The Cooperative Opinion Pool, P = K sum_q C_q^(1/alpha_q) (V-.2), and the rules that are made of its components."""

from functools import partial
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from blackboard.opinion.components import alphas, triangular_alphas
from blackboard.opinion.considered import NOTHING, Chosen, Wide, choose
from blackboard.opinion.grid import Array
from blackboard.opinion.rules import EntropyWeighted, Pooled, parameter, pooled, rule

#: The independence of a coalition of which nothing is known.
CAUTIOUS = 0.2


@rule("cooperative")
class Cooperative(EntropyWeighted):
    """COP (V-.2): each cell sums over all coalitions that may be right. No veto, and over-confident (docs/paper.md).

    gamma is the ratio of the alphas (V-C). Contribution of an opinion: the mass of the coalitions that it is in, from 0 to 1.
    """

    gamma: float = parameter(default=0.5, above=0, most=1)
    "[factor] Ratio of the alphas (V-C): how much a larger coalition is preferred."

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        chosen = self._choose(opinions, weights, cell_ratio)
        return Pooled(chosen.belief().reshape(opinions.shape[1:]), chosen.members(), chosen.shares())

    def belief(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Array:
        return self._choose(opinions, weights, cell_ratio).belief().reshape(opinions.shape[1:])

    def _choose(self, opinions: Array, weights: Array | None, cell_ratio: float) -> Chosen:
        return choose(opinions, weights, alphas(len(opinions), self.gamma), cell_ratio)


@rule("calibrated")
class Calibrated(EntropyWeighted):
    """COP to a power: the same winner, claiming less. The default power alpha_N leaves C_N with exponent 1, the product.

    Contribution of an opinion: as in `Cooperative`.
    """

    gamma: float = parameter(default=0.5, above=0, most=1, tried=(0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9))
    "[factor] Ratio of the alphas (V-C): how much a larger coalition is preferred."
    power: float | None = parameter(default=None, above=0, tried=(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0))
    "[factor] Exponent of the result; alpha_N where it is not given."

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        alpha = alphas(len(opinions), self.gamma)
        power = float(alpha[-1]) if self.power is None else self.power
        chosen = choose(opinions, weights, alpha, cell_ratio, power=power)
        # (sum_q C_q^(1/alpha_q))^power
        logs = power * np.logaddexp.reduce(chosen.terms, axis=0)
        p = chosen.cells.spread(chosen.cells.normalised(np.exp(logs - logs.max())))
        return Pooled(p.reshape(opinions.shape[1:]), chosen.members(), chosen.shares())


@rule("coalition")
class Coalition(EntropyWeighted):
    """sum_q m_q norm(C_q^(e_q)): COP only chooses the coalitions, by the mass m_q of component q in it. The default of a board.

    Within a coalition of q opinions e_q = q^-(1 - independence): 0 is the geometric mean of its members, which is safe when they
    share information; 1 is their product, right when they are independent; "learn" is 0.2 until a board has learned how far its
    sources may be believed (`blackboard.board.learning`). gate, in nats: what it may cost an opinion to agree
    with the others (docs/paper.md, "The gate"); gamma instead of it: the paper's ratio of the alphas (V-C). Neither: gate = 4.
    Contribution of an opinion: as in `Cooperative`.
    """

    exclusive: ClassVar[tuple[str, ...]] = ("gate", "gamma")

    gamma: float | None = parameter(default=None, above=0, most=1)
    "[factor] Ratio of the alphas (V-C), instead of `gate`."
    gate: float | None = parameter(default=None, above=0, tried=(1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 15.0))
    "[nats] What it may cost an opinion to agree with the others; 4 where neither this nor `gamma` is given."
    independence: float | Literal["learn"] = parameter(
        default="learn", least=0, most=1, words=("learn",), tried=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
    )
    "[share] How independent the members of a coalition are: 0 is their geometric mean, 1 their product; learn: finds out."

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gamma is None and self.gate is None:
            object.__setattr__(self, "gate", 4.0)

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        if len(opinions) == 1:
            return Pooled(_alone(opinions), np.ones(1), np.ones(1))
        chosen = self._choose(opinions, weights, cell_ratio)
        mixed = partial(_mixed, chosen, shape=opinions.shape[1:])
        independence = self._independence()
        return Pooled(
            mixed(independence),
            chosen.members(),
            chosen.shares(),
            if_independent=None if independence == 1.0 else partial(mixed, 1.0),
        )

    def belief(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Array:
        if len(opinions) == 1:
            return _alone(opinions)
        return _mixed(self._choose(opinions, weights, cell_ratio), self._independence(), shape=opinions.shape[1:])

    def _independence(self) -> float:
        return CAUTIOUS if self.independence == "learn" else self.independence

    def _choose(self, opinions: Array, weights: Array | None, cell_ratio: float) -> Chosen:
        """The coalitions, in the cells that can matter to them and to norm(C_q^(e_q)).

        With a gate every opinion counts relative to its own peak, with mass exp(-gate) there, so that a flat one is compatible
        with every other; and alpha_q grows as the triangular numbers. Then C_q^(1/alpha_q) falls behind C_{q-1}^(1/alpha_{q-1})
        where it costs the q-th opinion more than `gate` nats below its own peak to agree with the others, whatever N
        (docs/paper.md).
        """
        n = len(opinions)
        exponents = _exponents(n, self._independence())
        if self.gate is None:
            return choose(opinions, weights, alphas(n, self.gamma or 0.5), cell_ratio, exponents=exponents)
        return choose(opinions, weights, triangular_alphas(n), 1.0, gate=self.gate, exponents=exponents)


def cooperative_pool(
    opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, gamma: float = 0.5, cell_ratio: float = 1.0
) -> Array:
    """COP (V-.2) of opinions (N, *grid shape), in the grid's shape; each cell sums over all coalitions that may be right.

    weights (N,) are scaled to sum to 1, None means equal; gamma is the ratio of the alphas (V-C); cell_ratio = v_ref / v_cell
    expresses the opinions as mass per reference cell, so that the fused density is the same on every grid; 1 is the
    paper's formula. A reference cell wider than the sharpest opinion lets that opinion win alone: take a smaller one.
    COP has no veto, so some cell always survives. It is over-confident (docs/paper.md). Raises OpinionError.
    """
    return pooled(Cooperative(gamma=gamma), opinions, weights, cell_ratio)


def _exponents(n: int, independence: float) -> Array:
    """e_1..e_N, e_q = q^-(1 - independence), shape (N,)."""
    return np.array([float(q) ** (independence - 1.0) for q in range(1, n + 1)])


def _alone(opinions: Array) -> Array:
    """The only opinion, (1, *grid shape), which is C_1, normalised to the last digit."""
    return np.asarray(opinions[0] / opinions[0].sum())


def _mixed(chosen: Chosen, independence: float, *, shape: tuple[int, ...]) -> Array:
    """sum_q m_q norm(C_q^(e_q)) with e_q = q^-(1 - independence), as `shape`."""
    wide = chosen.wide or Wide(chosen.first, chosen.logs, chosen.cells)
    mass, total, cells = chosen.masses[wide.first - chosen.first :], chosen.masses.sum(), wide.cells
    exponents = _exponents(len(chosen.opinions), independence)[wide.first - 1 :]
    mixed = np.zeros(wide.logs.shape[1])
    for q in np.flatnonzero(mass > NOTHING * total):
        part = exponents[q] * wide.logs[q]
        part -= part.max()
        part = cells.normalised(np.exp(part, out=part))
        part *= mass[q] / total
        mixed += part
    return cells.spread(cells.normalised(mixed)).reshape(shape)
