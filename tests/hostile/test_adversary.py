"""The searching adversary's moves; `make adversary` searches."""

import numpy as np

from blackboard.chaos.lies.catalogue import CATALOGUE
from tests.hostile.adversary import draw_change, draw_lie, neighbour


def test_lies_of_every_kind_are_drawn() -> None:
    rng = np.random.default_rng(1)
    drawn = {type(draw_change(rng)) for _ in range(300)}
    catalogued = {type(change) for lie in CATALOGUE.values() for change in lie.changes}
    assert {change.__name__ for change in catalogued - drawn} == {"Absurd"}


def test_a_neighbour_is_another_lie_that_can_be_told() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        lie = draw_lie(rng)
        assert 1 <= len(neighbour(lie, rng).changes) <= 4


def test_the_same_seed_draws_the_same_lies() -> None:
    first, second = (np.random.default_rng(3) for _ in range(2))
    assert [draw_lie(first) for _ in range(20)] == [draw_lie(second) for _ in range(20)]
