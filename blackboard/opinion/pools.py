"""Every rule by its name, all under one signature: rule(opinions, weights=None, *, its own parameters).

`opinions` is (N, *grid shape), each non-negative and summing to 1; the result has the grid's shape and sums to 1.
Which rule does what (idempotent: an echo gains nothing; veto: one zero rules a cell out):

    linear            idempotent, no veto    keeps every hypothesis, claims little
    logarithmic       veto                   the Bayes product: right for independent opinions, captured by one liar
    geometric         idempotent, veto       safe where correlation is unknown, captured by one liar
    chernoff          idempotent, veto       the same with the sharpest weights, believes the sharpest liar
    hoelder           idempotent             power means, from harmonic (a = -1, veto) to linear (a = 1)
    harmonic          idempotent, veto       kin of inverse covariance intersection
    cooperative       no veto                COP (V-.2): bears one liar of five, claims too much
    calibrated        no veto                COP to a power: claims less
    coalition         no veto                COP chooses the coalitions, their means or products are mixed
    median-log        idempotent             bears a lying minority, vetoed by half
    geometric-median  idempotent, no veto    bears a lying minority
    clique            as its inner rule      the largest agreeing clique in front of any rule
    channel-filter    veto                   the product without known common information
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.opinion.averages import (
    channel_filter_pool,
    geometric_pool,
    harmonic_pool,
    hoelder_pool,
    linear_pool,
    logarithmic_pool,
)
from blackboard.opinion.chernoff import chernoff, chernoff_pool
from blackboard.opinion.cooperative import (
    calibrated_pool,
    coalition_pool,
    cooperative_components,
    cooperative_pool,
)
from blackboard.opinion.grid import Array
from blackboard.opinion.robust import geometric_median_pool, largest_cliques, median_log_pool
from blackboard.opinion.vectors import checked, checked_weights, positive
from blackboard.opinion.weights import entropy_weights

__all__ = [
    "ENTROPY_WEIGHTED",
    "POOLS",
    "Pool",
    "chernoff",
    "cooperative_components",
    "cooperative_pool",
    "fuse",
    "linear_pool",
    "logarithmic_pool",
    "parameters",
]

Pool = Callable[..., Array]


def clique_pool(
    opinions: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    *,
    inner: str = "logarithmic",
    xi: float = 2.0,
    **own: Any,
) -> Array:
    """The rule `inner` behind a gate: it pools only the largest set of opinions that agree in pairs.

    Two agree within a Bhattacharyya distance of `xi` nats (II-A.1): 2 is that of equally wide Gaussians 4 sigma apart, which
    honest ones exceed in 2 of 100 cases (2-D). Where several sets are equally large, nothing says which one is right, and the
    mean of their pools keeps them all. weights None: as `fuse` takes them for the inner rule, within the set; `own` are the
    inner rule's parameters. Raises as `fuse`.
    """
    stack = checked(opinions)
    if inner == "clique":
        raise ValueError("clique: the inner rule cannot be clique again; name another one")
    given = None if weights is None else checked_weights(weights, len(stack))
    pooled = []
    for clique in largest_cliques(stack, positive(xi, "xi")):
        members = list(clique)
        if given is None:
            pooled.append(fuse(inner, stack[members], **own))
        else:
            pooled.append(_call(inner, stack[members], given[members], own))
    return linear_pool(np.stack(pooled))


POOLS: dict[str, Pool] = {
    "linear": linear_pool,
    "logarithmic": logarithmic_pool,
    "geometric": geometric_pool,
    "chernoff": chernoff_pool,
    "hoelder": hoelder_pool,
    "harmonic": harmonic_pool,
    "cooperative": cooperative_pool,
    "calibrated": calibrated_pool,
    "coalition": coalition_pool,
    "median-log": median_log_pool,
    "geometric-median": geometric_median_pool,
    "clique": clique_pool,
    "channel-filter": channel_filter_pool,
}

#: The paper's rules take (III-A.1) as weights. The product's are 1 each, Chernoff finds its own, all others trust nobody's
#: claim to be certain: weights are theirs only where a caller gives them.
ENTROPY_WEIGHTED = frozenset({"linear", "cooperative", "calibrated", "coalition"})


def fuse(
    rule: str,
    opinions: npt.ArrayLike,
    *,
    k: float = 2.0,
    gamma: float = 0.5,
    cell_ratio: float = 1.0,
    **more: Any,
) -> Array:
    """Pool opinions (N, *grid shape) by the name of a rule, with the weights (III-A.1) where the rule takes them.

    k, gamma and cell_ratio are a board's settings and passed on to rules that have them; `more` are parameters of this very
    rule (and of the one behind the gate of "clique"). Raises OpinionError for bad opinions and where a veto leaves no cell,
    ValueError for an unknown rule or parameter.
    """
    known = parameters(rule, more.get("inner"))
    unknown = sorted(set(more) - known)
    if unknown:
        raise ValueError(f"rule {rule!r} has no parameter {unknown[0]!r}; it has {', '.join(sorted(known)) or 'none'}")
    stack = checked(opinions)
    weights = entropy_weights(stack, k, cell_ratio=cell_ratio) if rule in ENTROPY_WEIGHTED else None
    return _call(rule, stack, weights, {"k": k, "gamma": gamma, "cell_ratio": cell_ratio, **more})


@cache
def parameters(rule: str, inner: str | None = None) -> frozenset[str]:
    """The names of a rule's own parameters, and of those of the rule behind its gate; ValueError for an unknown rule."""
    if rule not in POOLS:
        raise ValueError(f"rule {rule!r} is none of {', '.join(sorted(POOLS))}")
    own = inspect.signature(POOLS[rule]).parameters.values()
    names = frozenset(p.name for p in own if p.kind is inspect.Parameter.KEYWORD_ONLY)
    return names | parameters(inner or "logarithmic") if rule == "clique" and inner != "clique" else names


def _call(rule: str, stack: Array, weights: Array | None, offered: dict[str, Any]) -> Array:
    """The rule, with what it has of the parameters offered."""
    has = parameters(rule, offered.get("inner"))
    if rule == "clique":
        has |= {"k", "gamma", "cell_ratio"}  # for the weights behind the gate, too
    return POOLS[rule](stack, weights, **{name: offered[name] for name in has & offered.keys()})
