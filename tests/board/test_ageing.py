"""How an old belief spreads: by the speed that its robot gave, else by the drift."""

import math

import pytest

from blackboard.opinion.ageing import MAX_ROBOTS, Ageing
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import region_area
from blackboard.wire.arrays import unpack
from tests.board.reports import GRID, at, new_board, only, report


def test_by_its_speed_in_an_unknown_direction_else_as_a_random_walk() -> None:
    ageing = Ageing(2.0, Grid((100,)))
    assert ageing.variance("robot/r1", 4.0) == 2.0**2 * 4.0
    ageing.learn_speed("r1", 3.0)
    assert ageing.variance("robot/r1", 4.0) == (3.0 * 4.0) ** 2 / 2
    assert ageing.variance("robot/r2", 4.0) == ageing.variance("object/r1", 4.0) == 16.0
    ageing.learn_speed("r1", 0.0)
    assert ageing.variance("robot/r1", 4.0) == 0.0
    assert ageing.variance("robot/r1", -1.0) == 0.0


def test_it_is_bounded() -> None:
    ageing = Ageing(1.0, Grid((100,)))
    for number in range(2 * MAX_ROBOTS):
        ageing.learn_speed(f"r{number}", 1e12)
    assert ageing.variance(f"robot/r{number}", 1e12) == 100.0**2 / 2
    assert ageing.variance("robot/r0", 4.0) == 4.0, "forgotten"


@pytest.mark.parametrize("speed", [None, 0.0, 0.5, 3.0])
def test_a_board_spreads_what_a_robot_said_of_itself_by_its_speed(speed: float | None) -> None:
    board = new_board(drift=1.0)
    board.hear(report("r1", at(20, 15, 1.0), subject="robot/r1"), 0.0)
    if speed is not None:
        board.ageing.learn_speed("r1", speed)
    belief = unpack(only(board.settle(1, 4.0)).belief, GRID)
    extra = 4.0 if speed is None else (4.0 * speed) ** 2 / 2
    if extra < 20:
        assert math.sqrt(float(belief.covariance()[0, 0])) == pytest.approx(math.sqrt(1.0 + extra), abs=0.1)
    else:
        assert region_area(belief, 0.95) > 400
