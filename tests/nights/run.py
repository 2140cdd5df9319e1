"""A night from its beginning to its verdict."""

import logging
import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import NamedTemporaryFile

from blackboard.process import intake
from blackboard.tape.content import load_tape
from blackboard.tape.journal import TOO_LARGE
from blackboard.tape.replay import is_consensus, replay
from tests.nights.ages import AgesAreTrue, NothingIsFromLater
from tests.nights.clocks import ClocksAreKnown, RunsAreNew, TracksAreNumberedOn
from tests.nights.events import Event, opened
from tests.nights.faults import Crowd
from tests.nights.gains import GainsAddUp
from tests.nights.intakes import EarlyIsKept
from tests.nights.ledger import EvidenceCountsOnce, SameEvidenceSameBits, SightingsAreJudged, SightingsAreToldOnce
from tests.nights.night import Night, draw_night
from tests.nights.oracles import (
    Broken,
    BytesSayIt,
    Coverage,
    EveryTickIsSettled,
    InvariantsHold,
    NobodyDies,
    NobodyWaits,
    NothingGrows,
    Oracle,
    ProvenanceIsWhole,
    StatusesAreTrue,
    TheNewestCounts,
)
from tests.nights.parts import LeadersSpeak, SomebodySpeaks
from tests.nights.receipts import EvidenceReachesAll, HeardIsSettled, RobotsAreKnown
from tests.nights.rosters import EarlyIsTaken, RostersAreTrue
from tests.nights.stage import Stage
from tests.nights.votes import BoardsAgreeAgain, OneVote, TheHonestCount
from tests.nights.waits import (
    BoardsWaitForForwards,
    BoardsWaitForReports,
    LateAreWaitedForAgain,
    LockstepIsWhole,
    RobotsWaitForTheAgreed,
)

ORACLES: tuple[type[Oracle], ...] = (
    BytesSayIt, NobodyDies, InvariantsHold, NothingGrows, EveryTickIsSettled, StatusesAreTrue, ProvenanceIsWhole, EvidenceCountsOnce,
    SightingsAreToldOnce, SightingsAreJudged, SameEvidenceSameBits, TheNewestCounts, TheHonestCount, RostersAreTrue, EarlyIsTaken, SomebodySpeaks, NobodyWaits,
    BoardsAgreeAgain, Coverage, OneVote, HeardIsSettled, EvidenceReachesAll, RobotsAreKnown,
    LeadersSpeak, EarlyIsKept, AgesAreTrue, NothingIsFromLater, RunsAreNew, ClocksAreKnown, TracksAreNumberedOn, GainsAddUp,
    RobotsWaitForTheAgreed, BoardsWaitForForwards, BoardsWaitForReports, LockstepIsWhole, LateAreWaitedForAgain,
)  # fmt: skip

REPLAYED = 8  # of so many nights one is recorded, and its tape replayed


class Watch:
    """Oracles that see the events of a night."""

    def __init__(self, oracles: Sequence[Oracle]) -> None:
        self.oracles = oracles
        self._by_kind: dict[type[Event], list[Oracle]] = defaultdict(list)
        for oracle in oracles:
            for kind in oracle.sees:
                self._by_kind[kind].append(oracle)

    def tell(self, event: Event) -> None:
        for oracle in self._by_kind.get(type(event), ()):
            oracle.see(event)

    def verdict(self) -> Broken | None:
        """What was broken first."""
        failures = [broken for oracle in self.oracles if (broken := oracle.verdict())]
        return min(failures, key=lambda failure: failure.at, default=None)


@contextmanager
def opened_once() -> Iterator[None]:
    """Messages are opened once for all processes of this one."""
    before, intake.open_envelope = intake.open_envelope, opened  # type: ignore[attr-defined]
    try:
        yield
    finally:
        intake.open_envelope = before  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Outcome:
    """How a night ended: what was broken first, what is judged over many nights, and its seconds of processor time."""

    night: Night
    broken: Broken | None
    sums: Counter[str]
    seconds: float


def lived(night: Night, oracles: Sequence[type[Oracle]] = ORACLES) -> Outcome:
    """Live through a night."""
    began = time.process_time()
    watch = Watch([oracle(night) for oracle in oracles])
    stage = Stage(night, watch.tell, record=night.seed % REPLAYED == 0)
    with opened_once():
        stage.play()
        broken = watch.verdict() or (differs(stage) if stage.records else None)
    sums = sum((oracle.sums() for oracle in watch.oracles), Counter[str]())
    return Outcome(night, broken, sums, time.process_time() - began)


def differs(stage: Stage) -> Broken | None:
    """What is on the tape of a night and not in its replay: every consensus that was recorded must be there, to the bit.

    A tape has room for so many keys, which two crowds exceed; what it left out it must have counted. A board misses each at most once.
    From where it misses what the team itself said, on a key that came later, it may do otherwise.
    """
    with NamedTemporaryFile(suffix=".mcap") as file:
        file.write(stage.disk.getvalue())
        file.flush()
        tape = load_tape(file.name)
    strangers = {name for fault in stage.night.faults if isinstance(fault, Crowd) for name in fault.names}
    unrecorded = int(tape.about.link.get("too_many_keys", 0)) * len(tape.lives)
    there = {TOO_LARGE, *tape.by_digest, *(stage.strange if unrecorded else ())}
    lacking = (at for life in tape.lives for at, what, name in life.events if what == "put" and name not in there)
    until = min(lacking, default=math.inf) if unrecorded else math.inf
    made = (envelope for at, envelope in tape.envelopes if at < until and is_consensus(envelope))
    recorded = Counter(envelope for envelope in made if getattr(opened(envelope)[2], "board", None) not in strangers)
    replayed = replay(tape)
    left = recorded - Counter(envelope for _, envelope in replayed.output.sent)
    if not left and replayed.missing <= unrecorded and not replayed.gaps:
        return None
    what = f"{left.total()} of {recorded.total()} consensuses are otherwise in the replay of the tape"
    return Broken(stage.at, "TapeReplays", f"{what}, {replayed.missing} messages and {replayed.gaps} gaps")


def quietly(night: tuple[int, int]) -> Outcome:
    """Live through the night of a seed and a number without its logs; other processes can be given this function."""
    logging.disable(logging.CRITICAL)
    return lived(draw_night(*night))


def live(night: Night, oracles: Sequence[type[Oracle]] = ORACLES) -> Broken | None:
    """Live through a night: what was broken first, or nothing."""
    return lived(night, oracles).broken


def played(night: Night, until: float = math.inf) -> list[Event]:
    """The events of a night, or of its first seconds."""
    events = list[Event]()
    Stage(night, events.append).play(until)
    return events


def judged(oracle: Oracle, events: Iterable[Event]) -> str:
    """What an oracle finds broken by events; empty: nothing."""
    watch = Watch([oracle])
    for event in events:
        watch.tell(event)
    return str(watch.verdict() or "")


def recorded(night: Night) -> bytes:
    """The tape of a night."""
    stage = Stage(night, lambda event: None, record=True)
    stage.play()
    return stage.disk.getvalue()


#: Between which shares the regions of 50 and of 95 % hold the truth, over all nights together.
CALIBRATED = {"0.5": (0.45, 0.55), "0.95": (0.93, 0.97)}
MOST = 2.0  # how much farther off the honest are while one robot lies, over all lies, at most
ENOUGH_LIED = 3000  # beliefs about the honest on nights with a liar
KNOWN = 0.75  # of the variance that robots have of their places by themselves, that joints have on average, at most
ENOUGH_KNOWN = 200  # robots, in joints
ENOUGH = 10_000  # beliefs; those of a night err together, so that fewer say little


def coverage(sums: Counter[str]) -> dict[str, float]:
    """Of all nights together: which share of the regions of each size holds the truth; empty where nothing was scored."""
    n = sums["coverage n"]
    return {share: sums[f"coverage {share}"] / n for share in CALIBRATED} if n else {}


def moved(sums: Counter[str]) -> float:
    """By which factor the agreed places of honest robots are farther off while one robot lies; 1 where none was scored."""
    if not (sums["lied n"] and sums["calm off"]):
        return 1.0
    return (sums["lied off"] / sums["lied n"]) / (sums["calm off"] / sums["calm n"])


def known(sums: Counter[str]) -> float:
    """The variance that joints have of robots' places over that of the robots by themselves, on average; 0 where none was seen."""
    return sums["known"] / max(1, sums["known n"])


def uncalibrated(sums: Counter[str]) -> list[str]:
    """What is wrong with the coverage, the votes, and what joints know, of all nights together, in sentences."""
    n = sums["coverage n"]
    covered = coverage(sums) if n >= ENOUGH else {}
    share = moved(sums)
    votes = [f"one liar moves the honest {share:.2f} times as far off as they are, not {MOST:g}"]
    vague = [
        f"joints know robots with {known(sums):.2f} times the variance of their own filters on average, not {KNOWN:g}"
    ]
    doubts = vague * (sums["known n"] >= ENOUGH_KNOWN and known(sums) > KNOWN)
    doubts += votes * (sums["lied n"] >= ENOUGH_LIED and share > MOST)
    return doubts + [
        f"the {float(share):.0%} regions of {n} agreed beliefs hold the truth in {covered[share]:.1%}, not {low:.0%} to {high:.0%}"
        for share, (low, high) in CALIBRATED.items()
        if covered and not low <= covered[share] <= high
    ]
