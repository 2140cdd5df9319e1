"""What a board remembers, packed and taken over: the same to the bit from then on, and nothing that is out of bounds."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.board.dissent import DissentJudge
from blackboard.board.learning import Learner
from blackboard.board.memory import SAMPLE, packed_memory, remembered
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.believed import MAX_SOURCES, PAIR_WINDOW
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.pools import fuse_belief
from blackboard.opinion.provenance import Opinion
from blackboard.wire.codec import decode, encode
from blackboard.wire.memory import Memory, PackedLearner, PackedMemory
from blackboard.wire.raw import MAX_BYTES
from tests.board.opinions import opinion, stream
from tests.board.reports import GRID
from tests.wire.messages import MEMORY

EMPTY = PackedMemory(learner=PackedLearner())


def pool(opinions: Any) -> Belief:
    return Belief(GRID, fuse_belief(Coalition(), np.stack([heard.belief.p for heard in opinions]), GRID))


def hear(learner: Learner, dissent: DissentJudge, time: float, opinions: list[Opinion]) -> None:
    for k, subject in enumerate(("object/ball", "robot/r1")):
        learner.compare_opinions(subject, time, opinions[k:])
        dissent.judge_opinions(subject, time, opinions[k:], pool)


def sent(packed: PackedMemory) -> PackedMemory:
    """What arrives of a memory on the wire."""
    return decode(
        Memory, encode(Memory(board="a1", sub_team="a", tick=1, time=1e6, consensus=packed, agreed=EMPTY))
    ).consensus


@pytest.mark.parametrize("handed_on", [37, *(pytest.param(n, marks=pytest.mark.long) for n in (0, 3, 150))])
def test_who_goes_on_from_a_memory_does_the_same_to_the_bit(handed_on: int) -> None:
    """With a liar, errors that last, and four ticks a second: in the middle of a second, too."""
    learner, dissent = Learner("consensus"), DissentJudge("consensus")
    heirs: tuple[Learner, DissentJudge] | None = None
    for tick, opinions in enumerate(stream(5, 240, liar=12.0, memory=0.8)):
        hear(learner, dissent, 0.25 * tick, opinions)
        if heirs is not None:
            hear(*heirs, 0.25 * tick, opinions)
        if tick == handed_on:
            heirs = remembered(sent(packed_memory(learner, dissent)), "consensus", 1e6, 2)
    assert heirs is not None
    assert packed_memory(*heirs) == packed_memory(learner, dissent)
    assert heirs[0].learned() == learner.learned()
    advice, expected = (heir.advice([f"s{i}" for i in range(5)], [2.0] * 5) for heir in (learner, heirs[0]))
    assert (advice.independence, advice.powers.tolist()) == (expected.independence, expected.powers.tolist())
    assert advice.independence != 0.2
    assert heirs[1].named() == dissent.named() != []


def test_a_memory_is_small_and_that_of_the_most_sources_fits_a_message() -> None:
    learner = Learner("consensus")
    for second in range(PAIR_WINDOW):
        learner.compare_opinions("object/ball", float(second), [opinion(f"r{i}", (10 + i, 10)) for i in range(8)])
    packed = packed_memory(learner, DissentJudge("x"))
    memory = Memory(board="a1", sub_team="a", tick=1, time=1e6, consensus=packed, agreed=EMPTY)
    assert len(encode(memory)) < 13_000
    pairs = MAX_SOURCES * (MAX_SOURCES - 1) // 2
    assert pairs * PAIR_WINDOW * SAMPLE.itemsize < 0.8 * MAX_BYTES


# --- what is refused ------------------------------------------------------------------------------------------------------

LEARNER, STANDING = MEMORY.consensus.learner, MEMORY.consensus.standings[0]
NEWEST = LEARNER.newest[0]
NAN = math.nan


def sample(a: float, alike: float, turned: float) -> bytes:
    return np.array([(a, alike, turned)], SAMPLE).tobytes()


WRONG_LEARNERS: dict[str, dict[str, Any]] = {
    "not sorted": {"sources": ["r2", "r1"]},
    "twice": {"sources": ["r1", "r1"]},
    "heard of others": {"heard": {"r1": 0.1, "r9": 0.1}},
    "heard later": {"heard": {"r1": 0.1, "r2": 0.7}},
    "since of others": {"since": {"r9": 0.1}},
    "since later": {"since": {"r1": 0.7}},
    "a pair too many": {"counts": b"\x01\x00"},
    "more than a window": {"counts": bytes([PAIR_WINDOW + 1]), "samples": sample(1, 1, 0) * (PAIR_WINDOW + 1)},
    "fewer samples": {"counts": b"\x02"},
    "half a sample": {"samples": LEARNER.samples[:-1]},
    "a below 0": {"samples": sample(-1, 1, 0)},
    "a without end": {"samples": sample(np.inf, 1, 0)},
    "a that is none": {"samples": sample(NAN, 1, 0)},
    "alike above 1": {"samples": sample(1, 1.5, 0)},
    "alike that is none": {"samples": sample(1, NAN, 0)},
    "no cosine": {"samples": sample(1, 1, 1.5)},
    "newest of others": {"newest": [NEWEST.model_copy(update={"sources": b"\x00\x07"})]},
    "newest twice": {"newest": [NEWEST.model_copy(update={"sources": b"\x00\x00"})]},
    "newest later": {"newest": [NEWEST.model_copy(update={"time": 0.7})]},
    "on three axes": {"newest": [NEWEST.model_copy(update={"means": np.arange(6.0).tobytes()})]},
    "a mean that is none": {"newest": [NEWEST.model_copy(update={"means": np.full(4, NAN).tobytes()})]},
    "a mean too far": {"newest": [NEWEST.model_copy(update={"means": np.full(4, 1e300).tobytes()})]},
}
WRONG: dict[str, dict[str, Any]] = {
    **{why: {"learner": LEARNER.model_copy(update=what)} for why, what in WRONG_LEARNERS.items()},
    "too many": {"learner": LEARNER.model_copy(update={"sources": [f"r{i:03}" for i in range(MAX_SOURCES + 1)]})},
    "two standings": {"standings": [STANDING, STANDING]},
    "judged later": {"judged": {"object/ball": 0.7}},
    "a second later": {"second": 0.7},
    "heard later there": {"standings": [STANDING.model_copy(update={"heard": 0.7})]},
    "named later": {"standings": [STANDING.model_copy(update={"since": 0.7})]},
    "a share above 1": {"standings": [STANDING.model_copy(update={"share": 1.5})]},
    "sigmas that are none": {"standings": [STANDING.model_copy(update={"pending": np.array([NAN]).tobytes()})]},
    "half a float": {"standings": [STANDING.model_copy(update={"pending": b"1234"})]},
}


@pytest.mark.parametrize("why", WRONG)
def test_what_is_out_of_bounds_is_refused(why: str) -> None:
    remembered(MEMORY.consensus, "consensus", 0.6, 2)
    with pytest.raises(Refused, match="Memory: "):
        remembered(MEMORY.consensus.model_copy(update=WRONG[why]), "consensus", 0.6, 2)


@given(
    samples=st.lists(
        st.tuples(st.floats(0, 1e12), st.floats(0, 1), st.floats(-1, 1) | st.just(NAN)), min_size=50, max_size=150
    ),
    since=st.booleans(),
)
def test_whatever_a_memory_says_within_its_bounds_the_advice_is_sound(
    samples: list[tuple[float, float, float]], since: bool
) -> None:
    counts = [PAIR_WINDOW, len(samples[50:100]), len(samples[100:150])]
    learner = {
        "sources": ["s0", "s1", "s2"],
        "heard": dict.fromkeys(["s0", "s1", "s2"], 0.0),
        "since": {"s0": 0.0} if since else {},
        "counts": bytes(counts),
        "samples": np.array(samples[: sum(counts)], SAMPLE).tobytes(),
    }
    packed = PackedMemory.model_validate({"learner": learner})
    heir, _ = remembered(packed, "consensus", 0.0, 2)
    advice = heir.advice(["s0", "s1", "s2"], [1.0, 2.0, 3.0])
    assert 0 <= advice.independence <= 1
    assert ((advice.powers > 0) & (advice.powers <= 1)).all()
    heir.compare_opinions(
        "object/ball", 5.0, [Opinion(f"s{i}", gaussian(GRID, (10, 10 + i), 2.0), {f"s{i}": 5.0}) for i in range(3)]
    )
    assert all(math.isfinite(entry.variance) for entry in heir.learned())
