"""A tape as a table: a row for each tick, subject and level, with the error where the tape has the truth. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

from blackboard.errors import Refused
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score
from blackboard.tape.content import Tape
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, PackedBelief, Solo, Truth


@dataclass(frozen=True)
class Row:
    """A belief; places in the grid's unit. What depends on the truth is None where the tape does not have it."""

    run: str  # of the world; empty without one
    tick: int
    time: float  # team time, seconds
    level: str  # "solo", "consensus" or "agreed"
    by: str  # the robot of a solo belief, else the board
    sub_team: str  # of the board
    subject: str
    mean_x: float
    mean_y: float
    entropy: float  # nats
    truth_x: float | None
    truth_y: float | None
    error: float | None  # distance of the mean from the truth
    log_score: float | None  # nats
    region: float | None  # mass of the smallest highest-density region that reaches the truth


COLUMNS = tuple(field.name for field in fields(Row))


def rows(tape: Tape) -> Iterator[Row]:
    """The rows of a tape in order of arrival; one that came again comes again. The truth of a tick comes before its beliefs."""
    grid, run, truths = tape.scenario.grid, "", dict[tuple[str, int], Truth]()
    topics = (keys.TRUTH, keys.SOLO, keys.CONSENSUS, keys.AGREED)
    for _, envelope in tape.envelopes:
        if envelope.kind is not Kind.PUT or not any(topic.match(envelope.key) for topic in topics):
            continue
        message = _opened(envelope)
        if isinstance(message, Truth):
            run = message.run
            truths[run, message.tick] = message
        elif isinstance(message, Solo):
            for subject, packed in message.beliefs.items():
                known = truths.get((run, message.tick)), run
                yield from _row(grid, *known, message, "solo", message.robot, "", subject, packed)
        elif isinstance(message, Consensus):
            known = truths.get((run, message.tick)), run
            by = message.level, message.board, message.sub_team
            yield from _row(grid, *known, message, *by, message.subject, message.belief)


def _row(
    grid: Grid,
    truth: Truth | None,
    run: str,
    message: Solo | Consensus,
    level: str,
    by: str,
    sub_team: str,
    subject: str,
    packed: PackedBelief,
) -> Iterator[Row]:
    """The row of a belief; none for one that cannot be unpacked."""
    try:
        belief = unpack(packed, grid)
    except Refused:
        return
    (x, y), place = belief.mean().tolist(), truth.positions.get(subject) if truth is not None else None
    score = Score()
    score.add(belief, place if place is not None else (x, y))
    known = place is not None
    yield Row(
        run=run,
        tick=message.tick,
        time=message.time,
        level=level,
        by=by,
        sub_team=sub_team,
        subject=subject,
        mean_x=x,
        mean_y=y,
        entropy=score.entropies[0],
        truth_x=place[0] if place is not None else None,
        truth_y=place[1] if place is not None else None,
        error=score.errors[0] if known else None,
        log_score=score.log_scores[0] if known else None,
        region=score.levels[0] if known else None,
    )


def _opened(envelope: Envelope) -> object:
    try:
        return open_envelope(envelope)[2]
    except Refused:
        return None
