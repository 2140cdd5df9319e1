"""Whatever numbers a member sends as evidence, the board goes on and its honest members are not shut out."""

from contextlib import suppress

import numpy as np
import pytest

from blackboard.errors import Refused
from blackboard.wire.arrays import unpack
from tests.board.joint.desks import GRID, MAKE, absurd, at, means, new_desk


@pytest.mark.parametrize("seed", range(20))
def test_whatever_evidence_arrives_the_desk_goes_on(seed: int) -> None:
    rng, desk = np.random.default_rng(seed), new_desk()
    for tick in range(15):
        for robot in ("r1", "r2"):
            with suppress(Refused):
                desk.take_evidence(robot, tick, 0.2 * tick, absurd(rng), own=True)
        for consensus in desk.settle(0.2 * tick, MAKE):
            assert unpack(consensus.belief, GRID).p.sum() == pytest.approx(1.0)
    assert desk.counters["failed"] == 0, "what a robot says is no fault of ours"
    desk.take_evidence("honest", 99, 20.0, at(20, 20), own=True)
    desk.take_evidence("honest", 100, 20.2, at(20, 20), own=True)
    desk.settle(20.0, MAKE)
    desk.take_evidence("honest", 101, 20.4, at(20, 20), own=True)
    assert "robot/honest" in means(desk.settle(20.4, MAKE))
