"""Rules whose result a minority of wrong sources cannot decide. Weights are equal by default: a wrong source may be sharp."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.errors import RuleError
from blackboard.opinion.agreement import coefficients
from blackboard.opinion.averages import Logarithmic, linear_pool
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.rules import Pooled, Rule, find, parameter, rule
from blackboard.opinion.vectors import from_logarithm, logarithm, shares

CLOSE = 1e-7  # two roots nearer than this differ by rounding alone
STEPS = 500  # of Weiszfeld's iteration, which converges linearly


@rule("median-log")
class MedianLog(Rule):
    """The cell-wise weighted median of the log beliefs, normalised (after Mitra, Richards, Sundaram, arXiv 1903.05817).

    Where exactly half of the weight is on either side, the median is the mean of the two logarithms. Idempotent; half of the weight
    is a veto. Contribution of an opinion: the mass of the cells in which it is the median, or half of that where it is one of two;
    opinions that are equal there share it by their weights. They sum to 1.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        flat, w = opinions.reshape(len(opinions), -1), shares(weights, len(opinions))
        order = np.argsort(flat, axis=0, kind="stable")
        reached = np.cumsum(w[order], axis=0)
        lower, upper = np.argmax(reached > 0.5 - 1e-9, axis=0), np.argmax(reached > 0.5 + 1e-9, axis=0)
        ascending = np.take_along_axis(flat, order, axis=0)
        logs, cells = logarithm(ascending), np.arange(flat.shape[1])
        # the median of ln P_i in each cell: the mean of the two in the middle, which are mostly one
        p = from_logarithm(0.5 * (logs[lower, cells] + logs[upper, cells]), self.name)
        counts = np.zeros(len(opinions))
        for middle in (lower, upper):
            equal = np.where(flat == ascending[middle, cells], w[:, np.newaxis], 0.0)
            counts += 0.5 * (equal / equal.sum(axis=0)) @ p
        return Pooled(p.reshape(opinions.shape[1:]), counts)


@rule("geometric-median")
class GeometricMedian(Rule):
    """The belief whose square root has the least weighted sum of distances to the opinions' square roots (Hellinger distances).

    It breaks down only when half of the weight lies; idempotent, no veto. Contribution of an opinion: the share of its root in the
    mix of roots that is the median.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        roots = np.sqrt(opinions).reshape(len(opinions), -1)
        mix = _median_mix(roots - roots.mean(axis=0), shares(weights, len(opinions)))
        p = (mix @ roots).reshape(opinions.shape[1:]) ** 2
        return Pooled(np.asarray(p / p.sum()), mix)


@rule("clique")
class Clique(Rule):
    """The rule `inner` for the largest set of opinions that agree in pairs; the others are left out.

    Two agree within a Bhattacharyya distance of the threshold `xi`, in nats (II-A.1). 2 is that of equally wide Gaussians 4
    sigma apart; honest ones exceed it in 2 of 100 cases (2-D). Where several sets are equally large, the result is the mean of
    their pools, which keeps the hypotheses of all. As a flat table it has the inner rule's parameters, too; `inner` is then its
    name. Contribution of an opinion: the share of the largest sets that it is in, 0 or 1 where there is one.
    """

    inner: Rule = field(default_factory=Logarithmic)
    "Name of the rule for those that agree; its parameters stand beside it."
    xi: float = parameter(default=2.0, above=0)
    "[nats] Bhattacharyya distance within which two opinions agree."

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.inner, Clique):
            raise RuleError("inner", "a clique of a clique gains nothing; name another rule")

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        cliques = largest_cliques(opinions, self.xi)
        pools = [
            self._within(opinions[list(c)], None if weights is None else weights[list(c)], cell_ratio) for c in cliques
        ]
        members = np.array([[float(i in clique) for i in range(len(opinions))] for clique in cliques])
        return Pooled(
            linear_pool(np.stack([pooled.p for pooled in pools])),
            members.mean(axis=0),
            np.mean([pooled.components for pooled in pools], axis=0),
            if_independent=lambda: linear_pool(np.stack([pooled.claim() for pooled in pools])),
        )

    def _within(self, opinions: Array, weights: Array | None, cell_ratio: float) -> Pooled:
        own = self.inner.weigh(opinions, cell_ratio) if weights is None else weights
        return self.inner.pool(opinions, own, cell_ratio=cell_ratio)

    def cell_ratio(self, grid: Grid) -> float:
        return self.inner.cell_ratio(grid)

    def in_force(self) -> dict[str, str | float]:
        inner = self.inner.in_force()
        return {"rule": self.name, "inner": inner.pop("rule"), "xi": self.xi, **inner}

    @classmethod
    def keys(cls, table: Mapping[str, Any]) -> tuple[str, ...]:
        return ("inner", "xi", *cls._inner(table).keys(table))

    @classmethod
    def read(cls, table: Mapping[str, Any]) -> Clique:
        own = {key: value for key, value in table.items() if key == "xi"}
        rest = {key: value for key, value in table.items() if key not in ("inner", "xi")}
        return cls(inner=cls._inner(table).read(rest), **own)

    @staticmethod
    def _inner(table: Mapping[str, Any]) -> type[Rule]:
        name = table.get("inner", Logarithmic.name)
        if name == Clique.name:
            raise RuleError("inner", "a clique of a clique gains nothing; name another rule")
        try:
            return find(name)
        except RuleError as error:
            raise RuleError("inner", error.cure) from None


def _median_mix(points: Array, weights: Array) -> Array:
    """The geometric median of points (N, dimensions) as their convex combination, shape (N,), by Weiszfeld's iteration.

    Only inner products are needed. A point to which the others pull with less than its own weight is the median itself; there
    the iteration would crawl, so this is looked at first.
    """
    n = len(points)
    inner = points @ points.T
    each = np.eye(n)
    for i in range(n):
        distances = _lengths(each - each[i], inner)
        others = distances > CLOSE
        pull = np.where(others, weights, 0.0) / np.maximum(distances, CLOSE)
        if _lengths((pull - pull.sum() * each[i])[np.newaxis], inner)[0] < weights[~others].sum() * (1.0 - 1e-9):
            return np.asarray(each[i])
    mix = weights
    # Weiszfeld: each point is weighed by w_i / |point - median|
    for _ in range(STEPS):
        pull = weights / np.maximum(_lengths(mix - each, inner), CLOSE)
        before, mix = mix, pull / pull.sum()
        if np.abs(mix - before).max() < 1e-12:
            break
    return mix


def _lengths(steps: Array, inner: Array) -> Array:
    """Lengths of vectors (M, N) given in points with these inner products, shape (M,)."""
    return np.asarray(np.sqrt(np.maximum(((steps @ inner) * steps).sum(axis=1), 0.0)))


def largest_cliques(opinions: npt.ArrayLike, xi: float) -> list[tuple[int, ...]]:
    """All largest sets of opinions that agree in pairs, Bhattacharyya distance <= xi nats (II-A.1), in ascending order.

    Usually one; several where sets are equally large. Steps grow exponentially with N only where agreement
    is made up to be as intransitive as possible.
    """
    near = coefficients(opinions) >= math.exp(-xi) * (1.0 - 1e-12)  # (II-A.1): -ln coefficient <= xi
    largest: list[tuple[int, ...]] = [()]

    def grow(clique: tuple[int, ...], candidates: list[int]) -> None:
        if not candidates:
            if len(clique) > len(largest[0]):
                largest.clear()
            largest.append(clique)
        for i, one in enumerate(candidates):
            if len(clique) + len(candidates) - i < max(1, len(largest[0])):
                break  # too few are left
            grow((*clique, one), [other for other in candidates[i + 1 :] if near[one, other]])

    grow((), list(range(len(near))))
    return [clique for clique in largest if len(clique) == len(largest[0])]
