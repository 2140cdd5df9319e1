"""One fusion: the opinions about one subject in, the pooled belief and its whole story out. Pure.

independent opinions ── rule (COP) ──► first-hand ──┐
overlapping opinions ───────────────────────────────┴── Chernoff ──► fused
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from blackboard.config import BoardSection, RuleSection
from blackboard.errors import OpinionError
from blackboard.opinion.agreement import bhattacharyya_coefficient, conflict
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import (
    ENTROPY_WEIGHTED,
    chernoff,
    cooperative_components,
    fuse,
    linear_pool,
    parameters,
)
from blackboard.opinion.weights import entropy, entropy_weights
from blackboard.provenance import Opinion, split, union

#: Two overlapping beliefs whose Bhattacharyya coefficient is below this contradict each other (equal Gaussians 6 sigma apart).
CONTRADICTION = 0.01


@dataclass(frozen=True)
class Share:
    """What one opinion contributed: its weight among those pooled with it, and by which of the two steps."""

    opinion: Opinion
    weight: float
    how: str  # "independent" or "overlapping"


@dataclass(frozen=True, eq=False)
class Fusion:
    """The fused belief, what it rests on, and its first-hand part, which may be multiplied again."""

    belief: Belief
    ancestors: dict[str, float]
    firsthand: Opinion
    shares: list[Share]
    components: list[float] = field(default_factory=list)
    conflict: bool = False


def pool(stack: Array, grid: Grid, rule: RuleSection) -> Array:
    """Pool opinions (N, *grid shape) by a rule with its parameters; OpinionError where a veto leaves no cell."""
    own: dict[str, Any] = {name: v for name, v in in_force(rule).items() if name not in ("k", "reference_cell")}
    return fuse(rule.rule, stack, k=rule.k, cell_ratio=cell_ratio(grid, rule), **own)


def in_force(rule: RuleSection) -> dict[str, float | str]:
    """The parameters of a rule that count, by the names of its table: its own, and those of the rule behind its gate."""
    names = set(parameters(rule.rule, rule.inner))
    weighted = ENTROPY_WEIGHTED & ({rule.rule, rule.inner} if rule.rule == "clique" else {rule.rule})
    names |= {"k"} if weighted else set()
    names |= {"reference_cell"} if weighted or "cell_ratio" in names else set()
    if "gamma" in names:
        names.discard("gate" if rule.gamma is not None or "gate" not in names else "gamma")
    values = {name: getattr(rule, name) for name in RuleSection.model_fields if name in names}
    if "gamma" in values:
        values["gamma"] = gamma(rule)
    return {name: value for name, value in values.items() if value is not None}


def gamma(rule: RuleSection) -> float:
    """The ratio of the alphas where it counts: the paper's unless another is given."""
    return 0.5 if rule.gamma is None else rule.gamma


def cell_ratio(grid: Grid, rule: RuleSection) -> float:
    """v_ref / v_cell: 1 without a reference cell."""
    return 1.0 if rule.reference_cell is None else float((rule.reference_cell / grid.cell) ** grid.ndim)


def fuse_opinions(opinions: Sequence[Opinion], grid: Grid, settings: BoardSection, subject: str) -> Fusion:
    """Pool opinions about one subject, at least one, all on `grid`; the order does not matter."""
    opinions = sorted(opinions, key=lambda o: (o.source, len(o.ancestors)))
    if settings.feedback == "paper":  # Table I to the letter: everything is multiplied
        independent, overlapping = list(opinions), list[Opinion]()
    else:
        independent, overlapping = split(opinions)
    rule = settings.of(subject)
    firsthand, shares, components = _pool_independent(independent, grid, rule)
    belief, more, contradicted = _pool_overlapping(firsthand, overlapping)
    scale = 1.0 - sum(share.weight for share in more)
    shares = [Share(s.opinion, s.weight * scale, s.how) for s in shares] + more
    return Fusion(
        belief=Belief(grid, belief),
        ancestors=union([s.opinion for s in shares if s.weight > 0]),
        firsthand=firsthand,
        shares=shares,
        components=components,
        conflict=contradicted or _disagree(independent, firsthand.belief, rule),
    )


def _disagree(opinions: Sequence[Opinion], pooled: Belief, rule: RuleSection) -> bool:
    """The paper's entropy test on first-hand opinions.

    A rule that claims less than the product for caution's sake is asked what it would claim without: not every consensus that
    is less sharp than the sharpest opinion is a conflict.
    """
    stack = np.stack([o.belief.p for o in opinions])
    claim = pooled.p
    if "independence" in in_force(rule):
        claim = pool(stack, pooled.grid, rule.model_copy(update={"independence": 1.0}))
    return conflict(stack, claim)


def _pool_independent(
    opinions: Sequence[Opinion], grid: Grid, rule: RuleSection
) -> tuple[Opinion, list[Share], list[float]]:
    stack = np.stack([o.belief.p for o in opinions])
    ratio = cell_ratio(grid, rule)
    weights = entropy_weights(stack, rule.k, cell_ratio=ratio)
    try:
        pooled = pool(stack, grid, rule)
    except OpinionError:  # a rule with a veto, and opinions that rule each other out: all hypotheses stay
        pooled = linear_pool(stack, weights)
    gate = rule.gate if "gate" in in_force(rule) else None
    components = cooperative_components(stack, weights, gamma=gamma(rule), gate=gate, cell_ratio=ratio)
    name = opinions[0].source if len(opinions) == 1 else ""
    age = min(o.age for o in opinions)
    shares = [Share(o, float(w), "independent") for o, w in zip(opinions, weights, strict=True)]
    return Opinion(name, Belief(grid, pooled), union(opinions), age), shares, [float(c) for c in components]


def _pool_overlapping(firsthand: Opinion, opinions: Sequence[Opinion]) -> tuple[Array, list[Share], bool]:
    """Geometric means, sharpest first, each with the weight that minimises entropy; contradictions keep both hypotheses.

    Also what each contributed, and whether there was a contradiction.
    """
    pooled, shares, contradicted = firsthand.belief.p, list[Share](), False
    for opinion in sorted(opinions, key=lambda o: (entropy(o.belief.p), o.source)):
        other = opinion.belief.p
        if bhattacharyya_coefficient(pooled, other) < CONTRADICTION:
            weights = entropy_weights(np.stack([pooled, other]))
            pooled, weight, contradicted = linear_pool(np.stack([pooled, other]), weights), float(weights[1]), True
        else:
            pooled, kept = chernoff(pooled, other)
            weight = 1.0 - kept
        shares = [Share(s.opinion, s.weight * (1.0 - weight), s.how) for s in shares]
        shares.append(Share(opinion, weight, "overlapping"))
    return pooled, shares, contradicted
