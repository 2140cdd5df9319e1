"""The laws that every rule must keep, for the tests of this package and of a plug-in's author.

Each law takes a rule and opinions and raises AssertionError with a sentence. `check` tries a rule against all of them on opinions of
every kind; in a test, for example:

    def test_my_rule_keeps_the_laws() -> None:
        laws.check(Trimmed(drop=1), np.random.default_rng(1))
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from blackboard.errors import OpinionError, VetoError
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import POOLS, fuse
from blackboard.opinion.rules import Pooled, Rule, read_rule

Law = Callable[[Rule, Array, np.random.Generator], None]

KINDS = ("random", "sparse", "one-hot", "near-zero", "identical", "mixed")
SHAPES = ((5,), (3, 4), (2, 2, 3))


def draw(kind: str, n: int, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """N opinions of one of KINDS, shape (n, *shape)."""
    if kind == "mixed":
        return np.stack([draw(str(rng.choice(KINDS[:4])), 1, shape, rng)[0] for _ in range(n)])
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


def the_result_is_a_belief(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """A board always gets a probability vector of the grid's shape; a veto is allowed only where no cell is possible for all."""
    fused = _fused(rule, opinions)
    _hold(
        fused.p.shape == opinions.shape[1:], rule, f"the belief has shape {fused.p.shape} for opinions {opinions.shape}"
    )
    _hold(float(fused.p.min()) >= 0, rule, f"the belief has a cell of {fused.p.min()}")
    _hold(abs(float(fused.p.sum()) - 1.0) <= 1e-9, rule, f"the belief sums to {fused.p.sum()}")
    possible_for_all = bool((opinions > 0).all(axis=0).any())
    _hold(
        fused.outcome == "pooled" or not possible_for_all, rule, "vetoed although a cell is possible for all opinions"
    )


def the_story_fits(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """One finite weight of at least 0 for each opinion, not all 0; components, where there are any, sum to 1."""
    fused = _fused(rule, opinions)
    _hold(
        fused.weights.shape == (len(opinions),),
        rule,
        f"weights of shape {fused.weights.shape} for {len(opinions)} opinions",
    )
    _hold(bool(np.isfinite(fused.weights).all()) and fused.weights.min() >= 0, rule, f"weights {fused.weights}")
    _hold(fused.weights.max() > 0, rule, "no opinion contributed anything")
    if len(fused.components):
        _hold(
            len(fused.components) <= len(opinions),
            rule,
            f"{len(fused.components)} components of {len(opinions)} opinions",
        )
        _hold(
            fused.components.min() >= 0 and abs(fused.components.sum() - 1) <= 1e-9,
            rule,
            f"components {fused.components}",
        )


def the_opinions_stay_as_they_are(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """A rule does not write into its input, and the same input gives the same bits."""
    given = opinions.copy()
    given.flags.writeable = False
    first, again = _fused(rule, given), _fused(rule, given)
    same = np.array_equal(first.p, again.p) and np.array_equal(first.weights, again.weights)
    _hold(same and np.array_equal(first.claim(), again.claim()), rule, "two calls with the same opinions differ")


def the_order_of_opinions_does_not_matter(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """Opinions in another order give the same belief, and each keeps its weight where no two are equal."""
    order = rng.permutation(len(opinions))
    fused, other = _fused(rule, opinions), _fused(rule, opinions[order])
    _near(other.p, fused.p, rule, "the belief depends on the order of the opinions")
    if len(np.unique(opinions.reshape(len(opinions), -1), axis=0)) == len(opinions):
        _near(other.weights, fused.weights[order], rule, "the weights depend on the order of the opinions", 1e-6)


def the_order_of_cells_does_not_matter(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """Cells in another order, or on a line, give the same belief in that order."""
    flat = opinions.reshape(len(opinions), -1)
    order = rng.permutation(flat.shape[1])
    fused = _fused(rule, opinions)
    _near(_fused(rule, flat[:, order]).p, fused.p.ravel()[order], rule, "the belief depends on the order of the cells")
    _near(_fused(rule, flat).p, fused.p.ravel(), rule, "the belief depends on the shape of the grid")


def a_single_opinion_is_returned(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """The pool of one opinion is that opinion."""
    _near(_fused(rule, opinions[:1]).p, opinions[0], rule, "a single opinion is changed")


def bad_opinions_are_refused(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """NaN, a negative value or a sum other than 1 raises OpinionError, by the rule's function too."""
    function = POOLS[rule.name]
    for value in (np.nan, -0.25, 7.0):
        wrong = opinions.copy()
        wrong.reshape(len(wrong), -1)[-1, 0] = value
        for call in (partial(_fused, rule, wrong), partial(function, wrong)):
            try:
                call()
            except OpinionError as error:
                _hold(not isinstance(error, VetoError), rule, f"{value} is taken for a veto")
            else:
                _hold(False, rule, f"an opinion with the value {value} is taken")


def the_parameters_make_the_rule(rule: Rule, opinions: Array, rng: np.random.Generator) -> None:
    """What is published as in force makes the same rule again."""
    again = read_rule(rule.in_force())
    _hold(again == rule, rule, f"{rule.in_force()} is read as {again}")


#: All laws, in the order in which `check` applies them.
LAWS: tuple[Law, ...] = (
    the_parameters_make_the_rule,
    the_result_is_a_belief,
    the_story_fits,
    a_single_opinion_is_returned,
    the_opinions_stay_as_they_are,
    the_order_of_opinions_does_not_matter,
    the_order_of_cells_does_not_matter,
    bad_opinions_are_refused,
)
#: Laws that are tried on random opinions only: on other kinds a rule may have to choose between equals, which rounding decides.
ON_RANDOM_OPINIONS = frozenset({the_order_of_opinions_does_not_matter, the_order_of_cells_does_not_matter})


def check(rule: Rule, rng: np.random.Generator, repeats: int = 10) -> None:
    """Try a rule against all laws on one to five opinions of each kind, `repeats` times; AssertionError names the broken one."""
    for _ in range(repeats):
        for kind in KINDS:
            n, shape = int(rng.integers(1, 6)), SHAPES[rng.integers(len(SHAPES))]
            opinions = draw(kind, n, shape, rng)
            for law in LAWS:
                if kind == "random" or law not in ON_RANDOM_OPINIONS:
                    law(rule, opinions, rng)


def _fused(rule: Rule, opinions: Array) -> Pooled:
    return fuse(rule, opinions, Grid(opinions.shape[1:]))


def _near(fused: Array, expected: Array, rule: Rule, sentence: str, tolerance: float = 1e-9) -> None:
    away = float(np.abs(fused - expected).max())
    _hold(away <= tolerance, rule, f"{sentence}, by {away:.3g}")


def _hold(condition: bool, rule: Rule, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"rule {rule}: {sentence}")
