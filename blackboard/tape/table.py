"""A tape as a table: a row for each tick, subject and level, with the error where the tape has the truth. Pure."""

import math
from collections.abc import Iterator
from typing import Any

from blackboard.errors import Refused
from blackboard.judge import samples
from blackboard.judge.samples import sample_of
from blackboard.opinion.scores import Score
from blackboard.tape.content import Tape
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import message_in
from blackboard.wire.envelope import Kind
from blackboard.wire.messages import Consensus, PackedBelief, Solo, Truth

#: What a row has beside the fields of a sample: the world's run, empty without one; the robot of a solo belief, else the board.
OWN = {"run": "str", "by": "str"}
#: The columns, and their types. What depends on the truth is None where the tape does not have it.
COLUMNS = {
    name: {**samples.COLUMNS, **OWN}[name]
    for name in (
        *("run", "tick", "time", "level", "by", "sub_team", "subject", "mean_x", "mean_y", "entropy"),
        *("truth_x", "truth_y", "error", "log_score", "region"),
    )
}
TOPICS = (keys.TRUTH, keys.SOLO, keys.CONSENSUS, keys.AGREED)


def rows(tape: Tape) -> Iterator[dict[str, Any]]:
    """The rows of a tape in order of arrival; one that came again comes again. The truth of a tick comes before its beliefs."""
    run, truths = "", dict[tuple[str, int], Truth]()
    for _, envelope in tape.envelopes:
        if envelope.kind is not Kind.PUT or not any(topic.match(envelope.key) for topic in TOPICS):
            continue
        message = message_in(envelope)
        if isinstance(message, Truth):
            run = message.run
            truths[run, message.tick] = message
        elif isinstance(message, Solo):
            about = {"run": run, "level": "solo", "by": message.robot, "robot": message.robot, "sub_team": ""}
            for subject, packed in message.beliefs.items():
                yield from _row(tape, message, subject, packed, truths.get((run, message.tick)), about)
        elif isinstance(message, Consensus):
            about = {"run": run, "level": message.level, "by": message.board, "robot": "", "sub_team": message.sub_team}
            yield from _row(tape, message, message.subject, message.belief, truths.get((run, message.tick)), about)


def _row(
    tape: Tape,
    message: Solo | Consensus,
    subject: str,
    packed: PackedBelief,
    truth: Truth | None,
    about: dict[str, str],
) -> Iterator[dict[str, Any]]:
    """The row of a belief; none for one that cannot be unpacked."""
    try:
        belief = unpack(packed, tape.scenario.grid)
    except Refused:
        return
    place, score = truth.positions.get(subject) if truth is not None else None, Score()
    score.add(belief, belief.mean().tolist() if place is None else place)
    of_sample = {name: value for name, value in about.items() if name not in OWN}
    sample = sample_of(
        belief,
        score,
        place,
        tick=message.tick,
        time=message.time,
        subject=subject,
        area=math.nan,
        landmark_age=math.nan,
        **of_sample,
    )
    row = {**vars(sample), **about}
    yield {name: None if isinstance(row[name], float) and math.isnan(row[name]) else row[name] for name in COLUMNS}
