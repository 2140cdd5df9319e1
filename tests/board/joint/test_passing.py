"""Evidence that waits to be passed on: nobody who tells much takes the room of the others."""

from collections import Counter

from blackboard.board.joint.passing import PassedOn
from blackboard.wire.codec import encode
from blackboard.wire.evidence import Forward, Forwarded, PackedEvidence, Seen
from blackboard.wire.raw import MAX_BYTES
from blackboard.wire.types import MAX_OPINIONS
from tests.board.joint.desks import at

THIN = at(10, 10)
SEEN = Seen(
    subject=f"object/{'x' * 50}",
    kind="pose",
    values=(1.23456789, 2.3456789, 0.1234567),
    covariance=(0.123456, 0.0123456, 0.0123456, 0.123456, 0.0123456, 0.123456),
    group="g" * 30,
    biases=[(0.123456, 10.123456)] * 4,
)
FAT = THIN.model_copy(update={"seen": [SEEN] * 64})


def passed(**told: tuple[int, PackedEvidence]) -> tuple[list[Forwarded], Counter[str]]:
    """What is passed on where each robot tells so many times the same, by turns, and what is counted."""
    counters = Counter[str]()
    waiting = PassedOn(counters)
    for tick in range(max(times for times, _ in told.values())):
        for robot, (times, evidence) in told.items():
            if tick < times:
                waiting.add(0.1 * tick, Forwarded(robot=robot, tick=tick, evidence=evidence))
    rows = waiting.take(100.0)
    assert waiting.take(101.0) == []
    return rows, counters


def test_eight_robots_at_ten_times_the_rate_of_their_board_lose_nothing() -> None:
    """64 pieces had room: 16 of these were lost."""
    rows, counters = passed(**{f"r{number}": (10, THIN) for number in range(8)})
    assert [(row.robot, row.tick) for row in rows] == [
        (f"r{number}", tick) for number in range(8) for tick in range(10)
    ]
    assert {round(row.age + 0.1 * row.tick, 6) for row in rows} == {100.0}
    assert not counters


def test_who_tells_most_loses_the_oldest() -> None:
    rows, counters = passed(honest=(40, THIN), liar=(1000, THIN))
    assert [row.tick for row in rows if row.robot == "honest"] == list(range(40))
    assert [row.tick for row in rows if row.robot == "liar"] == list(range(1000 - (MAX_OPINIONS - 40), 1000))
    assert counters == {"joint_dropped": 1040 - MAX_OPINIONS}


def test_much_in_a_piece_takes_no_room_of_others_and_the_message_is_never_too_large() -> None:
    """A message of more than a mebibyte is refused: all that the robots of a sub-team told was lost for the others."""
    rows, counters = passed(honest=(40, THIN), liar=(200, FAT))
    assert sum(row.robot == "honest" for row in rows) == 40
    assert len(rows) == 240 - counters["joint_dropped"] > 80
    assert len(encode(Forward(board="b", sub_team="a", tick=1, time=100.0, evidence=rows))) <= MAX_BYTES
