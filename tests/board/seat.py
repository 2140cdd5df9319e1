"""A board among the boards of its sub-team, under test without a process: what it hears of them, and the time that passes."""

from blackboard.board.lead import FROZEN, Lead, Publication
from blackboard.process.roster import Roster
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status
from tests.wire.envelopes import token

SILENT = 5.0


class Seat:
    """A board x, and what it learns of the others of its sub-team."""

    def __init__(self, since: float | None = 0.0) -> None:
        self.roster = Roster()
        self.lead = Lead(self.roster, "a", "x", SILENT)
        self.lead.begin(since)
        self.now = 100.0

    def here(self, *boards: str, kind: Kind = Kind.ALIVE) -> bool:
        for board in boards:
            self.roster.hear_token(token(keys.BOARD, board, kind=kind), self.now)
        return self.lead.look(self.now)

    def freeze(self) -> None:
        """Time passes, and the process does nothing."""
        self.now += FROZEN + 0.5
        self.lead.look(self.now)

    def wait(self, seconds: float) -> bool:
        """Time passes as in the loop, which looks once a second."""
        changed = False
        end = self.now + seconds
        while self.now < end:
            self.now = min(end, self.now + 0.25)
            self.roster.forget(self.now)
            changed |= self.lead.look(self.now)
        return changed

    def hear(self, board: str, tick: int = 0, phase: str = "agreed", **part: object) -> bool:
        part = {"follows": False, "term": 0, "since": 0.0, "time": 0.2 * tick, **part}
        status = Status(process=board, kind="board", tick=tick, phase=phase, **part)  # type: ignore[arg-type]
        answers = self.lead.hear_status(status, self.now, 1e6, any_tick=False)
        self.lead.look(self.now)
        return answers

    def settle(self, tick: int, phase: str = "agreed") -> None:
        status = Status(process="x", kind="board", tick=tick, time=0.2 * tick)
        self.lead.keep(Publication(tick, phase, 0.2 * tick, (Envelope("k", b"12"),), status), self.now)

    def kept(self) -> list[tuple[int, str]]:
        return [(said.tick, said.phase) for said in self.lead.release()]
