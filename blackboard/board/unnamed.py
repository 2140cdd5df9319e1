"""Sightings that name a class only, for a consensus and a status: which subjects they may show, and counts. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from blackboard.opinion.gaussian.naming import Unnamed
from blackboard.wire.messages import UnnamedSighting
from blackboard.wire.types import MAX_OPINIONS


def may_be(subject: str, unnamed: Iterable[Unnamed]) -> list[UnnamedSighting]:
    """The unnamed sightings that may be of a subject, the likeliest first."""
    found = [
        UnnamedSighting(
            source=it.source.removeprefix("robot/"),
            time=it.time,
            mark=it.mark,
            probability=min(1.0, it.odds[subject]),
            taken=it.taken == subject,
        )
        for it in unnamed
        if it.odds and subject in it.odds
    ]
    return sorted(found, key=lambda it: -it.probability)[:MAX_OPINIONS]


def counters(unnamed: Iterable[Unnamed]) -> Iterator[str]:
    """The counter of a status that each of them is for: what became of it."""
    for it in unnamed:
        yield f"unnamed_{'taken' if it.taken is not None else 'strange' if it.is_strange else 'ambiguous'}"
