"""Replay into boards: each board of a tape is given again what its journal says, at the same times. Pure.

So it does again what it did, to the bit, in every pace: nothing of it depends on the recorder's order of arrival.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from blackboard.board.service import BoardService, board_of
from blackboard.errors import Refused, UserError
from blackboard.net.bus import intersects
from blackboard.tape.content import Tape
from blackboard.tape.journal import TOO_LARGE, Life
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.memory import Memory


@dataclass
class Output:
    """What boards sent in a replay, and what the replay cost."""

    sent: list[tuple[str, Envelope]] = field(default_factory=list)  # the run that the board followed; consensuses only
    counters: Counter[str] = field(default_factory=Counter)  # "sent", "received", "dropped", "bytes", of envelopes
    refused: Counter[str] = field(default_factory=Counter)  # reason -> messages that boards refused

    def add_sent(self, service: BoardService, out: list[Envelope]) -> None:
        """Take what a board sends."""
        self.counters["sent"] += len(out)
        self.sent += [(service.clock.run, envelope) for envelope in out if is_consensus(envelope)]


@dataclass
class Replay:
    """A replay by the journals, and why it may differ from what was recorded."""

    output: Output = field(default_factory=Output)
    missing: int = 0  # messages that a board was given and that are not on the tape
    gaps: int = 0  # places at which a journal misses something
    late: list[str] = field(default_factory=list)  # boards whose beginning is not on the tape


def replay(tape: Tape, moved: Callable[[], None] = lambda: None) -> Replay:
    """Give every board what its journal says. `moved` is called after each event. UserError: there is no journal on the tape."""
    if not tape.lives:
        raise UserError(f"{tape.scenario.where}: no board on the tape kept a journal; boards of this version do")
    replayed = Replay()
    for life in tape.lives:
        _live_again(tape, life, replayed, moved)
    return replayed


def is_consensus(envelope: Envelope) -> bool:
    """Whether an envelope is a consensus or an agreed belief."""
    return keys.CONSENSUS.match(envelope.key) is not None or keys.AGREED.match(envelope.key) is not None


def _live_again(tape: Tape, life: Life, replayed: Replay, moved: Callable[[], None]) -> None:
    service, output = board_of(tape.scenario, life.sub_team, life.board), replayed.output
    replayed.gaps += len(life.gaps)
    if life.first:
        replayed.late.append(f"{life.sub_team}/{life.board}")
        for token in _held_before(tape, life):
            if any(intersects(key_expr, token) for key_expr in service.watches):
                service.receive(Envelope(token, kind=Kind.ALIVE), life.events[0][0])
    memories = _memories(tape, life)
    for number, (at, what, name) in enumerate(life.events, 1):
        if what == "wake":
            output.add_sent(service, service.wake(at))
        else:
            envelope = Envelope(name, kind=Kind(what)) if what != "put" else tape.by_digest.get(name)
            if envelope is None:  # nothing happens but that time passes, as with one that was too large
                replayed.missing += name != TOO_LARGE
                envelope = Envelope(name, kind=Kind.DELETE)
            output.counters["received"] += 1
            output.counters["bytes"] += len(envelope.payload)
            output.add_sent(service, service.receive(envelope, at))
        if number in memories:
            with suppress(Refused):
                service.board.remember(memories[number])
        moved()
    output.counters["dropped"] = replayed.missing
    output.refused += service.refused


def _memories(tape: Tape, life: Life) -> dict[int, Memory]:
    """After how many events a board whose beginning is missing is given what it remembered: from then on it knows as much.

    It is given that again for `max_age`, while what it held before the tape may still have a part in what it learns.
    """
    memories: dict[int, Memory] = {}
    for number, name in life.memories.items() if life.first else ():
        envelope = tape.by_digest.get(name)
        if envelope is not None:
            with suppress(Refused):
                memories[number] = decode(Memory, envelope.payload)
    begin = next(iter(memories.values())).time if memories else 0.0
    return {
        number: memory for number, memory in memories.items() if 0 <= memory.time - begin <= tape.scenario.board.max_age
    }


def _held_before(tape: Tape, life: Life) -> list[str]:
    """The tokens that are held when the journal of a board begins on the tape: those that it had heard of before."""
    key = keys.JOURNAL.key(team=tape.scenario.team.name, sub_team=life.sub_team, board=life.board)
    held: dict[str, None] = {}
    for _, envelope in tape.envelopes:
        if envelope.kind is Kind.ALIVE:
            held[envelope.key] = None
        elif envelope.kind is Kind.GONE:
            held.pop(envelope.key, None)
        elif envelope.key == key:
            break
    return list(held)
