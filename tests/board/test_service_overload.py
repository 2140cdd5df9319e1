"""A board that is slower than the ticks of real time: it goes on with the newest one, and says how many it left out."""

from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from tests.board.desk import Desk, clock, idle, levels, report, reported, settled, theirs


def tick(number: int) -> list[Envelope]:
    """What two robots and a world say in a tick of real time."""
    said = [clock(number, mode="realtime")]
    for robot in ("r1", "r2"):
        said += [report(robot, number), reported(robot, number, "object/ball")]
    return said


def ticks(said: list[Envelope]) -> list[int]:
    return [decode(Consensus, e.payload).tick for e in said if "/consensus/" in e.key or "/agreed/" in e.key]


def begun() -> Desk:
    desk = Desk("r1", "r2", period=0.2)
    desk.tell(idle("r1"), idle("r2"), *tick(0))
    assert (levels(desk.said), ticks(desk.said)) == (["consensus", "agreed"], [0, 0])
    desk.said.clear()
    return desk


def test_of_the_ticks_that_wait_the_newest_is_settled_and_the_others_are_counted() -> None:
    desk = begun()
    desk.now += 1.0
    desk.tell(*(envelope for number in (1, 2, 3, 4) for envelope in tick(number)))
    assert (levels(desk.said), ticks(desk.said)) == (["consensus", "agreed"], [4, 4])
    assert desk.status().counters["skipped"] == 3


def test_nothing_is_skipped_by_a_board_that_follows() -> None:
    desk = begun()
    for number in (1, 2, 3):
        desk.now += 0.2
        desk.tell(*tick(number))
    assert ticks(desk.said) == [1, 1, 2, 2, 3, 3]
    assert desk.status().counters.get("skipped", 0) == 0


def test_a_board_that_is_always_behind_still_speaks_at_every_wake() -> None:
    """Its batches end in the middle of a tick, of which it never has all reports in time."""
    desk = begun()
    for number in range(1, 31, 3):
        both = [*tick(number), *tick(number + 1), *tick(number + 2)]
        desk.now += 0.6
        desk.tell(*both[:-2])
        desk.wait(0.15)  # it took that long; the phase is over, with what there is
        desk.tell(*both[-2:])
    assert ticks(desk.said) == [number for first in range(3, 31, 3) for number in (first, first)]
    assert desk.status().counters["skipped"] == 20


def test_an_exchange_is_not_cut_short_by_the_next_clock() -> None:
    """Another board is silent: after half a period what is agreed without it is said, even where the next tick comes first."""
    desk = begun()
    token = Envelope(keys.BOARD.key(team="t", sub_team="b", board="b"), kind=Kind.ALIVE)
    desk.tell(token, clock(1, mode="realtime"), theirs("b", 0), settled("b", 0, "object/ball"))
    desk.said.clear()
    desk.tell(*tick(1)[1:])
    assert levels(desk.said) == ["consensus"]
    desk.now += 0.3
    desk.tell(*tick(2))
    steps = list(zip(levels(desk.said), ticks(desk.said), strict=True))
    assert [step for step in steps if step[1] == 1] == [("consensus", 1), ("agreed", 1)]
