"""What is on a tape, for those that need all of it at once: replays, tables, summaries."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from blackboard.config import Scenario, load
from blackboard.errors import Refused, UserError
from blackboard.tape.file import TapeAbout, look_through
from blackboard.tape.journal import Life, digest, lives
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MODELS, Clock, Journal
from blackboard.wire.types import Message

M = TypeVar("M", bound=Message)


@dataclass
class Tape:
    """A tape in memory."""

    scenario: Scenario
    envelopes: list[tuple[float, Envelope]]  # Unix time of arrival at the recorder, in order of arrival
    about: TapeAbout

    @cached_property
    def lives(self) -> list[Life]:
        """The boards that kept a journal, each from its start to its end."""
        return lives(journal for _, _, journal in messages(self.envelopes, keys.JOURNAL, Journal))

    @cached_property
    def by_digest(self) -> dict[str, Envelope]:
        """All messages by the names that journals give them."""
        puts = (envelope for _, envelope in self.envelopes if envelope.kind is Kind.PUT)
        return {digest(envelope): envelope for envelope in puts if keys.JOURNAL.match(envelope.key) is None}

    @cached_property
    def runs(self) -> list[str]:
        """The runs of the worlds on the tape, in their order; none where there was no world."""
        return list(dict.fromkeys(clock.run for _, _, clock in messages(self.envelopes, keys.CLOCK, Clock)))


def load_tape(path: str | Path, scenario: str | None = None) -> Tape:
    """A whole tape. `scenario` is a file, or the name of one, to be used instead of the recorded one.

    UserError: the file is no tape or broken, or its scenario is neither on it nor given.
    """
    about = TapeAbout()
    path = Path(path)
    envelopes = list(look_through(path, about))
    if scenario is None and about.scenario is None:
        raise UserError(f"{path}: was recorded without a scenario; give the team's with --scenario")
    chosen = load(scenario) if scenario is not None else Scenario(about.scenario or {}, f"{path} (its scenario)")
    _ = chosen.team, chosen.grid, chosen.time, chosen.board
    return Tape(chosen, envelopes, about)


def messages(
    envelopes: list[tuple[float, Envelope]], topic: keys.Topic, model: type[M]
) -> Iterator[tuple[float, dict[str, str], M]]:
    """The messages of one topic that can be read, with their times and the parts of their keys."""
    assert MODELS[topic.message] is model
    for at, envelope in envelopes:
        parts = topic.match(envelope.key)
        if parts is not None and envelope.kind is Kind.PUT:
            try:
                yield at, parts, decode(model, envelope.payload)
            except Refused:
                continue


def cut(
    envelopes: Iterator[tuple[float, Envelope]], start: float, end: float, keep: Callable[[str], bool]
) -> Iterator[tuple[float, Envelope]]:
    """What arrived from `start` until before `end`, in seconds after the first envelope, on keys that are to be kept.

    Tokens that are held at the start come first, at its time.
    """
    begin: float | None = None
    held: dict[str, None] | None = {}
    for at, envelope in envelopes:
        begin = at if begin is None else begin
        if held is not None and at - begin >= start:
            yield from ((begin + start, Envelope(token, kind=Kind.ALIVE)) for token in held)
            held = None
        if at - begin >= end:
            return
        if not keep(envelope.key):
            continue
        if held is None:
            yield at, envelope
        elif envelope.kind is Kind.ALIVE:
            held[envelope.key] = None
        elif envelope.kind is Kind.GONE:
            held.pop(envelope.key, None)


def summary(tape: Tape) -> dict[str, Any]:
    """What is on a tape, as JSON: times in seconds, sizes in bytes of payload."""
    seconds = tape.envelopes[-1][0] - tape.envelopes[0][0] if tape.envelopes else 0.0
    topics: dict[str, dict[str, int]] = {}
    for _, envelope in tape.envelopes:
        parsed = keys.parse(envelope.key)
        counts = topics.setdefault(parsed[0].name if parsed else "other", {"messages": 0, "bytes": 0, "events": 0})
        counts["messages" if envelope.kind is Kind.PUT else "events"] += 1
        counts["bytes"] += len(envelope.payload)
    return {
        **{name: text for name, text in tape.about.metadata.items() if name != "scenario"},
        "scenario": bool(tape.about.metadata.get("scenario")),
        "seconds": round(seconds, 3),
        "messages": len(tape.envelopes),
        "bytes": sum(counts["bytes"] for counts in topics.values()),
        "topics": topics,
        "runs": tape.runs,
        "boards": [
            {
                "board": f"{life.sub_team}/{life.board}",
                "events": len(life.events),
                "gaps": len(life.gaps),
                "whole": not life.first,
            }
            for life in tape.lives
        ],
        "link": tape.about.link,
    }
