"""A replay does again what the boards did, to the bit: in lockstep, in real time, without a world, with kills and losses."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.judge.card import scorecard
from blackboard.opinion.belief import gaussian
from blackboard.tape.content import Tape, summary
from blackboard.tape.file import TapeAbout
from blackboard.tape.journal import Journaled
from blackboard.tape.judge import course, judge, match, recorded
from blackboard.tape.replay import Output, replay
from blackboard.tape.table import rows
from blackboard.tape.whatif import what_if
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Journal, Report, Truth
from tests.tape.teams import SMALL, RecordedTeam, recorded_run

REALTIME = SMALL.changed("time", mode="realtime")


def kills_and_losses(team: RecordedTeam) -> None:
    """A board is killed and started again, a robot is killed, and every tenth message does not reach its receiver."""
    rng = np.random.default_rng(5)
    team.lose(
        lambda receiver, envelope: receiver is not team.world and envelope.kind is Kind.PUT and rng.random() < 0.1
    )
    team.run_until(lambda: team.world.tick == 1)
    team.kill("b")
    team.run_until(lambda: team.world.tick == 2)
    team.restart("b")
    team.run_until(lambda: team.world.tick == 3)
    team.leave(team.robots["r2"])


def hashes(tape: Tape) -> tuple[str, str]:
    """Of the recorded consensuses, and of those of a replay."""
    story = course(tape, tape.runs[-1])
    again = replay(tape)
    assert (again.missing, again.gaps, again.late) == (0, 0, [])
    assert match(story.run, recorded(tape), again.output).exact
    return judge(tape.scenario, story, recorded(tape)).judgement.hash, judge(
        tape.scenario, story, again.output
    ).judgement.hash


@pytest.mark.parametrize(
    ("scenario", "story", "fusion"),
    [
        (SMALL, None, "joint"),
        (REALTIME, None, "opinions"),
        (SMALL, kills_and_losses, "opinions"),
        (REALTIME, kills_and_losses, "joint"),
    ],
    ids=["lockstep", "real time", "lockstep with kills and losses", "real time with kills and losses"],
)
def test_the_hash_is_the_recorded_one(
    tmp_path: Path, scenario: Scenario, story: Callable[[RecordedTeam], None] | None, fusion: str
) -> None:
    card, tape = recorded_run(
        tmp_path / "x.mcap", scenario.changed("board", fusion=fusion), story or (lambda team: None)
    )
    first, second = hashes(tape)
    assert first == second
    if story is None:
        assert first == card["hash"]


def test_the_scorecard_of_a_tape_is_the_world_s(tmp_path: Path) -> None:
    card, tape = recorded_run(tmp_path / "x.mcap")
    judged = scorecard(judge(tape.scenario, course(tape, tape.runs[-1]), recorded(tape)))
    assert judged.keys() == card.keys()
    own = ("wall_s", "messages", "bytes", "counters")  # what was on the network, and at the world's own process
    assert {k: v for k, v in judged.items() if k not in own} == {k: v for k, v in card.items() if k not in own}


def test_a_board_without_a_world_comes_out_the_same() -> None:
    """It goes by Unix time and settles by its own period; there is no Clock and no truth, and the hash is there all the same."""
    service = Journaled(board_of(SMALL, "a", "board-a"), team="t", sub_team="a", board="board-a")
    envelopes: list[tuple[float, Envelope]] = []

    def send(at: float, envelope: Envelope) -> None:
        envelopes.append((at, envelope))
        envelopes.extend((at, each) for each in service.receive(envelope, at + 0.001))

    for token in ("cop/t/a/board/board-a", "cop/t/a/member/r1", "cop/t/a/member/r2"):
        send(1e9, Envelope(token, kind=Kind.ALIVE))
    for k in range(12):
        now = 1e9 + 0.1 * k
        belief = pack(gaussian(SMALL.grid, (5.0 + 0.1 * k, 6.0), 1.5))
        for robot in ("r1", "r2"):
            report = Report(source=robot, subject="object/ball", tick=k, time=now, belief=belief)
            send(now, Envelope(f"cop/t/a/report/{robot}/object/ball", encode(report)))
        envelopes.extend((now, each) for each in service.wake(now + 0.05))
    tape = Tape(SMALL, envelopes, TapeAbout())
    assert tape.runs == []
    story, again = course(tape, ""), replay(tape)
    assert story.mode == "free"
    assert match("", recorded(tape), again.output).same > 5
    assert match("", recorded(tape), again.output).exact
    recorded_hash, replayed_hash = (
        judge(SMALL, story, output).judgement.hash for output in (recorded(tape), again.output)
    )
    assert recorded_hash == replayed_hash != judge(SMALL, story, Output()).judgement.hash


def test_messages_on_a_tape_may_be_anything(tmp_path: Path) -> None:
    """Truths outside the grid, ticks and times far away, garbage: a replay and a scorecard come out of it."""
    _, tape = recorded_run(tmp_path / "x.mcap")
    far = Truth(run=tape.runs[0], tick=3, time=1e12, positions={"robot/r1": (1e12, -1e12), "object/ball": (-5.0, 1e9)})
    clock = Clock(run=tape.runs[0], tick=2**53 - 1, time=-1e12, mode="realtime")
    journal = Journal(
        board="x", sub_team="y", began=1e11, first=2**53 - 1, events=[(1e11, "wake", ""), (0.0, "alive", "z")]
    )
    odd = [
        Envelope("cop/t/world/truth", encode(far)),
        Envelope("cop/t/y/journal/x", encode(journal)),
        *(Envelope(e.key, e.payload[:-3]) for _, e in tape.envelopes),
    ]
    begin = [(tape.envelopes[0][0], e) for e in odd]
    late = [(1.8e10, e) for e in [Envelope("cop/t/world/clock", encode(clock)), *odd]]
    hostile = Tape(tape.scenario, begin + tape.envelopes + late, tape.about)
    story = course(hostile, tape.runs[0])
    for output in (recorded(hostile), replay(hostile).output, what_if(hostile, tape.scenario)):
        assert judge(tape.scenario, story, output).judgement.hash
    assert list(rows(hostile))
    assert summary(hostile)["boards"]
