"""Every rule by its name, all under one signature: rule(opinions, weights=None, *, its own parameters).

`opinions` is (N, *grid shape), each non-negative and summing to 1; the result has the grid's shape and sums to 1.
Which rule does what (idempotent: equal opinions give the same again; veto: one zero rules a cell out):

    linear            idempotent, no veto    keeps every hypothesis, vague
    logarithmic       veto                   the Bayes product: right for independent opinions; one wrong sharp opinion decides
    geometric         idempotent, veto       safe where correlation is unknown; one wrong sharp opinion decides
    chernoff          idempotent, veto       the same with the sharpest weights; the sharpest opinion decides
    hoelder           idempotent             power means, from harmonic (a = -1, veto) to linear (a = 1)
    harmonic          idempotent, veto       related to inverse covariance intersection
    cooperative       no veto                COP (V-.2): withstands one wrong opinion of five, over-confident
    calibrated        no veto                COP to a power: less confident
    coalition         no veto                COP chooses the coalitions, their means or products are mixed
    median-log        idempotent             withstands a wrong minority; half of the weight is a veto
    geometric-median  idempotent, no veto    withstands a wrong minority
    clique            as its inner rule      any rule, for the largest set of opinions that agree in pairs
    channel-filter    veto                   the product without known common information
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError, RuleError, VetoError
from blackboard.opinion import rules
from blackboard.opinion.averages import Linear, channel_filter_pool, linear_pool, logarithmic_pool
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.cooperative import cooperative_pool
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.rules import Pooled, Rule, returned
from blackboard.opinion.vectors import TOLERANCE, checked

__all__ = ["POOLS", "Pool", "chernoff", "cooperative_pool", "fuse", "fuse_belief", "linear_pool", "logarithmic_pool"]

Pool = Callable[..., Array]

#: Functions with arguments that are no parameters of a rule.
_SPECIAL: dict[str, Pool] = {"channel-filter": channel_filter_pool}


class _Pools(Mapping[str, Pool]):
    """Every rule's function, those of users and plug-ins included; a plug-in is loaded when it is looked up."""

    def __getitem__(self, name: str) -> Pool:
        if name in _SPECIAL:
            return _SPECIAL[name]
        try:
            cls = rules.find(name)
        except RuleError as error:
            raise KeyError(name) from error

        def pool(
            opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, cell_ratio: float = 1.0, **own: Any
        ) -> Array:
            return rules.pooled(rules.read_rule({"rule": cls.name, **own}), opinions, weights, cell_ratio)

        return pool

    def __iter__(self) -> Iterator[str]:
        return iter(rules.names())

    def __len__(self) -> int:
        return len(list(iter(self)))


POOLS: Mapping[str, Pool] = _Pools()


def fuse(rule: Rule, opinions: npt.ArrayLike, grid: Grid) -> Pooled:
    """Pool opinions (N, *grid shape) as a board does: with the weights that the rule gives, and with an answer also to a veto.

    Where a veto leaves no cell, all hypotheses stay: the linear pool with weights 1 / H^2 (III-A.1), and `outcome` says so. Raises
    OpinionError for bad opinions, or those of another grid; ValueError where the rule returns what is no `Pooled` of them.
    """
    stack, ratio = _on(grid, opinions), rule.cell_ratio(grid)
    try:
        return _checked_result(rule, rule.pool(stack, rule.weigh(stack, ratio), cell_ratio=ratio), stack)
    except VetoError:
        instead = Linear()
        return replace(instead.pool(stack, instead.weigh(stack, 1.0)), outcome="veto: linear")


def fuse_belief(rule: Rule, opinions: npt.ArrayLike, grid: Grid) -> Array:
    """The belief of `fuse` alone, in the grid's shape; faster where the story is not wanted. Raises as `fuse`."""
    stack, ratio = _on(grid, opinions), rule.cell_ratio(grid)
    try:
        p = rule.belief(stack, rule.weigh(stack, ratio), cell_ratio=ratio)
    except VetoError:
        instead = Linear()
        return instead.belief(stack, instead.weigh(stack, 1.0))
    return _checked_result(rule, Pooled(p, np.zeros(len(stack))), stack).p


def _on(grid: Grid, opinions: npt.ArrayLike) -> Array:
    """The opinions, checked, which are on this grid; OpinionError otherwise."""
    stack = checked(opinions)
    if stack.shape[1:] != grid.shape:
        raise OpinionError(f"opinions of shape {stack.shape} for a grid of {grid.shape}; give (N, *grid shape)")
    return stack


def _checked_result(rule: Rule, pooled: Pooled, stack: Array) -> Pooled:
    """What a rule returned, after checking it against `Pooled`; ValueError says what is wrong with it."""
    pooled, n, shape = returned(rule, pooled), len(stack), stack.shape[1:]
    wrong = ""
    if np.shape(pooled.p) != shape:
        wrong = f"a belief of shape {np.shape(pooled.p)} for a grid of {shape}"
    elif not (pooled.p.min() >= 0 and abs(pooled.p.sum() - 1.0) <= TOLERANCE):
        wrong = f"a belief that sums to {pooled.p.sum():.9g}, its least value being {pooled.p.min():g}"
    elif np.shape(pooled.weights) != (n,) or not (np.isfinite(pooled.weights).all() and pooled.weights.min() >= 0):
        wrong = f"weights {np.asarray(pooled.weights)} for {n} opinions; give one finite number of at least 0 for each"
    elif pooled.components.ndim != 1 or len(pooled.components) > n or not np.isfinite(pooled.components).all():
        wrong = f"components {pooled.components} for {n} opinions; give at most {n} finite shares, or none"
    if wrong:
        raise ValueError(f"rule {rule.name!r} returned {wrong}")
    return pooled
