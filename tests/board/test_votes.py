"""What a robot claims first-hand counts no more than its sensors can know."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.board import Board
from blackboard.opinion.belief import Belief
from blackboard.opinion.bell import width
from blackboard.wire.arrays import unpack
from tests.board.reports import at, new_board, report

MATE, OWN, SHARPEST = "robot/r1", 2.0, 0.5
BESIDE = math.hypot(OWN, SHARPEST)  # the least sigma of a mate's place, seen from a place that is known to OWN


def held_to_be(by: str, sigma: float, *, own: float = OWN, off: float = 2.0, **settings: object) -> Belief:
    """Where r1 is held to be, which says so itself, and whom `by` sees elsewhere."""
    board = new_board(sharpest=SHARPEST, **settings)
    board.hear(report("r1", at(20, 15, OWN), subject=MATE), 0.0)
    board.hear(report(by, at(10, 15, own), subject=f"robot/{by}"), 0.0)
    board.hear(report(by, at(20 + off, 15, sigma), subject=MATE), 0.0)
    return about(board, MATE)


def about(board: Board, subject: str) -> Belief:
    (belief,) = [unpack(consensus.belief) for consensus in board.settle(0, 0.0) if consensus.subject == subject]
    return belief


@settings(deadline=None, max_examples=25)
@given(
    by=st.sampled_from(["a0", "r2"]),  # of a name before r1's, and after it
    rule=st.sampled_from(["logarithmic", "geometric", "hoelder", "cooperative", "coalition", "median-log"]),
    sigma=st.floats(0.01, BESIDE),
    off=st.floats(-4.0, 4.0),
)
def test_a_mate_seen_from_a_place_is_known_no_better_than_that_place(
    by: str, rule: str, sigma: float, off: float
) -> None:
    # A belief that is narrower than a cell has its mean at the centre of that cell: the honest one is put there.
    mean = float(at(20 + off, 15, sigma).mean()[0]) - 20
    lie, honest = held_to_be(by, sigma, off=off, rule=rule), held_to_be(by, BESIDE, off=mean, rule=rule)
    assert abs(lie.mean()[0] - 20) <= abs(honest.mean()[0] - 20) + 0.1


def test_who_claims_to_know_its_own_place_better_than_the_sharpest_sensor_does_not() -> None:
    assert held_to_be("r2", 0.01, own=0.01).mean() == pytest.approx(
        held_to_be("r2", math.hypot(0.5, 0.5), own=0.5).mean(), abs=0.1
    )


@pytest.mark.parametrize("subject", ["object/ball", "robot/r2", "robot/r1"])
@pytest.mark.parametrize(("sharpest", "claimed"), [(2.0, 0.1), (1.0, 1.2)])
def test_one_place_is_known_as_claimed_or_as_well_as_the_sharpest_sensor_could(
    subject: str, sharpest: float, claimed: float
) -> None:
    board = new_board(sharpest=sharpest)
    board.hear(report("r2", at(20, 15, claimed), subject=subject), 0.0)
    assert width(about(board, subject)) == pytest.approx(max(sharpest, claimed), rel=0.05)


@pytest.mark.parametrize("sigma", [BESIDE + 0.1, 4.0])
def test_what_sensors_can_know_is_taken_as_it_is_told(sigma: float) -> None:
    bounded, free = held_to_be("r2", sigma), held_to_be("r2", sigma, feedback="paper")
    assert np.array_equal(bounded.p, free.p)
