"""What a board remembers of its sources, as bytes and back: learner and dissent of a level. Pure.

Who goes on from it does what the board does, to the bit. What another board says is checked as everything is: whatever comes,
`remembered` gives a learner within the bounds that it keeps by itself, or refuses.
"""

from collections import deque
from itertools import combinations

import numpy as np

from blackboard.board.dissent import DissentJudge, Standing
from blackboard.board.factors import Comparison
from blackboard.board.learning import Learner
from blackboard.errors import Refused
from blackboard.opinion.believed import MAX_SOURCES, MAX_SUBJECTS, PAIR_WINDOW, Verdicts
from blackboard.opinion.grid import Array
from blackboard.wire.memory import PackedLearner, PackedMemory, PackedNewest, PackedStanding
from blackboard.wire.types import LARGEST

SAMPLE = np.dtype([("a", "<f4"), ("alike", "<f2"), ("turned", "<f2")])
FLOAT = np.dtype("<f8")


# --- out -----------------------------------------------------------------------------------------------------------------


def packed_memory(learner: Learner, dissent: DissentJudge) -> PackedMemory:
    """All that the two remember, or of the judgements of more subjects than a message holds the newest."""
    judged = sorted(dissent.judged_at.items(), key=lambda judged_at: (-judged_at[1], judged_at[0]))[:MAX_SUBJECTS]
    return PackedMemory(
        learner=_packed_learner(learner),
        standings=[_packed_standing(dissent, source) for source in sorted(dissent.heard)],
        judged=dict(sorted(judged)),
        second=dissent.second if np.isfinite(dissent.second) else None,
        camps={subject: [sorted(camp) for camp in camps] for subject, camps in sorted(dissent.camps.items())},
    )


def _packed_learner(learner: Learner) -> PackedLearner:
    sources = sorted(learner.heard)
    place = {source: i for i, source in enumerate(sources)}
    windows = [learner.samples.get(pair, ()) for pair in combinations(sources, 2)]
    samples = np.array(
        [(sample.a, sample.alike, sample.turned) for window in windows for sample in window], dtype=SAMPLE
    )
    newest = [
        PackedNewest(
            subject=subject,
            time=time,
            sources=bytes(place[source] for source in sorted(means)),
            means=np.array([means[source] for source in sorted(means)], dtype=FLOAT).tobytes(),
        )
        for subject, (time, means) in sorted(learner.last.items())
    ]
    return PackedLearner(
        sources=sources,
        heard=dict(sorted(learner.heard.items())),
        since=dict(sorted(learner.since.items())),
        counts=bytes(len(window) for window in windows),
        samples=samples.tobytes(),
        newest=newest,
    )


def _packed_standing(dissent: DissentJudge, source: str) -> PackedStanding:
    standing = dissent.standings.get(source, Standing())
    pending = [-sigmas if contradicts else sigmas for contradicts, sigmas in dissent.pending.get(source, [])]
    return PackedStanding(
        source=source,
        heard=dissent.heard[source],
        share=standing.verdicts.share,
        seconds=standing.verdicts.number,
        sigmas=standing.verdicts.sigmas,
        since=standing.since,
        pending=np.array(pending, dtype=FLOAT).tobytes(),
    )


# --- in ------------------------------------------------------------------------------------------------------------------


def remembered(packed: PackedMemory, level: str, until: float, axes: int) -> tuple[Learner, DissentJudge]:
    """A learner and a dissent that go on from a memory, on a grid of so many axes.

    Refused: "fields" where a number is out of its bounds, or a time later than `until`, in seconds of team time.
    """
    return _learner(packed.learner, level, until, axes), _dissent(packed, level, until)


def _check(holds: bool, what: str) -> None:
    if not holds:
        raise Refused("fields", f"Memory: {what}")


def _check_times(times: list[float], until: float) -> None:
    _check(all(time <= until for time in times), "a time is later than the memory's own")


def _floats(data: bytes) -> Array:
    _check(len(data) % FLOAT.itemsize == 0, "bytes that are no floats")
    numbers = np.frombuffer(data, FLOAT).astype(float)
    _check(bool((np.abs(numbers) <= LARGEST).all()), "a number is not finite, or too large")
    return numbers


def _learner(packed: PackedLearner, level: str, until: float, axes: int) -> Learner:
    sources, n = packed.sources, len(packed.sources)
    _check(n <= MAX_SOURCES and sources == sorted(set(sources)), f"sources are not sorted, or more than {MAX_SOURCES}")
    _check(set(packed.heard) == set(sources) and packed.since.keys() <= set(sources), "a time of no source")
    _check_times([*packed.heard.values(), *packed.since.values(), *(newest.time for newest in packed.newest)], until)
    samples = _samples(packed, n * (n - 1) // 2)
    last: dict[str, tuple[float, dict[str, Array]]] = {}
    for newest in packed.newest:
        who, means = list(newest.sources), _floats(newest.means)
        _check(who == sorted(set(who)) and all(i < n for i in who), "a comparison of no source")
        _check(len(means) == axes * len(who), f"means on another number of axes than {axes}")
        last[newest.subject] = (
            newest.time,
            dict(zip((sources[i] for i in who), means.reshape(len(who), axes), strict=True)),
        )
    learner = Learner(level)
    learner.remember(
        {pair: window for pair, window in zip(combinations(sources, 2), samples, strict=True) if window},
        dict(packed.heard),
        last,
        dict(packed.since),
    )
    return learner


def _samples(packed: PackedLearner, pairs: int) -> list[deque[Comparison]]:
    counts = list(packed.counts)
    _check(
        len(counts) == pairs and all(count <= PAIR_WINDOW for count in counts),
        f"no count up to {PAIR_WINDOW} for each pair",
    )
    _check(len(packed.samples) == SAMPLE.itemsize * sum(counts), "another number of samples than is counted")
    samples = np.frombuffer(packed.samples, SAMPLE)
    a, alike, turned = (samples[name].astype(float) for name in ("a", "alike", "turned"))
    _check(bool(((a >= 0) & (a <= LARGEST)).all()), "a squared distance is negative, or not finite")
    _check(bool(((alike >= 0) & (alike <= 1)).all()), "a likeness is not between 0 and 1")
    _check(bool((np.isnan(turned) | (np.abs(turned) <= 1)).all()), "no cosine")
    rest = iter(zip(a.tolist(), alike.tolist(), turned.tolist(), strict=True))
    return [deque((Comparison(*next(rest)) for _ in range(count)), maxlen=PAIR_WINDOW) for count in counts]


def _dissent(packed: PackedMemory, level: str, until: float) -> DissentJudge:
    standings = {standing.source: standing for standing in packed.standings}
    _check(len(standings) == len(packed.standings), "a source has two standings")
    times = [time for standing in packed.standings for time in (standing.heard, standing.since) if time is not None]
    _check_times([*times, *packed.judged.values(), *([] if packed.second is None else [packed.second])], until)
    _check(all(standing.share <= 1 for standing in packed.standings), "a share above 1")
    dissent = DissentJudge(level)
    dissent.camps = {subject: [frozenset(camp) for camp in camps] for subject, camps in packed.camps.items()}
    dissent.judged_at = dict(packed.judged)
    dissent.second = dissent.second if packed.second is None else packed.second
    for source, standing in standings.items():
        dissent.heard[source] = standing.heard
        verdicts = Verdicts(standing.share, standing.seconds, standing.sigmas)
        dissent.standings[source] = Standing(verdicts, since=standing.since, logged=standing.since is not None)
        pending = _floats(standing.pending)
        if len(pending):
            dissent.pending[source] = [(bool(np.signbit(x)), abs(float(x))) for x in pending]
    return dissent
