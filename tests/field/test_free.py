"""Boards without a world, in virtual time: what is agreed is as young as the robots' steps, and each settlement has a tick of its own."""

from collections import defaultdict
from itertools import pairwise

import pytest

from blackboard.board.service import board_of
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus
from examples.field.world import Truth, World
from tests.field.play import Field, new_scenario

pytestmark = pytest.mark.team
STEP = 0.1  # seconds between two steps of a robot
ALMOST = 1e-3  # seconds: woken services let a little time pass


class Published:
    """What boards publish in a field."""

    def __init__(self, fusion: str = "joint", period: float = 0.2, began: float = 0.07) -> None:
        chosen = new_scenario(Truth(), fusion=fusion, period=period)
        phases = {"r2": 0.03, "r3": 0.06}
        self.field = Field(World(101), chosen, sigmas=False, phases=phases, began=began)
        self.field.join(board_of(chosen, "a", "board-b"))  # it follows
        self.names: dict[tuple[str, str, str, int], set[bytes]] = defaultdict(set)
        self.ticks: dict[str, list[int]] = defaultdict(list)
        self.field.bus.spies.append(self.hear)
        self.field.play(7.0)

    def hear(self, envelope: Envelope) -> None:
        for topic in (keys.CONSENSUS, keys.AGREED):
            if topic.match(envelope.key) is not None:
                consensus = decode(Consensus, envelope.payload)
                self.names[consensus.board, consensus.level, consensus.subject, consensus.tick].add(envelope.payload)
                if consensus.tick not in self.ticks[consensus.board][-1:]:
                    self.ticks[consensus.board].append(consensus.tick)


@pytest.mark.parametrize("fusion", ["joint", "opinions"])
def test_what_is_agreed_is_at_most_as_old_as_a_step(fusion: str) -> None:
    """A period is two steps; before, it was up to a period old."""
    published = Published(fusion)
    assert max(published.field.ages) <= STEP + ALMOST


@pytest.mark.parametrize("period", [0.2, *(pytest.param(period, marks=pytest.mark.long) for period in (0.05, 1.0))])
def test_each_settlement_has_a_tick_of_its_own(period: float) -> None:
    published = Published(period=period, began=0.013)
    assert all(len(payloads) == 1 for payloads in published.names.values())
    (ticks,) = published.ticks.values()  # one board leads, the other says nothing
    assert ticks == sorted(set(ticks))
    between = max(later - tick for tick, later in pairwise(ticks))
    assert between <= max(4, round(STEP / (period / 4)) + 1)
