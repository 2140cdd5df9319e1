"""Another process of the same name is told once, and one that was started again is no other."""

import pytest

from blackboard.process.namesakes import AGAIN, GAP, SURE, Namesakes
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

BOARD = keys.BOARD.key(team="t", sub_team="a", board="board-a")
ROBOT = tuple(keys.MEMBER.key(team="t", sub_team=s, robot="r1") for s in ("a", "b"))


def status(process: str, sub_team: str = "a", kind: Kind = Kind.PUT) -> Envelope:
    return Envelope(keys.STATUS.key(team="t", sub_team=sub_team, process=process), b"", kind)


def told_at(namesakes: Namesakes, *times: float, of: Envelope) -> list[float]:
    """When something was told, where these came at these times."""
    return [time for time in times if namesakes.hear_envelope(of, time) is not None]


def seconds(first: float, last: float) -> list[float]:
    return [first + n for n in range(int(last - first) + 1)]


@pytest.mark.parametrize(
    ("tokens", "envelope"),
    [((BOARD,), status("board-a")), (ROBOT, status("r1")), (ROBOT, status("r1", "b"))],
    ids=["board", "robot", "robot in its second sub-team"],
)
def test_another_one_is_told_once_as_long_as_it_goes_on(tokens: tuple[str, ...], envelope: Envelope) -> None:
    namesakes = Namesakes(tokens)
    assert told_at(namesakes, *seconds(100.0, 400.0), of=envelope) == [100.0 + SURE]
    assert namesakes.count == 1


def test_the_line_says_where_what_and_the_cure() -> None:
    namesakes = Namesakes((BOARD,))
    namesakes.hear_envelope(status("board-a"), 0.0)
    assert namesakes.hear_envelope(status("board-a"), SURE) == (
        "cop/t/a/status/board-a: another process sends under this name, too; stop one of the two, "
        "or give it another name (--id)"
    )


def test_what_the_one_before_a_restart_sent_last_is_no_other_process() -> None:
    """Also where that happens to it again and again, and where a frozen process reads at once what came meanwhile."""
    namesakes = Namesakes((BOARD,))
    for start in (0.0, 2 * GAP + SURE, 100.0):
        assert told_at(namesakes, start, start + 0.5, start + SURE - 0.1, of=status("board-a")) == []
    assert told_at(namesakes, *[500.0] * 1000, of=status("board-a")) == []
    assert namesakes.count == 0


def test_one_that_comes_after_a_long_silence_is_another_one() -> None:
    namesakes = Namesakes((BOARD,))
    assert told_at(namesakes, *seconds(0.0, 10.0), of=status("board-a")) == [SURE]
    # The same one, which goes on.
    assert told_at(namesakes, *seconds(10.0 + AGAIN, 30.0 + AGAIN), of=status("board-a")) == []
    later = 31.0 + 2 * AGAIN
    assert told_at(namesakes, *seconds(later, later + 20.0), of=status("board-a")) == [later + SURE]
    assert namesakes.count == 2


def test_a_flood_is_told_no_more_often_than_a_silence_lasts() -> None:
    namesakes = Namesakes((BOARD,))
    lines = told_at(namesakes, *(0.01 * n for n in range(100_000)), of=status("board-a"))
    assert len(lines) == 1
    spaced = [n * (SURE + 1.0) + late for n in range(250) for late in (0.0, SURE)]  # with pauses, to be taken for many
    assert told_at(namesakes, *(2000.0 + time for time in spaced), of=status("board-a")) == [2000.0 + SURE]


def test_a_clock_that_is_set_back_tells_nothing_that_is_not_so() -> None:
    namesakes = Namesakes((BOARD,))
    assert told_at(namesakes, 1000.0, 10.0, 1000.0, of=status("board-a")) == []


@pytest.mark.parametrize(
    ("tokens", "envelope"),
    [
        ((BOARD,), status("board-b")),
        ((BOARD,), status("board-a", "b")),
        ((BOARD,), status("board-a", kind=Kind.DELETE)),
        ((BOARD,), Envelope(BOARD, kind=Kind.ALIVE)),
        ((keys.WORLD.key(team="t"),), status("world")),
        (("x",), Envelope("x")),
        ((), status("r1")),
    ],
    ids=["another board", "of another sub-team", "deleted", "a token", "a world", "no topic", "who only looks on"],
)
def test_nothing_else_is_told(tokens: tuple[str, ...], envelope: Envelope) -> None:
    assert told_at(Namesakes(tokens), *seconds(0.0, 30.0), of=envelope) == []
