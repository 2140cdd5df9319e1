"""Teams in one process with journals and a recorder: tapes as a real team makes them, without its processes."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.net.scheduler import AT_ONCE
from blackboard.process.service import Service
from blackboard.tape.content import Tape, load_tape
from blackboard.tape.file import TapeWriter
from blackboard.tape.journal import Journaled
from blackboard.tape.recorder import Recorder
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock
from tests.scenarios import SCENARIO

SMALL = SCENARIO.changed("grid", shape=[14, 14]).changed("time", seconds=2.0)  # 5 ticks, from 0 to 4
#: The commands that read a tape; its file follows.
READERS = [
    ["status"], ["why", "robot/r1"], ["tape", "info"], ["tape", "table"], ["replay"], ["replay", "--without", "r3"],
]  # fmt: skip


class RecordedTeam(InProcessTeam):
    """A team whose boards keep journals and whose messages go onto a tape."""

    def __init__(self, scenario: Scenario = SMALL) -> None:
        super().__init__(scenario)
        self.file = io.BytesIO()
        self.writer = TapeWriter(self.file, {"team": scenario.team.name, "scenario": scenario.to_json()})
        self.journaled: dict[str, Service] = {}
        self.recorder = Recorder(scenario.team.name, self.writer)
        self.join(self.recorder)
        for sub_team, service in self.boards.items():
            self.leave(service)
            self.restart(sub_team)

    def restart(self, sub_team: str) -> None:
        """Start the board of a sub-team, with nothing."""
        name, team = f"board-{sub_team}", self.scenario.team.name
        service = Journaled(board_of(self.scenario, sub_team), team=team, sub_team=sub_team, board=name)
        self.journaled[sub_team] = service
        self.join(service)

    def lose(self, lost: Callable[[Service, Envelope], bool]) -> None:
        """From now on lose what a function says on its way to one receiver; the recorder gets everything."""
        self.route = lambda _, to, envelope: () if to is not self.recorder and lost(to, envelope) else AT_ONCE

    def kill(self, sub_team: str) -> None:
        self.leave(self.journaled.pop(sub_team))


def recorded_run(
    path: Path, scenario: Scenario = SMALL, story: Callable[[RecordedTeam], None] = lambda team: None
) -> tuple[dict[str, Any], Tape]:
    """Let a team run to the end, after a `story` of kills and losses: its scorecard, and its tape."""
    team = RecordedTeam(scenario)
    story(team)
    card = team.run()
    team.run_until(lambda: not team.bus.waiting)
    team.writer.close()
    path.write_bytes(team.file.getvalue())
    return card, load_tape(path)


def from_tick(tape: Tape, tick: int) -> Tape:
    """What a recorder has that came when a tick began."""
    begin = next(
        i
        for i, (_, e) in enumerate(tape.envelopes)
        if keys.CLOCK.match(e.key) and decode(Clock, e.payload).tick == tick
    )
    held = [each for each in tape.envelopes[:begin] if each[1].kind is Kind.ALIVE]
    return Tape(tape.scenario, held + tape.envelopes[begin:], tape.about)
