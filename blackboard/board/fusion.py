"""One fusion: from the opinions about one subject to the pooled belief and its story, which says how it was made. Pure.

independent opinions ── rule (COP) ──► first-hand ──┐
overlapping opinions ───────────────────────────────┴── Chernoff ──► fused
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from blackboard.board.dissent import DissentJudge, distance
from blackboard.board.learning import Advice, Learner
from blackboard.config import BoardSection
from blackboard.opinion.agreement import bhattacharyya_coefficient, conflict
from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.bell import escort_moments, spread, width
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.chi_squared import DOUBT, quantile
from blackboard.opinion.cooperative import CAUTIOUS, Coalition
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import fuse, fuse_belief, linear_pool
from blackboard.opinion.provenance import Opinion, split, union
from blackboard.opinion.rules import Outcome, Rule
from blackboard.opinion.vectors import tempered
from blackboard.opinion.weights import entropy_of, entropy_weights
from blackboard.wire.messages import Learned

#: Two overlapping beliefs whose Bhattacharyya coefficient is below this contradict each other. Equally wide Gaussians do so
#: that are just over 6 sigma apart: exp(-6^2 / 8) = 0.011.
CONTRADICTION = 0.01
EVEN = 1e-9  # by which share the likeliest cell of an opinion that counts as uniform may exceed 1 / m of m cells
HOW = ("independent", "overlapping")  # multiplied by the rule, or averaged because it shares ancestors with others


@dataclass(frozen=True)
class Contribution:
    """What one opinion contributed, and by which of the two steps.

    weight: of an overlapping opinion its share in the fused belief; of an independent one its weight in the rule, times the share
    that the rule's result has in the fused belief. power: the exponent to which its belief was taken before anything was pooled.
    """

    opinion: Opinion
    weight: float
    how: str  # "independent" or "overlapping"
    power: float = 1.0


#: (source, how) -> the power to which an opinion is taken; 1 for those that are not named.
Powers = Mapping[tuple[str, str], float]


@dataclass(frozen=True, eq=False)
class Fusion:
    """The fused belief, what it rests on, and its first-hand part, which may be multiplied again."""

    belief: Belief
    ancestors: dict[str, float]
    firsthand: Belief
    firsthand_ancestors: dict[str, float]  # empty: no source counts here, and the part is flat
    is_firsthand: bool  # whether the fused belief is that part itself
    shares: list[Contribution]
    components: list[float]
    conflict: bool
    rule: Rule
    outcome: Outcome
    learned: list[Learned]  # of the independent sources, where the rule learns


def fuse_opinions(
    opinions: Sequence[Opinion],
    grid: Grid,
    settings: BoardSection,
    subject: str,
    learner: Learner | None = None,
    now: float = 0.0,
    dissent: DissentJudge | None = None,
    counts: Callable[[str], bool] = lambda source: True,
    powers: Powers | None = None,
) -> Fusion:
    """Pool opinions about one subject, at least one, all on `grid`; the order does not matter.

    Where the subject's rule is a coalition with independence "learn", the learner takes the independent opinions at the team
    time `now` (s), and advises how to weigh each. Without a learner the rule is as cautious as before any evidence. `counts`
    says of a robot whether its evidence belongs to the first-hand part, or to the fused belief alone. Unless `feedback` is
    "paper", independent opinions that are uniform are left out where others are not. They hold no information, but would change
    the exponents of a rule, which depend on the number of opinions. Their shares are 0. With `dissent`, who keeps disagreeing
    with the others counts for less, where the learner does not see to that, and where `feedback` is not "paper". `powers` are
    those of a fusion that is to be done again, without a learner and dissent.
    """
    opinions = sorted(opinions, key=lambda o: (o.source, len(o.ancestors)))
    everything = settings.feedback == "paper"  # Table I to the letter: everything is multiplied
    independent, overlapping = (list(opinions), list[Opinion]()) if everything else split(opinions)
    rule, powers = settings.of(subject), powers or {}
    uniform_ones = list[Opinion]()
    if not everything:
        independent, uniform_ones = _without_uniform(independent)
    if dissent is not None and not everything:
        dissent.judge_opinions(subject, now, independent, lambda others: _pooled(rule, others, grid))
    is_alone = isinstance(rule, Coalition) and len(independent) == 1 and not overlapping
    if learner is not None and isinstance(rule, Coalition) and rule.independence == "learn":
        if is_alone:
            learned = learner.learned([independent[0].source])
            alone = _alone(independent[0], _advised(rule, CAUTIOUS), counts, learned=learned)
            return _with_uniform(uniform_ones, alone, counts)
        learner.compare_opinions(subject, now, independent)
        return _with_uniform(
            uniform_ones, _fused(_as_learned(rule, independent, overlapping, learner), grid, counts), counts
        )
    if dissent is not None and not everything:
        powers = {(o.source, how): dissent.weight(o.source) for o in opinions for how in HOW}
    if is_alone:
        power = powers.get((independent[0].source, "independent"), 1.0)
        return _with_uniform(uniform_ones, _alone(_tempered(independent[0], power), rule, counts, power), counts)
    return _with_uniform(uniform_ones, _fused(_to_powers(rule, independent, overlapping, powers), grid, counts), counts)


def _without_uniform(opinions: list[Opinion]) -> tuple[list[Opinion], list[Opinion]]:
    """The opinions that are not uniform, and those that are; where all of them are, they are all kept."""
    if len(opinions) == 1:
        return opinions, []
    are_uniform = [o.belief.p.max() * o.belief.p.size <= 1 + EVEN for o in opinions]
    if all(are_uniform):
        return opinions, []
    parts: dict[bool, list[Opinion]] = {False: [], True: []}
    for opinion, is_uniform in zip(opinions, are_uniform, strict=True):
        parts[bool(is_uniform)].append(opinion)
    return parts[False], parts[True]


def _with_uniform(uniform_ones: Sequence[Opinion], fusion: Fusion, counts: Callable[[str], bool]) -> Fusion:
    """A fusion that also lists the uniform opinions that were left out of it, with a share of 0.

    Their sources stay among the ancestors: who looked and saw nothing has evidence too, so the result is not independent of it.
    """
    if not uniform_ones:
        return fusion
    counted = [opinion.ancestors for opinion in uniform_ones if all(map(counts, opinion.ancestors))]
    return replace(
        fusion,
        shares=[*fusion.shares, *(Contribution(opinion, 0.0, "independent") for opinion in uniform_ones)],
        ancestors=union([fusion.ancestors, *(opinion.ancestors for opinion in uniform_ones)]),
        firsthand_ancestors=union([fusion.firsthand_ancestors, *counted]),
        is_firsthand=fusion.is_firsthand and len(counted) == len(uniform_ones),
    )


@dataclass(frozen=True, eq=False)
class _Weighed:
    """What is pooled, with which rule, and how far each opinion is believed."""

    rule: Rule
    independent: Sequence[Opinion]
    overlapping: Sequence[Opinion]
    stack: Array  # the beliefs of the independent opinions, to their powers: (N, *grid shape)
    powers: Powers
    factors: Array  # (N,) that the rule's weights are to be multiplied by
    learned: list[Learned]


def _to_powers(rule: Rule, independent: Sequence[Opinion], overlapping: Sequence[Opinion], powers: Powers) -> _Weighed:
    """Opinions to powers that are known; the rule weighs what has become of them."""
    independent = [_tempered(o, powers.get((o.source, "independent"), 1.0)) for o in independent]
    overlapping = [_tempered(o, powers.get((o.source, "overlapping"), 1.0)) for o in overlapping]
    stack = np.stack([opinion.belief.p for opinion in independent])
    return _Weighed(rule, independent, overlapping, stack, powers, np.ones(len(independent)), [])


def _as_learned(
    rule: Coalition, independent: Sequence[Opinion], overlapping: Sequence[Opinion], learner: Learner
) -> _Weighed:
    """The rule and the powers that a learner advises; its powers are part of what an opinion weighs."""
    sources = [opinion.source for opinion in independent]
    widths = [width(opinion.belief) for opinion in independent] if len(independent) > 1 else [1.0]
    advice = learner.advice(sources, widths)
    rule, stack = as_advised(rule, np.stack([opinion.belief.p for opinion in independent]), advice)
    powers = {(source, "independent"): float(power) for source, power in zip(sources, advice.powers, strict=True)}
    return _Weighed(rule, independent, overlapping, stack, powers, advice.powers, learner.learned(sources))


def _fused(given: _Weighed, grid: Grid, counts: Callable[[str], bool]) -> Fusion:
    """Pool the independent opinions by the rule, and the overlapping ones with what comes out."""
    pooled = fuse(given.rule, given.stack, grid)
    here = [all(map(counts, opinion.ancestors)) for opinion in given.independent]
    counted = [opinion for opinion, is_here in zip(given.independent, here, strict=True) if is_here]
    firsthand = uniform(grid)
    if counted:
        firsthand = Belief(grid, pooled.p if all(here) else fuse_belief(given.rule, given.stack[np.array(here)], grid))
    overlapping, outvoted = _outvoted(given.independent, given.overlapping)
    fused, more, contradicted = _pool_overlapping(pooled.p, overlapping)
    more += [Contribution(opinion, 0.0, "overlapping") for opinion in outvoted]
    kept = 1.0 - sum(share.weight for share in more)  # the share of `pooled` in `fused`
    weights = pooled.weights * given.factors * kept
    shares = [Contribution(o, float(w), "independent") for o, w in zip(given.independent, weights, strict=True)]
    rests_on = [*(given.independent if kept > 0 else []), *(share.opinion for share in more if share.weight > 0)]
    return Fusion(
        belief=Belief(grid, fused),
        ancestors=union(opinion.ancestors for opinion in rests_on),
        firsthand=firsthand,
        firsthand_ancestors=union(opinion.ancestors for opinion in counted),
        is_firsthand=all(here) and not more,
        shares=[replace(s, power=given.powers.get((s.opinion.source, s.how), 1.0)) for s in shares + more],
        components=[float(c) for c in pooled.components],
        conflict=contradicted or bool(outvoted) or conflict(given.stack, pooled.claim()),
        rule=given.rule,
        outcome=pooled.outcome,
        learned=given.learned,
    )


def _alone(
    only: Opinion, rule: Rule, counts: Callable[[str], bool], power: float = 1.0, learned: Sequence[Learned] = ()
) -> Fusion:
    """The only opinion about a subject, to its power: what a coalition makes of it, without asking what is true of one opinion."""
    grid, one = only.belief.grid, only.belief.p[np.newaxis]
    belief = Belief(grid, rule.belief(one))
    is_counted = all(map(counts, only.ancestors))
    return Fusion(
        belief=belief,
        ancestors=union([only.ancestors]),
        firsthand=belief if is_counted else uniform(grid),
        firsthand_ancestors=union([only.ancestors] if is_counted else []),
        is_firsthand=is_counted,
        shares=[Contribution(only, 1.0, "independent", power)],
        components=[1.0],
        conflict=False,
        rule=rule,
        outcome="pooled",
        learned=list(learned),
    )


def _pooled(rule: Rule, opinions: Sequence[Opinion], grid: Grid) -> Belief:
    return Belief(grid, fuse_belief(rule, np.stack([opinion.belief.p for opinion in opinions]), grid))


def _tempered(opinion: Opinion, power: float) -> Opinion:
    if power >= 1.0:
        return opinion
    p = tempered(opinion.belief.p[np.newaxis], np.array([power]))[0]
    return replace(opinion, belief=Belief(opinion.belief.grid, p))


def as_advised(rule: Coalition, opinions: Array, advice: Advice) -> tuple[Coalition, Array]:
    """The rule and the opinions (N, *grid shape) that a learner advises to pool."""
    return _advised(rule, advice.independence), tempered(opinions, advice.powers)


def _advised(rule: Coalition, independence: float) -> Coalition:
    """Kept, because making a rule checks its parameters, and a learner's advice about a subject holds for about a second."""
    try:
        return _kept_rule(rule, independence)
    except TypeError:  # a rule of somebody's own, with a parameter that cannot be hashed
        return replace(rule, independence=independence)


@lru_cache(256)
def _kept_rule(rule: Coalition, independence: float) -> Coalition:
    return replace(rule, independence=independence)


def _outvoted(
    independent: Sequence[Opinion], overlapping: Sequence[Opinion]
) -> tuple[Sequence[Opinion], Sequence[Opinion]]:
    """The overlapping opinions that may be pooled, and those that the first-hand ones of other sources contradict.

    Whose information an opinion contains is a claim: without this gate a sharp one that claims everybody's would be taken whole.
    It passes where more sources confirm it, by any opinion, than contradict it.
    """
    parts: tuple[list[Opinion], list[Opinion]] = [], []
    for opinion in overlapping:
        others = [other for other in (*independent, *overlapping) if other.source != opinion.source]
        confirming = {other.source for other in others if not _contradict(opinion, other)}
        contradicting = {other.source for other in independent if other in others} - confirming
        parts[len(contradicting) >= max(1, len(confirming))].append(opinion)
    return parts


def _contradict(one: Opinion, other: Opinion) -> bool:
    """Whether two opinions can hardly both be honest: farther apart than 99 % of honest bells of their widths."""
    if (mine := _moments(one)) is None or (its := _moments(other)) is None:
        return bhattacharyya_coefficient(one.belief.p, other.belief.p) < CONTRADICTION
    return distance(mine, its) > quantile(DOUBT, one.belief.grid.ndim)


def _moments(opinion: Opinion) -> tuple[Array, Array] | None:
    """The moments of a bell, or of a belief of a few cells, whose shape cannot be seen; None of others."""
    if opinion.bell is not None:
        return opinion.bell
    moments = escort_moments(opinion.belief)
    return moments if spread(moments[1]) <= opinion.belief.grid.cell**2 else None


def _pool_overlapping(pooled: Array, opinions: Sequence[Opinion]) -> tuple[Array, list[Contribution], bool]:
    """Geometric means, sharpest first, each with the weight that minimises entropy; contradictions keep both hypotheses.

    Also what each contributed, and whether there was a contradiction.
    """
    shares, contradicted = list[Contribution](), False
    for opinion in sorted(opinions, key=lambda o: (entropy_of(o.belief.p), o.source)):
        other = opinion.belief.p
        if bhattacharyya_coefficient(pooled, other) < CONTRADICTION:
            weights = entropy_weights(np.stack([pooled, other]))  # (III-A.1), k = 1
            pooled, weight, contradicted = linear_pool(np.stack([pooled, other]), weights), float(weights[1]), True
        else:
            pooled, kept = chernoff(pooled, other)
            weight = 1.0 - kept
        shares = [Contribution(s.opinion, s.weight * (1.0 - weight), s.how) for s in shares]
        shares.append(Contribution(opinion, weight, "overlapping"))
    return pooled, shares, contradicted
