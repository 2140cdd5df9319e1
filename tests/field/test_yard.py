"""A team of four different robots with steps of their own, whose sensors are in no scenario, beside one filter with all readings."""

import pytest

from examples.field.world import BALL
from tests.field.play import Score, Scores, add_all, new_scores
from tests.field.yard import KITS, World, Yard

pytestmark = pytest.mark.long
SEEDS = (931, 932)  # for longer runs on others: `python -m tests.field.yard FIRST PAST`


@pytest.fixture(scope="module")
def scores() -> Scores:
    totals = new_scores()
    for seed in SEEDS:
        add_all(totals, Yard(World(seed)).play(40.0))
    return totals


@pytest.mark.parametrize("subject", [*KITS, BALL])
def test_who_is_in_the_team_is_as_near_as_by_one_filter_that_has_all(scores: Scores, subject: str) -> None:
    assert scores["team"][subject].rmse < 1.5 * scores["central"][subject].rmse


def test_together_they_are_nearer_than_alone_with_the_true_models(scores: Scores) -> None:
    together, alone = Score(), Score()
    for robot in KITS:
        together.take(scores["team"][robot])
        alone.take(scores["alone"][robot])
    assert together.rmse < 0.7 * alone.rmse


@pytest.mark.parametrize("subject", [*KITS, BALL])
def test_regions_hold_the_truth(scores: Scores, subject: str) -> None:
    assert scores["team"][subject].coverage() > 0.75
