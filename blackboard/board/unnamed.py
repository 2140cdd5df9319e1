"""Sightings that name a class only, for a consensus and a status: which subjects they may show, and counts. Pure."""

from collections.abc import Iterable, Iterator

from blackboard.opinion.gaussian.naming import Unnamed
from blackboard.wire.messages import UnnamedSighting
from blackboard.wire.types import MAX_OPINIONS


def may_be(subject: str, unnamed: Iterable[Unnamed]) -> list[UnnamedSighting]:
    """The unnamed sightings that may be of a subject, the likeliest first."""
    sightings = [
        UnnamedSighting(
            source=sighting.source.removeprefix("robot/"),
            time=sighting.time,
            mark=sighting.mark,
            probability=min(1.0, sighting.odds[subject]),
            taken=sighting.taken == subject,
        )
        for sighting in unnamed
        if sighting.odds and subject in sighting.odds
    ]
    return sorted(sightings, key=lambda sighting: -sighting.probability)[:MAX_OPINIONS]


def counters(unnamed: Iterable[Unnamed]) -> Iterator[str]:
    """The counter of a status that each of them is for: what became of it."""
    for sighting in unnamed:
        yield f"unnamed_{'taken' if sighting.taken is not None else 'strange' if sighting.is_strange else 'ambiguous'}"
