"""What boards learn outlives them: a board that was restarted is as its twin, and a tape that begins late is replayed to the bit."""

from pathlib import Path
from typing import Any

import pytest

from blackboard.board.lead import BoardRole
from blackboard.board.service import board_of
from blackboard.lab.team import InProcessTeam
from blackboard.tape.content import Tape
from blackboard.tape.judge import match, recorded
from blackboard.tape.replay import replay
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.memory import Memory, PackedLearner, PackedMemory
from tests.flow.streams import Stream
from tests.heard import Heard
from tests.scenarios import LEARNS
from tests.tape.teams import from_tick, recorded_run
from tests.wire.envelopes import put


def memory(service: Any) -> tuple[object, object]:
    return service.board.memory("consensus"), service.board.memory("agreed")


def blank(follower: Any, time: float) -> Memory:
    """A memory of nothing, of the leader of a board."""
    empty = PackedMemory(learner=PackedLearner())
    run = follower.clock.followed.run
    return Memory(board="board-a", sub_team="a", run=run, tick=9, time=time, consensus=empty, agreed=empty)


def test_a_board_that_was_restarted_is_as_its_twin() -> None:
    whole = InProcessTeam(LEARNS)
    calm = Stream(whole)
    whole.run()
    team = InProcessTeam(LEARNS.changed("team", boards=2))
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == 8)
    assert memory(team.boards["a"]) == memory(team.boards["a2"])
    team.leave(team.boards["a"])
    team.run_until(lambda: team.world.tick == 10)
    back = team.boards["a"] = board_of(team.scenario, "a", "board-a")
    team.join(back)
    team.run_until(lambda: team.world.tick == 15)
    assert back.lead.role is BoardRole.FOLLOWS
    team.leave(team.boards.pop("a2"))
    team.run()
    stream.check()
    assert team.world.why == ""
    assert stream.boards("a")[-1] == "board-a"
    assert stream.beliefs == calm.beliefs
    newest = calm.beliefs["a", "consensus", "robot/r1", 20]
    assert newest.parameters["independence"] != 0.2
    assert {learned.source for learned in newest.learned} >= {"r1", "r2"}


def test_a_leader_that_repeats_its_memory_costs_its_follower_one_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taking over the largest memory takes 0.2 s of a core."""
    team = InProcessTeam(LEARNS.changed("team", boards=2))
    team.run_until(lambda: team.world.tick == 8)
    follower = team.boards["a2"]
    assert follower.lead.role is BoardRole.FOLLOWS
    taken: list[Memory] = []
    monkeypatch.setattr(follower.board, "remember", taken.append)
    said = blank(follower, follower.clock.time(team.now) + 1.0)
    for _ in range(20):
        follower.receive(put(said), team.now)
    assert taken == [said]


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_tape_that_begins_late_is_replayed_to_the_bit(tmp_path: Path, mode: str) -> None:
    """Once all that boards held before it is older than `max_age` (1 s, two ticks)."""
    _, tape = recorded_run(tmp_path / "x.mcap", LEARNS.changed("time", mode=mode))
    late = from_tick(tape, 9)
    again = replay(late)
    matched = match(late.runs[-1], recorded(late), again.output)
    assert again.late == ["a/board-a", "b/board-b"]
    assert matched.exact_from is not None
    assert matched.exact_from <= 9 + 4
    without = Tape(
        late.scenario, [envelope for envelope in late.envelopes if not keys.MEMORY.match(envelope[1].key)], late.about
    )
    forgot = match(late.runs[-1], recorded(late), replay(without).output)
    assert forgot.exact_from is None  # so it is the memory that does it


def test_only_a_board_that_leads_says_what_it_remembers_once_a_second() -> None:
    team = InProcessTeam(LEARNS.changed("team", boards=2).changed("time", seconds=3.0))
    heard = Heard(team.bus)
    team.run()
    # before the world comes each board leads itself
    said = [packed for packed in heard.of(keys.MEMORY, board="board-a") if packed.run]
    assert [packed.tick for packed in said] == [0, 2, 4, 6]


def test_where_nothing_learns_nothing_is_remembered() -> None:
    team = InProcessTeam(LEARNS.changed("board", independence=0.2, max_age=1.0).changed("time", seconds=1.0))
    heard = Heard(team.bus)
    team.run()
    assert heard.of(keys.MEMORY) == []
    assert all("/memory/" not in key for board in team.boards.values() for key in board.listens)


def test_a_memory_that_is_none_harms_nobody() -> None:
    """From the leader's own name, of another run, and of times that are still to come."""
    team = InProcessTeam(LEARNS.changed("team", boards=2).changed("time", seconds=4.0))
    team.run_until(lambda: team.world.tick == 4)
    follower = team.boards["a2"]
    before, late = memory(follower), blank(follower, 99.0)
    for changes in ({}, {"run": "x", "time": 2.0}, {"board": "board-b"}):
        follower.receive(Envelope(put(late).key, encode(late.model_copy(update=changes))), team.now)
    assert memory(follower) == before
    assert follower.refused == {"future": 1, "impostor": 1}
