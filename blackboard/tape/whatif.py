"""What if: the boards of a tape with other settings, without somebody, or with losses. Pure.

What the world and the robots sent comes from the tape, in the recorder's order and at its times; what boards sent is made anew and
goes from board to board at once. So it is an estimate, not a repetition: in lockstep, where order and time do not matter, it is
exact where nothing is changed; in real time the boards see another order, by milliseconds. The robots do not hear the changed
boards. Readings do not depend on the team, but `informed` beliefs do, and so does where a joint lets a robot linearise: these
are those of the recorded run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

from blackboard.board.service import BoardService
from blackboard.config import Scenario
from blackboard.net.bus import Bus, BusLink
from blackboard.process.team_clock import Pace
from blackboard.tape.content import Tape, messages
from blackboard.tape.replay import Output, board_service
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Journal

OF_BOARDS = (keys.CONSENSUS, keys.AGREED, keys.FORWARD, keys.JOURNAL, keys.MEMORY, keys.REFUSED)
LONGEST = 600.0  # seconds
LATER = 1e-6  # seconds that pass after a board was woken, so that time moves even if it is due again at once


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
        self._bus = Bus()
        self._bus.lose = lambda envelope: keys.CLOCK.match(envelope.key) is None and lose(envelope)
        self._rest = self._bus.connect()  # what is played
        self._tokens: dict[str, BusLink] = {}  # each held by a link of its own, which is closed when the token goes
        self._boards: dict[tuple[str, str], tuple[BoardService, BusLink]] = {}
        self._tick = "", -1  # run and tick of the newest Clock
        self._now = -math.inf
        self._behind = 0.0  # seconds that were waited in lockstep and not in the recorded run

    def play(self, tape: Tape, moved: Callable[[], None]) -> Output:
        ends = _ends(tape)
        for number, (at, envelope) in enumerate(tape.envelopes):
            self._pass_time(at + self._behind)
            if number in ends:
                self._stop(ends[number])
            self._take(envelope)
            self._deliver()
            moved()
        self._settle()
        for service, _ in self._boards.values():
            self.output.refused += service.refused
        return self.output

    def _take(self, envelope: Envelope) -> None:
        found = keys.parse(envelope.key)
        if found is None:
            return
        topic, parts = found
        if self.without & {parts.get("robot"), parts.get("source"), parts.get("process")}:
            return
        board = parts.get("sub_team", ""), parts.get("board") or parts.get("process") or ""
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            if topic is keys.BOARD and envelope.kind is Kind.ALIVE and board not in self._boards:
                self._start(board)
            self._hold(envelope)
        elif topic is keys.CLOCK:
            self._rest.send(self._clock(envelope))
        elif topic not in OF_BOARDS and board not in self._boards:
            self._rest.send(self._change(envelope))

    def _stop(self, board: tuple[str, str]) -> None:
        if board in self._boards:
            service, link = self._boards.pop(board)
            self.output.refused += service.refused
            link.close()

    def _start(self, board: tuple[str, str]) -> None:
        service, link = board_service(self.scenario, *board), self._bus.connect()
        self._boards[board] = service, link
        for key_expr in service.watches:
            link.watch(key_expr)
        for key_expr in service.listens:
            link.subscribe(key_expr)

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

    # --- time -----------------------------------------------------------------------------------------------------------

    def _settle(self) -> None:
        """In lockstep let time pass until every board is done with its tick; it waits for two phases at most."""
        start = self._now
        end = start + 2 * self.scenario.board.patience + 1.0
        while self._now < end and any(_is_busy(service) for service, _ in self._boards.values()):
            due = min(_due(service, self._now) for service, _ in self._boards.values())
            self._pass_time(min(max(due, self._now) + LATER, end))
        self._behind += self._now - start

    def _pass_time(self, until: float) -> None:
        """Wake the boards that are due until then, the earliest first; of a silence of more than `LONGEST`, in its last part only."""
        self._now = max(self._now, until - LONGEST)
        while self._boards:
            service, link = min(self._boards.values(), key=lambda board: _due(board[0], self._now))
            due = _due(service, self._now)
            if due > until:
                break
            self._now = max(self._now, due)
            self._send(service, link, service.wake(self._now))
            self._deliver()
            self._now = max(
                self._now + LATER, math.nextafter(self._now, math.inf)
            )  # far from now, LATER is rounded away
        self._now = max(self._now, until)

    def _deliver(self) -> None:
        services = {link: service for service, link in self._boards.values()}
        while self._bus.waiting:
            link, envelope = self._bus.waiting.pop(0)
            service = services[link]
            self.output.counters["received"] += 1
            self.output.counters["bytes"] += len(envelope.payload)
            self._send(service, link, service.receive(envelope, self._now))

    def _send(self, service: BoardService, link: BusLink, out: list[Envelope]) -> None:
        self.output.take(service, out)
        for envelope in out:
            link.send(envelope)


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


def _is_busy(service: BoardService) -> bool:
    return service.clock.pace is Pace.LOCKSTEP and service.rounds.phase != "settled"


def _due(service: BoardService, now: float) -> float:
    at = service.wake_at(now)
    return math.inf if at is None else at
