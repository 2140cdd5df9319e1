"""What if: the boards of a tape with other settings, without some robots, or with losses. Pure.

What the world and the robots sent comes from the tape, in the recorder's order and at its times. What boards sent is computed
again, and goes from board to board at once. So it is an estimate, not a repetition. In lockstep, where order and time play no
part, it is exact where nothing is changed. In real time the boards see another order, by milliseconds. The robots do not hear
the changed boards. Readings do not depend on the team, but `informed` beliefs do, and so does where a joint lets a robot
linearise: these are those of the recorded run.
"""

import math
from collections.abc import Callable, Collection

from blackboard.board.service import LONGER, BoardService, board_of
from blackboard.config import Scenario
from blackboard.net.bus import BusLink
from blackboard.net.scheduler import Scheduler
from blackboard.process.service import Around
from blackboard.process.team_clock import Pace
from blackboard.tape.content import Tape, messages
from blackboard.tape.replay import Output
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Journal

OF_BOARDS = (keys.CONSENSUS, keys.AGREED, keys.FORWARD, keys.JOURNAL, keys.MEMORY, keys.REFUSED)
LONGEST = 600.0  # seconds
#: How often boards are woken at most: so often, and so often again for each message of the tape. A tape whose messages are far apart,
#: or whose boards are due all the time, would have no end; a real one takes less than once for each message.
WAKES_AT_FIRST, WAKES = 20_000, 20


def what_if(
    tape: Tape,
    scenario: Scenario,
    without: Collection[str] = (),
    lose: Callable[[Envelope], bool] = lambda _: False,
    change: Callable[[Envelope], Envelope] = lambda envelope: envelope,
    moved: Callable[[], None] = lambda: None,
) -> Output:
    """Run the boards of a tape under a scenario, without some robots; a message that `lose` says is lost reaches no board.

    Clocks and tokens are never lost. What robots send is what `change` makes of it. `moved` is called after each message of the tape.
    """
    return _Boards(scenario, frozenset(without), lose, change).play(tape, moved)


class _Board(Around):
    """A board under the other settings, without a token of its own: those of the tape are played. It notes what it sends."""

    tokens = ()

    def __init__(self, board: BoardService, output: Output) -> None:
        super().__init__(board)
        self.board, self._output = board, output

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._output.counters["received"] += 1
        self._output.counters["bytes"] += len(envelope.payload)
        return self._sent(super().receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        self._output.counters["woken"] += 1
        return self._sent(super().wake(now))

    def _sent(self, out: list[Envelope]) -> list[Envelope]:
        self._output.add_sent(self.board, out)
        return out

    @property
    def is_busy(self) -> bool:
        """Whether it is in the middle of a tick in lockstep."""
        return self.board.clock.pace is Pace.LOCKSTEP and self.board.rounds.phase != "settled"


class _Boards:
    """The boards, on a bus on which the rest of the team is played."""

    def __init__(
        self,
        scenario: Scenario,
        without: frozenset[str],
        lose: Callable[[Envelope], bool],
        change: Callable[[Envelope], Envelope],
    ) -> None:
        self._change = change
        self.scenario, self.without, self.output = scenario, without, Output()
        self._running = Scheduler(-math.inf)
        self._bus = self._running.bus
        self._bus.lose = lambda envelope: keys.CLOCK.match(envelope.key) is None and lose(envelope)
        self._rest = self._bus.connect()  # what is played
        self._tokens: dict[str, BusLink] = {}  # each held by a link of its own, which is closed when the token goes
        self._boards: dict[tuple[str, str], _Board] = {}
        self._tick = "", -1  # run and tick of the newest Clock
        self._wakes = WAKES_AT_FIRST  # that may have been until now
        self._behind = 0.0  # seconds that were waited in lockstep and not in the recorded run

    def play(self, tape: Tape, moved: Callable[[], None]) -> Output:
        ends = _ends(tape)
        for number, (at, envelope) in enumerate(tape.envelopes):
            self._wakes += WAKES
            self._pass_time(at + self._behind)
            if number in ends:
                self._stop(ends[number])
            self._take(envelope)
            moved()
        self._settle()
        for service in self._boards.values():
            self.output.refused += service.board.refused
        return self.output

    def _take(self, envelope: Envelope) -> None:
        parsed = keys.parse(envelope.key)
        if parsed is None:
            return
        topic, parts = parsed
        if self.without & {parts.get("robot"), parts.get("source"), parts.get("process")}:
            return
        board = parts.get("sub_team", ""), parts.get("board") or parts.get("process") or ""
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            if topic is keys.BOARD and envelope.kind is Kind.ALIVE and board not in self._boards:
                self._boards[board] = _Board(board_of(self.scenario, *board), self.output)
                self._running.join(self._boards[board])
            self._hold(envelope)
        elif topic is keys.CLOCK:
            self._rest.send(self._clock(envelope))
        elif topic not in OF_BOARDS and board not in self._boards:
            self._rest.send(self._change(envelope))

    def _stop(self, board: tuple[str, str]) -> None:
        if board in self._boards:
            service = self._boards.pop(board)
            self.output.refused += service.board.refused
            self._running.leave(service)

    def _hold(self, envelope: Envelope) -> None:
        if envelope.kind is Kind.GONE and envelope.key in self._tokens:
            self._tokens.pop(envelope.key).close()
        elif envelope.kind is Kind.ALIVE and envelope.key not in self._tokens:
            self._tokens[envelope.key] = self._bus.connect()
            self._tokens[envelope.key].token(envelope.key)

    def _clock(self, envelope: Envelope) -> Envelope:
        """The Clock without those who are left out; in lockstep it comes when the boards are done, as a world would send it."""
        clock = next((clock for _, _, clock in messages([(0.0, envelope)], keys.CLOCK, Clock)), None)
        if clock is None:
            return envelope
        if clock.mode == "lockstep" and (clock.run, clock.tick) != self._tick:  # not one that is sent again
            self._settle()
        self._tick = clock.run, clock.tick
        if not self.without:
            return envelope
        robots = {sub_team: [r for r in names if r not in self.without] for sub_team, names in clock.robots.items()}
        return Envelope(envelope.key, encode(clock.model_copy(update={"robots": robots})))

    def _settle(self) -> None:
        """In lockstep let time pass until every board is done with its tick; it waits for two phases at most."""
        start = self._running.now
        self._pass_time(start)
        end = start + (1.0 + LONGER) * self.scenario.board.patience + 1.0
        while any(board.is_busy for board in self._boards.values()) and self._step(end):
            pass
        self._behind += self._running.now - start

    def _pass_time(self, until: float) -> None:
        """Let time pass until then; of a silence of more than `LONGEST` only its last part."""
        self._running.now = max(self._running.now, until - LONGEST)
        while self._step(until):
            pass
        self._running.now = max(self._running.now, until)

    def _step(self, end: float) -> bool:
        """Deliver one message, or wake one board. False: nothing is to be done until `end`, or boards were woken too often."""
        may_wake = self.output.counters["woken"] < self._wakes
        return (may_wake or bool(self._bus.waiting)) and self._running.step(end)


def _ends(tape: Tape) -> dict[int, tuple[str, str]]:
    """Where the life of a board ends: its token goes, and its next journal, if there is one, is of another life.

    A token also goes where the network does; then the board lives on, with all that it holds.
    """
    began: dict[tuple[str, str], float] = {}  # of the next journal, looking back from the end
    gone: dict[tuple[str, str], tuple[int, float | None]] = {}  # the next token that goes, and what came next then
    ends = {}
    for number, (_, envelope) in reversed(list(enumerate(tape.envelopes))):
        if envelope.kind is Kind.GONE and (parts := keys.BOARD.match(envelope.key)):
            board = parts["sub_team"], parts["board"]
            gone[board] = number, began.get(board)
        for _, parts, journal in messages([(0.0, envelope)], keys.JOURNAL, Journal):
            board = parts["sub_team"], parts["board"]
            if board in gone:
                number_gone, next_began = gone.pop(board)
                if next_began != journal.began:
                    ends[number_gone] = board
            began[board] = journal.began
    return ends | {number: board for board, (number, _) in gone.items()}
