"""The parameters of the rules: their bounds, their defaults, and what `tune` tries."""

import dataclasses

import numpy as np
import pytest

from blackboard import POOLS
from blackboard.errors import RuleError
from blackboard.opinion.rules import find, read_rule


@pytest.mark.parametrize(
    ("rule", "key", "within", "beyond"),
    [
        ("cooperative", "k", (0, 10), (-0.01, 10.01)),
        ("cooperative", "reference_cell", (0.01, 1e6), (0, -0.01)),
        ("cooperative", "gamma", (0.01, 1), (0, 1.01)),
        ("calibrated", "gamma", (0.01, 1), (0, 1.01)),
        ("calibrated", "power", (0.01, 1e6), (0, -0.01)),
        ("coalition", "gamma", (0.01, 1), (0, 1.01)),
        ("coalition", "gate", (0.01, 1e6), (0, -0.01)),
        ("coalition", "independence", (0, 1), (-0.01, 1.01)),
        ("hoelder", "a", (-20, 20), (-20.01, 20.01)),
        ("clique", "xi", (0.01, 1e6), (0, -0.01)),
    ],
)
def test_a_parameter_is_taken_up_to_its_bounds_and_refused_beyond(
    rule: str, key: str, within: tuple[float, float], beyond: tuple[float, float]
) -> None:
    for value in within:
        assert read_rule({"rule": rule, key: value}).in_force()[key] == value
    for value in beyond:
        with pytest.raises(RuleError, match=key):
            read_rule({"rule": rule, key: value})


def test_the_rules_have_these_defaults() -> None:
    names = ("linear", "hoelder", "cooperative", "calibrated", "coalition", "clique")
    assert [find(name)().in_force() for name in names] == [
        {"rule": "linear", "k": 2.0},
        {"rule": "hoelder", "a": 0.5},
        {"rule": "cooperative", "k": 2.0, "gamma": 0.5},
        {"rule": "calibrated", "k": 2.0, "gamma": 0.5},
        {"rule": "coalition", "k": 2.0, "gate": 4.0, "independence": "learn"},
        {"rule": "clique", "inner": "logarithmic", "xi": 2.0},
    ]


@pytest.mark.parametrize("name", POOLS)
def test_what_tune_tries_is_within_the_bounds_and_rises(name: str) -> None:
    for field in dataclasses.fields(find(name)):  # type: ignore[arg-type]
        tried = field.metadata.get("tried", ())
        assert list(tried) == sorted(set(tried))
        assert [read_rule({"rule": name, field.name: value}).in_force()[field.name] for value in tried] == list(tried)


@pytest.mark.parametrize("name", POOLS)
def test_where_no_ratio_of_cells_is_given_the_cells_are_the_grids_own(name: str) -> None:
    rule, stack = find(name)(), np.random.default_rng(1).dirichlet(np.ones(8), 3)
    weights = np.array([0.5, 0.3, 0.2])
    assert np.array_equal(rule.pool(stack, weights).p, rule.pool(stack, weights, cell_ratio=1.0).p)
