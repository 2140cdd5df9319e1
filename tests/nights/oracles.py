"""What must be true every night: oracles that see everything, slow and obvious, each with one question.

An oracle sees events (`see`) and says at the end what it found broken first (`verdict`).

Long, because all that is promised stands in one list.
"""

import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blackboard.board.service import BoardService
from blackboard.opinion.scores import border_mass, hdr_level, held
from blackboard.process.team_clock import Pace
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus, Report, Status, Truth
from tests.nights.events import Began, Died, Ended, Event, Looked, Moved, Recovered, Said, Sensed, Unsound
from tests.nights.night import Night

READ = 16  # of so many messages one is read
SCORED = 3  # of so many ticks one is scored
SHARES = (0.5, 0.95)  # of the mass, of the regions that are scored
MOST_KEPT = 1060  # elements; the largest bound is 1024
OURS = {"blackboard", "robot_agent", "sim_world"}
PLAIN = (str, bytes, int, float, np.ndarray, type(None))
SLACK = 0.5  # seconds by which a phase may be open longer than its wait: it ends when its process is woken


@dataclass(frozen=True)
class Broken:
    """What an oracle found: when, in seconds of the night, and what."""

    at: float
    oracle: str
    what: str

    def __str__(self) -> str:
        return f"{self.oracle} at {self.at:.2f} s: {self.what}"


class Oracle:
    """One thing that must be true."""

    sees: tuple[type[Event], ...] = ()

    def __init__(self, night: Night) -> None:
        self.night = night
        self._broken: Broken | None = None

    def see(self, event: Event) -> None:
        """Take an event of one of the kinds in `sees`."""
        raise NotImplementedError

    def verdict(self) -> Broken | None:
        """What was broken first; None: nothing."""
        return self._broken

    def sums(self) -> Counter[str]:
        """What is judged over many nights together, to be added up."""
        return Counter()

    def breaks(self, at: float, what: str) -> None:
        self._broken = self._broken or Broken(at, type(self).__name__, what)


class BytesSayIt(Oracle):
    """What the processes of a night hear as it was written is what its bytes say."""

    sees = (Said,)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._said = 0

    def see(self, event: Event) -> None:
        assert isinstance(event, Said)
        self._said += 1
        heard = event.message
        if heard is not None and self._said % READ == 0 and decode(type(heard), event.envelope.payload) != heard:
            self.breaks(event.at, f"{event.process} says otherwise on {event.envelope.key} than its bytes")


class NobodyDies(Oracle):
    """No exception leaves a service, and where nobody lies none has to be survived."""

    sees = (Died, Ended)

    def see(self, event: Event) -> None:
        if isinstance(event, Died):
            self.breaks(event.at, f"{event.process} dies of {event.error!r:.200}")
        elif isinstance(event, Ended) and self.night.is_honest:
            intake: Any = getattr(event.service, "intake", None)
            if intake is not None and intake.counters["failed"]:
                self.breaks(event.at, f"{event.process} survived {intake.counters['failed']} exceptions")


class InvariantsHold(Oracle):
    """Queues, maps and states are within their bounds, and what a machine says of itself holds (`check`)."""

    sees = (Unsound,)

    def see(self, event: Event) -> None:
        if isinstance(event, Unsound):
            self.breaks(event.at, f"{event.process}: {event.error!r:.200}")


class NothingGrows(Oracle):
    """No collection in a process has more than `MOST_KEPT` elements, also after more strangers than that have spoken."""

    sees = (Looked,)

    def see(self, event: Event) -> None:
        assert isinstance(event, Looked)
        for path, size in collections_of(event.service):
            if size > MOST_KEPT:
                self.breaks(event.at, f"{event.process} keeps {size} elements in {path}")


def collections_of(root: object) -> Iterator[tuple[str, int]]:
    """The collections in an object and in what it consists of, with where they are and their sizes."""
    visited, left = {id(root)}, [("it", root)]
    while left:
        path, value = left.pop()
        inside: list[tuple[str, object]] = []
        if isinstance(value, Mapping):
            inside = [*((f"{path}[...]", value) for value in value.values())]
        elif isinstance(value, list | tuple | set | frozenset | deque):
            inside = [(f"{path}[...]", value) for value in value]
        elif type(value).__module__.split(".")[0] in OURS:
            names = [*getattr(value, "__dict__", ()), *getattr(type(value), "__slots__", ())]
            inside = [(f"{path}.{name}", getattr(value, name, None)) for name in names]
        if isinstance(value, Mapping | list | tuple | set | frozenset | deque):
            yield path, len(value)
        fresh = [(where, value) for where, value in inside if not isinstance(value, PLAIN) and id(value) not in visited]
        visited |= {id(value) for _, value in fresh}
        left += fresh


class EveryTickIsSettled(Oracle):
    """A board settles every tick that it begins, or counts it as skipped."""

    sees = (Began, Said, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._before: dict[str, tuple[str, int, str, int]] = {}  # board -> run, tick, phase, skipped
        self._agreed: set[tuple[str, int]] = set()  # board, and tick that it says that it is done with

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._before.pop(event.process, None)
        elif isinstance(event, Said) and isinstance(event.message, Status) and event.message.phase == "agreed":
            self._agreed.add((event.process, event.message.tick))
        elif isinstance(event, Moved) and isinstance(event.service, BoardService):
            board = event.service
            now = board.clock.run, board.clock.tick, board.rounds.phase, board.counters["skipped"]
            run, tick, phase, skipped = self._before.get(event.process, now)
            self._before[event.process] = now
            if (run, tick) == now[:2] or run != now[0]:
                return
            is_settled = phase == "settled" or (event.process, tick) in self._agreed
            if not is_settled and now[3] == skipped:
                self.breaks(event.at, f"{event.process} left tick {tick} in the phase {phase}")


class StatusesAreTrue(Oracle):
    """A status lists nothing that its sender did not send, and no tick that it has not begun."""

    sees = (Began, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._sent: dict[tuple[str, str], dict[str, int]] = defaultdict(dict)  # process and topic -> subject -> tick

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            for key in [key for key in self._sent if key[0] == event.process]:
                del self._sent[key]
        elif isinstance(event, Said) and event.topic is not None and event.process not in self.night.liars:
            message = event.message
            if isinstance(message, Consensus):
                self._sent[event.process, message.level][message.subject] = message.tick
            elif isinstance(message, Report):
                self._sent[event.process, f"reported {event.parts['sub_team']}"][message.subject] = message.tick
            elif isinstance(message, Status):
                self._judge(event, message)

    def _judge(self, event: Said, status: Status) -> None:
        what = f"reported {event.parts['sub_team']}" if status.kind == "robot" else status.phase
        sent = self._sent[event.process, what]
        never = [subject for subject in status.subjects if sent.get(subject) != status.tick]
        if never and status.phase != "idle":
            self.breaks(event.at, f"{event.process} lists {never[0]} as {status.phase} in tick {status.tick}")


class ProvenanceIsWhole(Oracle):
    """Nothing is multiplied twice, and a belief names everybody whom it rests on."""

    sees = (Said,)

    def see(self, event: Event) -> None:
        assert isinstance(event, Said)
        message = event.message
        if isinstance(message, Consensus):
            self._judge(event.at, message)
        elif event.process in self.night.liars:
            return
        elif (
            isinstance(message, Report)
            and message.informed is not None
            and message.source not in message.informed.ancestors
        ):
            self.breaks(event.at, f"what {message.source} believes of {message.subject} does not name it")

    def _judge(self, at: float, consensus: Consensus) -> None:
        what = f"the {consensus.level} of {consensus.board} on {consensus.subject}"
        for used in consensus.used:
            if used.power > 1.0:
                self.breaks(at, f"{what} takes {used.source} to the power {used.power:g}")
        multiplied = [used.source for used in consensus.used if used.how == "independent"]
        if len(multiplied) > len(set(multiplied)) and self.night.team.feedback != "paper":
            self.breaks(at, f"{what} multiplies {max(multiplied, key=multiplied.count)} twice")
        for used in consensus.used if self.night.is_honest else ():
            sub_team = self.night.team.sub_teams.get(used.source, ()) if consensus.rule != "joint" else ()
            members = {used.source, *sub_team, "g1"}
            if used.weight > 0 and not members & consensus.ancestors.keys():
                self.breaks(at, f"{what} rests on {used.source} and names {sorted(consensus.ancestors)}")


class TheNewestCounts(Oracle):
    """By a world's clock no board goes back to something older of a source than what it used before in a run."""

    sees = (Began, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._newest: dict[tuple[str, str], dict[tuple[str, ...], float]] = {}  # process and run -> the stamps it used

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._newest = {of: stamps for of, stamps in self._newest.items() if of[0] != event.process}
        elif isinstance(event, Said) and isinstance(event.message, Consensus) and event.message.level == "consensus":
            message, usable = event.message, self.night.team.mode != "free" and self.night.is_honest
            run = event.service.clock.run if isinstance(event.service, BoardService) else ""
            stamps = self._newest.setdefault((event.process, run), {})
            for used in message.used if usable else ():
                source = message.subject, used.source, used.how
                stamp, before = message.time - used.age, stamps.get(source, -math.inf)
                if stamp < before - 1e-6:
                    self.breaks(
                        event.at, f"{event.process} goes back {before - stamp:.2f} s in what {used.source} says"
                    )
                stamps[source] = stamp


class NobodyWaits(Oracle):
    """Once the faults are over, every board goes on settling, one speaks for each sub-team, and every robot counts and hears.

    A robot that has lied is taken back after as many sightings as say so. Until then it may be left out, and a board's status names it.
    """

    sees = (Recovered, Said, Moved, Ended)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._since: float | None = None
        self._ticks: dict[str, set[int]] = defaultdict(set)  # board -> the ticks that it is done with
        self._told: dict[str, set[str]] = defaultdict(set)  # sub-team -> robots of which it was agreed where they are
        self._informed: set[str] = set()  # robots that took back what was agreed
        self._named: dict[str, set[str]] = {}  # board -> whom its newest status names
        self._speaks: dict[str, set[str]] = defaultdict(set)  # sub-team -> boards that published

    def see(self, event: Event) -> None:
        if isinstance(event, Recovered):
            self._since = event.at
        elif self._since is None:
            return
        elif isinstance(event, Said):
            self._hear(event)
        elif isinstance(event, Moved) and isinstance(event.service, BoardService):
            due = event.service.rounds.ends_at(event.service.clock.pace)
            if event.service.clock.pace is not Pace.REALTIME and due < event.at - SLACK:
                self.breaks(event.at, f"{event.process} waits in the phase {event.service.rounds.phase}")

    def _hear(self, event: Said) -> None:
        message = event.message
        if isinstance(message, Status) and message.kind == "board" and message.phase == "agreed":
            self._ticks[event.process].add(message.tick)
            self._named[event.process] = {dissent.source for dissent in message.dissent}
        elif isinstance(message, Consensus) and message.level == "agreed":
            self._speaks[message.sub_team].add(event.process)
            kind, _, name = message.subject.partition("/")
            self._told[message.sub_team] |= {name} if kind == "robot" else set()
        elif isinstance(message, Report) and message.informed is not None:
            self._informed.add(message.source)

    def verdict(self) -> Broken | None:
        if self._broken or self._since is None:
            return self._broken
        team, end = self.night.team, self.night.end
        least = math.floor((end - self._since) / team.tick / 4)
        for board in (process for process in team.processes if process.startswith("board/")):
            if len(self._ticks[board]) < least:
                self.breaks(end, f"{board} settled {len(self._ticks[board])} ticks in the last {end - self._since:g} s")
        for sub_team in team.sub_teams:
            if len(self._speaks[sub_team]) > 1:
                self.breaks(end, f"sub-team {sub_team} hears {sorted(self._speaks[sub_team])}")
            unknown = sorted(set(team.robots) - self._told[sub_team])
            if unknown:
                self.breaks(end, f"sub-team {sub_team} does not hear of {unknown[0]}")
        says_all = team.feedback != "off" and not team.is_poor  # on a poor link a robot may leave it out
        out = {name for name in set().union(*self._named.values()) if f"robot/{name}" in self.night.liars}
        deaf = sorted(set(team.robots) - self._informed - out) if says_all else []
        if deaf:
            self.breaks(end, f"{deaf[0]} takes nothing back")
        return self._broken


class Scored(Oracle):
    """What is agreed about robots in one of `SCORED` ticks, beside the truth; what it finds is judged over all nights together."""

    sees = (Said, Sensed)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._truths: dict[int, Truth] = {}  # by tick, which every world of a seed repeats

    def see(self, event: Event) -> None:
        if isinstance(event, Sensed):
            self._truths[self._tick(event.at)] = event.truth
        elif isinstance(event, Said) and isinstance(event.message, Truth):
            self._truths[event.message.tick] = event.message
        elif isinstance(event, Said) and isinstance(event.message, Consensus) and event.message.level == "agreed":
            consensus, team = event.message, self.night.team
            tick = self._tick(event.at) if team.mode == "free" else consensus.tick
            truth = self._truths.get(tick)
            # Other rules claim what their sources claim.
            claims = team.feedback != "paper" and consensus.rule in ("joint", "coalition")
            if claims and tick % SCORED == 0 and truth is not None and consensus.subject in truth.positions:
                self.score(event.at, tick, consensus, truth.positions[consensus.subject])

    def score(self, at: float, tick: int, consensus: Consensus, place: Sequence[float]) -> None:
        """Take what is agreed at a time about a robot that is in a place."""
        raise NotImplementedError

    def _tick(self, at: float) -> int:
        return math.floor(at / self.night.team.tick + 1e-6)


class Coverage(Scored):
    """How often the regions of what is agreed about robots hold the truth, where nobody lies (`run.uncalibrated`)."""

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: subject and tick -> how far the regions of each board hold the truth
        self._scores: dict[tuple[str, int], list[list[float]]] = defaultdict(list)

    def score(self, at: float, tick: int, consensus: Consensus, place: Sequence[float]) -> None:
        belief = unpack(consensus.belief)
        index = belief.grid.index(place)
        if index is not None and self.night.is_honest:
            denser, border = hdr_level(belief.p, index), border_mass(belief.p, index)
            self._scores[consensus.subject, tick].append([float(held(denser, border, share)) for share in SHARES])

    def sums(self) -> Counter[str]:
        sums = Counter[str]({"coverage n": len(self._scores)})
        for scores in self._scores.values():  # the boards of a team err together: they count once
            for share, all_held in zip(SHARES, zip(*scores, strict=True), strict=True):
                sums[f"coverage {share}"] += sum(all_held) / len(all_held)  # type: ignore[assignment]
        return sums
