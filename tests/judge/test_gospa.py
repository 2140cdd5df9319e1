"""GOSPA against every assignment there is, and as a metric."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.judge.gospa import assignment, gospa
from blackboard.opinion.grid import Array

CUT = 3.0
PLACE = st.tuples(st.floats(-5, 5), st.floats(-5, 5))


def places(most: int) -> st.SearchStrategy[Array]:
    return st.lists(PLACE, max_size=most).map(lambda rows: np.array(rows, dtype=float).reshape(-1, 2))


def every_assignment(n: int, m: int) -> list[tuple[tuple[int, int], ...]]:
    """All sets of pairs in which nobody is twice."""
    assignments = []
    for k in range(min(n, m) + 1):
        for rows in itertools.combinations(range(n), k):
            assignments += [tuple(zip(rows, columns, strict=True)) for columns in itertools.permutations(range(m), k)]
    return assignments


def by_hand(things: Array, tracks: Array) -> float:
    """The definition: the best of all assignments."""

    def cost(pairs: tuple[tuple[int, int], ...]) -> float:
        near = sum(math.dist(things[i], tracks[j]) ** 2 for i, j in pairs)
        return near + CUT**2 / 2 * (len(things) + len(tracks) - 2 * len(pairs))

    return math.sqrt(min(cost(pairs) for pairs in every_assignment(len(things), len(tracks))))


@given(things=places(4), tracks=places(4))
def test_it_is_the_best_of_all_assignments(things: Array, tracks: Array) -> None:
    score = gospa(things, tracks, CUT)
    assert score.distance == pytest.approx(by_hand(things, tracks), abs=1e-9)
    left = CUT**2 / 2
    assert score.missed == pytest.approx(left * (len(things) - len(score.pairs)))
    assert score.false == pytest.approx(left * (len(tracks) - len(score.pairs)))


@given(costs=st.integers(0, 4).flatmap(lambda n: st.integers(0, 5).map(lambda m: (n, m))), seed=st.integers(0, 999))
def test_an_assignment_is_whole_and_the_cheapest(costs: tuple[int, int], seed: int) -> None:
    n, m = costs
    table = np.random.default_rng(seed).integers(0, 6, (n, m)).astype(float)  # with ties
    pairs = assignment(table)
    whole = [pairs for pairs in every_assignment(n, m) if len(pairs) == min(n, m)]
    assert len(pairs) == len({i for i, _ in pairs}) == len({j for _, j in pairs}) == min(n, m)
    assert sum(table[pair] for pair in pairs) == min(sum(table[pair] for pair in pairs) for pairs in whole)


@given(a=places(3), b=places(3), c=places(3))
def test_it_is_a_metric(a: Array, b: Array, c: Array) -> None:
    there, back, on, through = (gospa(*both, CUT).distance for both in ((a, b), (b, a), (b, c), (a, c)))
    assert there == pytest.approx(back)
    assert through <= there + on + 1e-9
    assert gospa(a, a, CUT).distance == 0.0


def test_a_track_beyond_the_cut_is_a_missed_thing_and_a_false_track() -> None:
    score = gospa(np.array([[0.0, 0.0], [8.0, 0.0]]), np.array([[1.0, 0.0], [20.0, 0.0]]), CUT)
    assert score.pairs == ((0, 0),)
    assert (score.localisation, score.missed, score.false) == (1.0, 4.5, 4.5)


def test_a_cut_of_nothing_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="give a positive one"):
        gospa(np.zeros((1, 2)), np.zeros((1, 2)), 0.0)
