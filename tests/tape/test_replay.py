"""A replay does again what the boards did, to the bit: in lockstep, in real time, without a world, with kills and losses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.tape.content import Tape
from blackboard.tape.judge import course, judge, match, recorded
from blackboard.tape.replay import replay
from blackboard.wire.envelope import Kind
from sim_world.scorecard import scorecard
from tests.tape.teams import SMALL, RecordedTeam, recorded_run

REALTIME = SMALL.changed("time", mode="realtime")


def kills_and_losses(team: RecordedTeam) -> None:
    """A board is killed and started again, a robot is killed, and every tenth message does not reach its receiver."""
    rng = np.random.default_rng(5)
    team.lose = lambda receiver, envelope: (
        receiver is not team.world and envelope.kind is Kind.PUT and rng.random() < 0.1
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
        (SMALL.changed("board", independence="learn"), None, "opinions"),
    ],
    ids=["lockstep", "real time", "lockstep with kills and losses", "real time with kills and losses", "learning"],
)
def test_the_hash_is_the_recorded_one(
    tmp_path: Path, scenario: Scenario, story: Callable[[RecordedTeam], None] | None, fusion: str
) -> None:
    card, tape = recorded_run(
        tmp_path / "x.mcap", scenario.changed("board", fusion=fusion), story or (lambda team: None)
    )
    one, other = hashes(tape)
    assert one == other
    if story is None:
        assert one == card["hash"]


def test_the_scorecard_of_a_tape_is_the_world_s(tmp_path: Path) -> None:
    card, tape = recorded_run(tmp_path / "x.mcap")
    found = scorecard(judge(tape.scenario, course(tape, tape.runs[-1]), recorded(tape)))
    assert found.keys() == card.keys()
    own = ("wall_s", "messages", "bytes", "counters")  # what was on the network, and at the world's own process
    assert {k: v for k, v in found.items() if k not in own} == {k: v for k, v in card.items() if k not in own}
