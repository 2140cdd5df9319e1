"""The player: a tape into a live network, at a chosen speed (`blackboard.process.service.Service`)."""

from collections.abc import Collection
from typing import Literal

from blackboard.errors import UserError
from blackboard.process.service import Quiet
from blackboard.tape.content import Tape
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

Part = Literal["world", "robots", "boards"]
OF_WORLD = (keys.CLOCK, keys.READING, keys.TRUTH, keys.WORLD)
OF_BOARDS = (keys.CONSENSUS, keys.AGREED, keys.FORWARD, keys.MEMORY, keys.BOARD, keys.REFUSED)


class Player(Quiet):
    """Sends what was recorded, and holds every recorded token from the beginning to the end. It subscribes to nothing."""

    def __init__(self, tape: Tape, speed: float, parts: Collection[Part]) -> None:
        """`parts` are those who are played. UserError: nothing of them is on the tape, or a speed that is none."""
        if not 0.0 < speed < 1e6:
            raise UserError(f"--speed {speed:g}: 1 is as recorded, 2 is twice as fast; give a positive number")
        boards = {(life.sub_team, life.board) for life in tape.lives}
        self._to_send: list[tuple[float, Envelope]] = []  # seconds after the start
        for at, envelope in tape.envelopes:
            if _part(envelope.key, boards) not in parts:
                continue
            if envelope.kind is Kind.ALIVE and envelope.key not in self.tokens:
                self.tokens += (envelope.key,)
            elif envelope.kind in (Kind.PUT, Kind.DELETE):
                self._to_send.append(((at - tape.envelopes[0][0]) / speed, envelope))
        if not self._to_send:
            raise UserError(f"{tape.scenario.where}: nothing on the tape is from {', '.join(parts)}")
        self._next = 0
        self._start: float | None = None  # Unix seconds

    def wake(self, now: float) -> list[Envelope]:
        if self._start is None:
            self._start = now
        begin = self._next
        while not self.done and self._start + self._to_send[self._next][0] <= now:
            self._next += 1
            self.done = self._next == len(self._to_send)
        return [envelope for _, envelope in self._to_send[begin : self._next]]

    def wake_at(self, now: float) -> float | None:
        if self._start is None:
            return now
        return None if self.done else self._start + self._to_send[self._next][0]


def _part(key: str, boards: set[tuple[str, str]]) -> Part | None:
    """Who sends on a key; None for journals and disks, because the player is no board and no recorder."""
    parsed = keys.parse(key)
    if parsed is None or parsed[0] in (keys.JOURNAL, keys.DISK):
        return None
    topic, parts = parsed
    if topic in OF_WORLD:
        return "world"
    of_board = topic in OF_BOARDS or (topic is keys.STATUS and (parts["sub_team"], parts["process"]) in boards)
    return "boards" if of_board else "robots"
