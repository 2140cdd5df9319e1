"""When a board's part changes: each row of the table is walked."""

from collections.abc import Callable

import pytest

from blackboard.board.lead import HOLD, BoardRole, Fact
from blackboard.wire.envelope import Kind
from tests.board.seat import SILENT, Seat

Walk = list[Callable[[Seat], object]]
COME: Walk = [lambda seat: seat.here("w")]
LED: Walk = [*COME, lambda seat: seat.hear("w")]
LEADS: Walk = [lambda seat: seat.here(), *COME, lambda seat: seat.hear("w", follows=True, since=1.0)]
GONE: Walk = [lambda seat: seat.here("w", kind=Kind.GONE)]
OLDER: Walk = [lambda seat: seat.here("y"), lambda seat: seat.hear("y", follows=True, since=-1.0)]
WALKS: dict[tuple[BoardRole, Fact], Walk] = {
    (BoardRole.LEADS, Fact.FROZEN): [*LEADS, Seat.freeze],
    (BoardRole.LEADS, Fact.OUTRANKED): [*LEADS, lambda seat: seat.hear("w", term=1)],
    (BoardRole.UNKNOWN, Fact.FROZEN): [*COME, Seat.freeze],
    (BoardRole.UNKNOWN, Fact.STUCK): [
        lambda seat: seat.here("z"),
        lambda seat: seat.settle(1),
        *(lambda seat, name=name: (seat.here(name), seat.wait(SILENT / 4)) for name in "abcd"),
    ],
    (BoardRole.UNKNOWN, Fact.LED): LED,
    (BoardRole.UNKNOWN, Fact.AWAITED): [*COME, lambda seat: seat.here("y")],
    (BoardRole.UNKNOWN, Fact.FIRST): [*COME, lambda seat: seat.wait(HOLD)],
    (BoardRole.UNKNOWN, Fact.SECOND): OLDER,
    (BoardRole.FOLLOWS, Fact.FROZEN): [*LED, Seat.freeze],
    (BoardRole.FOLLOWS, Fact.STUCK): [*LED, lambda seat: seat.settle(1), lambda seat: seat.wait(SILENT)],
    (BoardRole.FOLLOWS, Fact.LED): [*LED, lambda seat: seat.hear("w", tick=1)],
    (BoardRole.FOLLOWS, Fact.AWAITED): [*LED, *GONE, lambda seat: seat.here("y"), lambda seat: seat.wait(0.75)],
    (BoardRole.FOLLOWS, Fact.FIRST): [*LED, *GONE, lambda seat: seat.wait(0.75)],
    (BoardRole.FOLLOWS, Fact.SECOND): [*LED, *OLDER, *GONE, lambda seat: seat.wait(0.75)],
}


ROWS = [(part, fact) for part in BoardRole for fact in Fact if part in fact.value.states]


@pytest.mark.parametrize(("part", "fact"), ROWS, ids=[f"{p.value}-{f.name.lower()}" for p, f in ROWS])
def test_each_row_is_walked(part: BoardRole, fact: Fact) -> None:
    seat = Seat()
    *before, last = WALKS[part, fact]
    for action in before:
        action(seat)
        seat.lead.check()
    assert seat.lead.role is part
    last(seat)
    seat.lead.check()
    assert seat.lead.role is fact.value.then
