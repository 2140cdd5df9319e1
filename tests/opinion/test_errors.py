"""Bad input: the error names the opinion, the cell and the value, and says the cure."""

import re

import numpy as np
import pytest

from blackboard import POOLS, OpinionError, entropy, entropy_weights
from blackboard.errors import RuleError
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import Belief
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import fuse, fuse_belief
from blackboard.opinion.rules import Pooled, Rule, read_rule

CELLS = (2, 3)


def stack(**cells: float) -> Array:
    """Three uniform opinions on 2 x 3 cells; cell (1, 2) of the third can be set."""
    opinions = np.full((3, *CELLS), 1 / 6)
    if cells:
        opinions[2, 1, 2] = cells["value"]
    return opinions


@pytest.mark.parametrize("rule", POOLS)
@pytest.mark.parametrize(
    ("opinions", "text"),
    [
        (stack(value=float("nan")), "opinion 2, cell (1, 2): nan is no probability; give finite values of at least 0"),
        (stack(value=float("inf")), "opinion 2, cell (1, 2): inf is no probability"),
        (stack(value=-0.25), "opinion 2, cell (1, 2): -0.25 is no probability"),
        ([[0.5, 0.5], [1.5, -0.5]], "opinion 1, cell (1,): -0.5 is no probability"),
        (stack(value=-float("inf")), "opinion 2, cell (1, 2): -inf is no probability"),
        (stack(value=0.5), "opinion 2: its cells sum to 1.33333333, not to 1 within 1e-06; divide it by its sum"),
        (stack() * 0, "opinion 0: its cells sum to 0, not to 1"),
        (np.full((3, 4), 1e308), "opinion 0: its cells sum to inf, not to 1"),
        (np.ones(1), "opinions of shape (1,): give (N, *grid shape) with at least one opinion and one cell"),
        (np.ones((0, 4)), "opinions of shape (0, 4): give"),
        (np.ones((3, 0)), "opinions of shape (3, 0): give"),
        ([[1.0], [0.5, 0.5]], "opinions are no array of numbers"),
        ([["a", "b"]], "opinions are no array of numbers"),
    ],
)
def test_opinions(rule: str, opinions: object, text: str) -> None:
    with pytest.raises(OpinionError, match=f"^{re.escape(text)}"):
        POOLS[rule](opinions)


@pytest.mark.parametrize("rule", POOLS)
@pytest.mark.parametrize(
    ("weights", "text"),
    [
        ([1.0, 1.0], "weights of shape (2,) for 3 opinions; give one for each"),
        ([[1.0, 1.0, 1.0]], "weights of shape (1, 3) for 3 opinions"),
        ([1.0, 1.0, -2.0], "weight 2: -2.0; give finite values of at least 0"),
        ([1.0, 1.0, -1e-12], "weight 2: -1e-12; give finite values of at least 0"),
        ([1.0, float("nan"), 1.0], "weight 1: nan; give"),
        ([float("inf"), 1.0, 1.0], "weight 0: inf; give"),
        ([0.0, 0.0, 0.0], "all weights are 0; give at least one opinion a positive one"),
        (["x", "y", "z"], "weights are no array of numbers"),
    ],
)
def test_weights(rule: str, weights: object, text: str) -> None:
    with pytest.raises(OpinionError, match=f"^{re.escape(text)}"):
        POOLS[rule](stack(), weights)


@pytest.mark.parametrize("rule", ["logarithmic", "geometric", "harmonic", "median-log", "channel-filter"])
def test_where_a_veto_leaves_no_cell(rule: str) -> None:
    with pytest.raises(OpinionError, match=r"no cell is left .* floor or take a rule without veto"):
        POOLS[rule](np.eye(2))


def test_a_sum_within_the_tolerance_is_taken() -> None:
    nearly = np.full((2, 5), 0.2 + 1e-7)
    assert POOLS["linear"](nearly).sum() == pytest.approx(1.0, abs=1e-12)
    assert POOLS["cooperative"](nearly.astype(np.float32)).sum() == pytest.approx(1.0, abs=1e-12)


def test_single_opinions() -> None:
    with pytest.raises(OpinionError, match=r"opinion 0: its cells sum to 0\.5"):
        entropy(np.array([0.25, 0.25]))
    with pytest.raises(OpinionError, match=re.escape("shapes (2,) and (3,)")):
        kullback_leibler(np.full(2, 0.5), np.full(3, 1 / 3))
    with pytest.raises(OpinionError, match=re.escape("shapes (2,) and (3,)")):
        chernoff(np.full(2, 0.5), np.full(3, 1 / 3))


@pytest.mark.parametrize(("k", "cell_ratio", "text"), [(-1.0, 1.0, "k -1.0"), (1.0, 0.0, "cell_ratio 0.0")])
def test_parameters_of_weights(k: float, cell_ratio: float, text: str) -> None:
    with pytest.raises(OpinionError, match=re.escape(f"{text}: give")):
        entropy_weights(stack(), k, cell_ratio=cell_ratio)


def test_parameters_of_rules() -> None:
    with pytest.raises(OpinionError, match="a nan: give"):
        POOLS["hoelder"](stack(), a=float("nan"))
    with pytest.raises(OpinionError, match="xi 0.0: give"):
        POOLS["clique"](stack(), xi=0.0)
    with pytest.raises(OpinionError, match=re.escape("common of shape (1, 6) for opinions on a grid of (2, 3)")):
        POOLS["channel-filter"](stack(), common=np.full((1, 6), 1 / 6))


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"rule": "coalition", "xi": 1}, "xi: rule 'coalition' has no such key; it has gamma, gate, independence, k,"),
        ({"rule": "linear", "power": 2}, "power: rule 'linear' has no such key; it has k, reference_cell"),
        ({"rule": "logarithmic", "k": 2}, "k: rule 'logarithmic' has no such key; it has none"),
        ({"rule": "clique", "inner": "clique"}, "inner: a clique of a clique gains nothing; name another rule"),
        (
            {"rule": "coperative"},
            "rule: 'coperative' is none of calibrated, channel-filter, chernoff, clique, coalition, cooperative, ",
        ),
        ({"rule": "clique", "inner": "x"}, "inner: 'x' is none of calibrated, "),
        ({"rule": "clique", "gamma": 0.5}, "gamma: rule 'clique' has no such key; it has inner, xi"),
        ({"rule": "coalition", "gate": 3, "gamma": 0.5}, "gate: give it or gamma, not both"),
        ({"rule": "linear", "k": "two"}, "k two: give a finite value of at least 0 and at most 10"),
        ({"rule": "linear", "k": True}, "k True: give a finite value"),
        ({"rule": "linear", "k": 10.5}, "k 10.5: give a finite value of at least 0 and at most 10"),
        ({"rule": "hoelder", "a": float("nan")}, "a nan: give a finite value of at least -20 and at most 20"),
        ({"rule": "coalition", "independence": None}, "independence: give a finite value"),
    ],
)
def test_a_rule_names_the_key_that_is_wrong(table: dict[str, object], text: str) -> None:
    with pytest.raises(RuleError, match=f"^{re.escape(text)}"):
        read_rule(table)


def test_a_function_names_the_parameter_too() -> None:
    with pytest.raises(OpinionError, match="^gate: rule 'clique' has no such key; it has inner, k, reference_cell, xi"):
        POOLS["clique"](stack(), inner="linear", gate=3)
    with pytest.raises(KeyError):
        POOLS["median"]


def test_opinions_of_another_grid_are_refused_where_they_are_pooled() -> None:
    with pytest.raises(OpinionError, match=re.escape("opinions of shape (3, 2, 3) for a grid of (3, 2)")):
        fuse(read_rule({"rule": "linear"}), stack(), Grid((3, 2)))
    with pytest.raises(ValueError, match=re.escape("belief of shape (2, 3) on a grid of (3, 2)")):
        Belief(Grid((3, 2)), stack()[0])


class Broken(Rule):
    """A rule that returns what it was told to."""

    name = "broken"

    def __init__(self, pooled: Pooled) -> None:
        object.__setattr__(self, "pooled", pooled)

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        return self.pooled  # type: ignore[attr-defined,no-any-return]


def test_a_rule_that_returns_its_belief_alone_is_named() -> None:
    rule = Broken(stack()[0])  # type: ignore[arg-type]
    for pool in (fuse, fuse_belief):
        with pytest.raises(ValueError, match=r"^rule 'broken' returned ndarray: give Pooled\(belief, "):
            pool(rule, stack(), Grid(CELLS))


@pytest.mark.parametrize(
    ("pooled", "text"),
    [
        (Pooled(np.full(6, 1 / 6), np.ones(3)), r"a belief of shape \(6,\) for a grid of \(2, 3\)"),
        (Pooled(stack()[0] / 2, np.ones(3)), r"a belief that sums to 0\.5"),
        (Pooled(stack()[0], np.ones(2)), r"weights \[1\. 1\.\] for 3 opinions"),
        (Pooled(stack()[0], np.array([1, 1, -1.0])), r"weights \[ 1\.  1\. -1\.\] for 3 opinions"),
        (Pooled(stack()[0], np.ones(3), np.full(4, 0.25)), r"components .* for 3 opinions; give at most 3"),
    ],
)
def test_a_rule_that_breaks_its_promise_is_named(pooled: Pooled, text: str) -> None:
    with pytest.raises(ValueError, match=f"^rule 'broken' returned {text}"):
        fuse(Broken(pooled), stack(), Grid(CELLS))
