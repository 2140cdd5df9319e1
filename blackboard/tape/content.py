"""What is on a tape, for those that need all of it at once: replays, tables, summaries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from blackboard.config import Scenario, load
from blackboard.errors import Refused, UserError
from blackboard.tape.file import About, look_through
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
    about: About

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


def load_tape(path: Path, scenario: str | None = None) -> Tape:
    """A whole tape. `scenario` is a file, or the name of one, to be used instead of the recorded one.

    UserError: it is no tape or broken, or nobody says which scenario it is of.
    """
    about = About()
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
