"""The fold: envelopes in, the state of the teams out. Pure: time is an argument, memory is bounded whatever arrives.

A moment is complete when every board that is alive has its status "agreed" of a tick in, or when a later tick is agreed on.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from blackboard.errors import Refused
from blackboard.opinion.grid import Anchor, Grid
from blackboard.state.alarms import QUIET, Alarms, of_robot
from blackboard.state.moments import MAX_BYTES, About, Moment, Point, Timeline
from blackboard.state.processes import MAX_PROCESSES, RECENT, SILENT, Process
from blackboard.state.received import M, Received
from blackboard.wire import keys
from blackboard.wire.arrays import unpacked_grid
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Disk, Readings, Refusal, Report, Status, Truth
from blackboard.wire.types import Message

MAX_TEAMS = 16
MAX_SUBJECTS = 256  # of a team
MAX_SOURCES = 64  # of a subject; sub-teams count as such
MAX_TRUTHS = 64  # ticks whose truth is kept until they are settled
MAX_SIGHTINGS = 1024
MAX_EVENTS = 1000
FORGET = 60.0  # seconds of team time after which an old belief is not shown any more; in which a source still counts as known
LOST = 0.1  # share of the grid's cells: who may be on more of them, exp(entropy), is lost
LIKELY_LOST = 0.3  # of the probability that a robot is not where the team believes, from which on it is said to be lost

AHEAD = 5.0  # seconds that the stamp of a settled tick may be ahead of Unix time, where no world gives the time
TICKS_AHEAD = 2  # that a settled tick may be ahead of the world's newest Clock, which comes from another sender

TOKENS = {keys.MEMBER.name: ("robot", "robot"), keys.BOARD.name: ("board", "board"), keys.WORLD.name: ("world", "")}

WORLD = ("world", "world")  # kind and name of the process of which a team has one

K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True)
class Event:
    """Something to notice; `at` is Unix time, tick -1 where no tick is known."""

    at: float
    tick: int
    what: str  # "here", "gone", "run", "conflict", "agreement", "left out", "back in", "refused", "namesake"
    who: str
    text: str

    @property
    def severity(self) -> str:
        """How much it matters: "alarm", "warning" or "note"."""
        return SEVERITY.get(self.what, "note")


#: Of events; others are notes.
SEVERITY = {"gone": "alarm", "namesake": "alarm", "conflict": "warning", "left out": "warning", "refused": "warning"}


class Fold:
    """All teams that are heard of. `take` never raises for what arrives: it counts what it refuses."""

    def __init__(self, most_bytes: int = MAX_BYTES) -> None:
        """`most_bytes` are those of the moments of each team (`blackboard.state.moments`)."""
        self._most_bytes = most_bytes
        self.teams: dict[str, TeamFold] = {}
        self.refused: Counter[str] = Counter()  # by reason, as `blackboard.wire.messages.REASONS`

    def take(self, envelope: Envelope, now: float) -> None:
        """Take one envelope that arrived at `now`, Unix seconds."""
        try:
            if envelope.kind in (Kind.ALIVE, Kind.GONE):
                found = keys.parse(envelope.key)
                if found is not None and found[0].name in TOKENS:
                    self._team(found[1]["team"]).hear_token(*found, envelope, now)
            elif envelope.kind is Kind.PUT and (sender := _unread(envelope.key)) is not None:
                self._team(sender.pop("team")).hear_sender(**sender, size=len(envelope.payload), now=now)
            elif envelope.kind is Kind.PUT:
                _, parts, message = open_envelope(envelope)
                self._team(parts["team"]).hear(parts, message, len(envelope.payload), now)
        except Refused as refusal:
            self.refused[refusal.reason] += 1

    def expect(self, name: str, sub_teams: Mapping[str, Iterable[str]]) -> None:
        """The robots of a team's scenario by sub-team: they are shown although they were never heard."""
        for sub_team, robots in sub_teams.items():
            for robot in robots:
                self._team(name).expect(sub_team, robot)

    def _team(self, name: str) -> TeamFold:
        if name not in self.teams and len(self.teams) >= MAX_TEAMS:
            raise Refused("too-many", f"{name} would be one more than {MAX_TEAMS} teams")
        return self.teams.setdefault(name, TeamFold(name, self._most_bytes))


class TeamFold:
    """The state of one team."""

    def __init__(self, name: str, most_bytes: int = MAX_BYTES) -> None:
        self.name = name
        self.processes: dict[tuple[str, str], Process] = {}  # kind and name
        self.clock: Clock | None = None
        self.grid: Grid | None = None  # of its boards, with the anchor of their statuses
        self.moments = Timeline(most_bytes=most_bytes)
        self.events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self.alarms = Alarms()
        self.changes = 0  # grows with each moment and each change of liveliness
        self._refusing: dict[tuple[str, str], float] = {}  # process and reason -> Unix time of the newest refusal
        self._truths: dict[
            tuple[str, int], dict[str, Point]
        ] = {}  # run and tick; the first of a run comes before its Clock
        self._forget()

    def expect(self, sub_team: str, robot: str) -> None:
        """A scenario names this robot: it is shown although it was never heard. Refused: "too-many"."""
        self._process("robot", robot, sub_team)

    def _forget(self) -> None:
        """A new run: nothing of the beliefs and ticks before it counts."""
        self.moments.clear()
        for process in self.processes.values():
            process.tick = -1
            process.speeds.clear()
        self._reports: dict[str, dict[str, deque[Received[Report]]]] = {}  # subject -> source -> the newest last
        self._consensus: dict[str, dict[str, deque[Received[Consensus]]]] = {}  # subject -> sub-team -> the newest last
        self._agreed: dict[str, dict[str, deque[Received[Consensus]]]] = {}
        self._sightings: dict[str, tuple[str, ...]] = {}  # observer -> what it sees
        self._open: tuple[int, float] | None = None  # tick and time of the moment that is not complete
        #: conflicts, and sources left out, by subject: team time at which they were found last
        self._noticed: dict[tuple[str, str], float] = {}
        self.alarms.forget()

    @property
    def mode(self) -> str:
        """By what the team goes: "lockstep", "realtime", or "free" where no world is alive."""
        world = self.processes.get(WORLD)
        return "free" if self.clock is None or world is None or not world.alive else self.clock.mode

    def check(self) -> None:
        """AssertionError: it holds more than its bounds."""
        assert len(self.processes) <= MAX_PROCESSES
        assert max(len(self._truths), len(self._sightings)) <= MAX_TRUTHS
        assert len(self._refusing) <= MAX_PROCESSES
        for store in (self._reports, self._consensus, self._agreed):
            assert len(store) <= MAX_SUBJECTS
            assert all(len(by_source) <= MAX_SOURCES for by_source in store.values())
        self.alarms.check()
        assert self._open is None or self.moments.newest is None or self._open[0] > self.moments.newest.tick

    # --- liveliness -----------------------------------------------------------------------------------------------------

    def hear_token(self, topic: keys.Topic, parts: dict[str, str], envelope: Envelope, now: float) -> None:
        kind, part = TOKENS[topic.name]
        process = self._process(kind, parts.get(part, "world"), parts.get("sub_team"))
        alive = process.alive
        (process.tokens.add if envelope.kind is Kind.ALIVE else process.tokens.discard)(envelope.key)
        if process.alive != alive:
            process.gone_at = None if process.alive else now
            self.changes += 1
            self._tell_of_gone(process, now)
            self._note(
                "here" if process.alive else "gone",
                process.name,
                kind if kind == process.name else f"{kind} {process.name}",
                now,
            )

    def _tell_of_gone(self, process: Process, now: float) -> None:
        """An alarm where a process has gone, unless it is the world at the end of its run."""
        if process.alive:
            self.alarms.end("gone", process.name, now)
        elif (process.kind, process.name) != WORLD or self.clock is None or not self.clock.end:
            self.alarms.raise_("gone", process.name, f"{process.name} is gone", now)

    def _process(self, kind: str, name: str, sub_team: str | None = None) -> Process:
        known = self.processes.get((kind, name))
        if known is None:
            if len(self.processes) >= MAX_PROCESSES:
                gone = [key for key, process in self.processes.items() if not process.alive]
                if not gone:
                    raise Refused("too-many", f"{name} would be one more than {MAX_PROCESSES} processes")
                del self.processes[min(gone, key=lambda key: self.processes[key].heard_at)]
            known = self.processes[kind, name] = Process(kind, name)
        if sub_team is not None and len(known.sub_teams) < MAX_SOURCES:
            known.sub_teams.add(sub_team)
        return known

    def _note(self, what: str, who: str, text: str, now: float) -> None:
        tick = -1 if self.moments.newest is None else self.moments.newest.tick
        self.events.append(Event(now, tick, what, who, text))

    def hear_sender(self, kind: str, name: str, sub_team: str | None, size: int, now: float) -> None:
        """Count a message that is not read."""
        self._process(kind, name, sub_team).heard(now, size)

    # --- messages -------------------------------------------------------------------------------------------------------

    def hear(self, parts: dict[str, str], message: Message, size: int, now: float) -> None:
        """Take a message; Refused: "too-many"."""
        if isinstance(message, Clock):
            self._process(*WORLD).heard(now, size)
            self._hear_clock(message, now)
        elif isinstance(message, Truth):
            self._process(*WORLD).heard(now, size)
            self._truths[message.run, message.tick] = dict(list(message.positions.items())[:MAX_SUBJECTS])
            _keep_newest(self._truths, MAX_TRUTHS)
        elif isinstance(message, Readings):
            self._see(message.robot, message.subjects)
        elif isinstance(message, Report):
            self._process("robot", message.source, parts["sub_team"]).heard(now, size)
            self._hear_report(message, size, now)
        elif isinstance(message, Consensus):
            self._process("board", message.board, message.sub_team).heard(now, size)
            self._hear_consensus(message, size, now)
        elif isinstance(message, Status) and message.kind in ("robot", "board"):
            process = self._process(message.kind, message.process, parts["sub_team"])
            process.heard(now, size)
            self._hear_status(process, parts["sub_team"], message, now)
        elif isinstance(message, Disk):
            self._hear_disk(message, now)
        elif isinstance(message, Refusal):
            text = f"{message.board} refuses what {message.robot} sends ({message.reason}: {message.text})"
            self.alarms.raise_("refused", message.robot, text, now)

    def _hear_clock(self, clock: Clock, now: float) -> None:
        if self.clock is None or clock.run != self.clock.run:
            self._forget()
            self._note("run", self.name, f"run {clock.run} begins", now)
        elif clock.tick < self.clock.tick:
            return
        self.clock = clock
        self._process(*WORLD).finished(clock.tick, clock.time, now)

    def _see(self, observer: str, subjects: Iterable[str]) -> None:
        self._sightings[observer] = tuple(dict.fromkeys(subjects))[:MAX_SOURCES]
        _keep_newest(self._sightings, MAX_SOURCES)

    def _hear_report(self, report: Report, size: int, now: float) -> None:
        if report.evidence is not None:
            if report.subject == f"robot/{report.source}":
                self._see(report.source, report.evidence.subjects)
            report = report.model_copy(update={"evidence": None})  # it is not shown, and large
        _keep(self._reports, report.subject, report.source, Received(report, now, size))

    def _hear_consensus(self, consensus: Consensus, size: int, now: float) -> None:
        store = self._consensus if consensus.level == "consensus" else self._agreed
        _keep(store, consensus.subject, consensus.sub_team, Received(consensus, now, size))
        if (grid := unpacked_grid(consensus.belief.grid)) != self.grid:  # that of a status has an anchor
            self.grid = grid
        if consensus.level == "agreed":
            self._close(now)

    def _hear_status(self, process: Process, sub_team: str, status: Status, now: float) -> None:
        status = status.beside(process.status)
        for reason, count in status.refused.items():
            if count > process.refused.get(reason, 0) and process.status is not None:
                if now - self._refusing.get((process.name, reason), -math.inf) > QUIET:
                    self._note("refused", process.name, f"{process.name} refuses messages: {reason}", now)
                self._refusing[process.name, reason] = now
                _keep_newest(self._refusing, MAX_PROCESSES)
        if process.status is not None and status.namesakes > process.status.namesakes:
            text = f"{process.name}: another process sends under this name, too"
            self._note("namesake", process.name, text, now)
        process.status, process.status_at = status, now
        process.learn_speed(status)
        if status.kind == "board" and status.grid is not None:
            at = status.anchor
            anchor = None if at is None else Anchor(at.latitude, at.longitude, at.bearing)
            self.grid = replace(unpacked_grid(status.grid), anchor=anchor)
        if status.kind == "robot" and status.phase == "reported":
            process.finished(status.tick, status.time, now)
            _withdraw(self._reports, status.process, status)
        if status.kind == "board":
            self._hear_ages(sub_team, status, now)
        if status.kind == "board" and status.follows:
            process.finished(status.tick, status.time, now)  # what its sub-team has settled, another board says
        elif status.kind == "board" and status.phase in ("consensus", "agreed"):
            _withdraw(self._consensus if status.phase == "consensus" else self._agreed, sub_team, status)
            if status.phase == "agreed":
                process.finished(status.tick, status.time, now)
                self._settled(status, now)

    def _hear_disk(self, disk: Disk, now: float) -> None:
        if disk.trouble:
            text = f"{disk.recorder} cannot write its tape ({disk.trouble}), {disk.missing} messages are missing"
            self.alarms.raise_("full disk", disk.recorder, text, now)
        else:
            self.alarms.end("full disk", disk.recorder, now)

    def _hear_ages(self, sub_team: str, status: Status, now: float) -> None:
        """A board knows robots that went before anybody looked: who was heard in the last minute is known here, too."""
        for robot, age in status.ages.items():
            if ("robot", robot) not in self.processes and 0 <= age < FORGET:
                process = self._process("robot", robot, sub_team)
                process.heard_at = process.gone_at = now - age
                if age > SILENT:
                    self.alarms.raise_("gone", robot, f"{robot} is gone", process.gone_at)

    # --- moments --------------------------------------------------------------------------------------------------------

    def _settled(self, status: Status, now: float) -> None:
        newest = self.moments.newest
        if (newest is not None and status.tick <= newest.tick) or self._is_ahead(status, now):
            return
        if self._open is not None and status.tick > self._open[0]:
            self._complete(now)
        if self._open is None or status.tick == self._open[0]:
            before = -math.inf if self._open is None else self._open[1]
            self._open = (status.tick, max(before, status.time))
        self._close(now)

    def _close(self, now: float) -> None:
        """Complete the open moment if every board has settled its tick, and what it lists has arrived: messages may overtake."""
        if self._open is None:
            return
        tick = self._open[0]
        for board in self.processes.values():
            if board.kind != "board" or not board.speaks:
                continue
            told = board.status
            if board.tick < tick:
                return
            if told is None or told.tick != tick or told.phase != "agreed":
                continue
            for sub_team in board.sub_teams:
                by_subject = (self._agreed.get(subject, {}).get(sub_team) for subject in told.subjects)
                if any(recent and recent[-1].message.tick < tick for recent in by_subject):
                    return
        self._complete(now)

    def _is_ahead(self, status: Status, now: float) -> bool:
        """Whether a status is of a tick that cannot have begun: taken as the newest it would hide all that comes after it."""
        if self.clock is None or self.mode == "free":
            return status.time > now + AHEAD
        return status.tick > self.clock.tick + TICKS_AHEAD

    def _complete(self, now: float) -> None:
        """Close the open moment; beliefs that are later than it wait for the next."""
        assert self._open is not None
        tick, time = self._open
        self._open = None
        run = "" if self.clock is None else self.clock.run
        truths = self._truths.get((run, tick), {})
        subjects = {}
        for subject in sorted({*self._agreed, *self._consensus, *self._reports, *truths}):
            about = About(
                agreed=_until(self._agreed.get(subject, {}), time),
                consensus=_until(self._consensus.get(subject, {}), time),
                reports=_until(self._reports.get(subject, {}), time),
                truth=truths.get(subject),
            )
            if about.best is not None or about.reports or about.truth is not None:
                subjects[subject] = about
        self._drop_old(time - FORGET)
        seen = [(f"robot/{observer}", subject) for observer, all_ in self._sightings.items() for subject in all_]
        speeds = {it.name: speed for it in self.processes.values() if (speed := it.speed_at(time)) is not None}
        moment = Moment(run, tick, time, now, subjects, tuple(seen[:MAX_SIGHTINGS]), speeds)
        self.moments.add(moment)
        self.changes += 1
        self._notice(moment, now)

    def _drop_old(self, oldest: float) -> None:
        """Drop what was stamped before `oldest`, team time in seconds."""
        self._agreed = _younger(self._agreed, oldest)
        self._consensus = _younger(self._consensus, oldest)
        self._reports = _younger(self._reports, oldest)

    def _said(self) -> dict[tuple[str, str], str]:
        """The alarms that robots raise themselves."""
        told = [(it.name, it.status) for it in self.processes.values() if it.kind == "robot"]
        return {key: text for name, it in told if it is not None for key, text in of_robot(name, it.settings).items()}

    def _lost(self, it: Consensus) -> str:
        """Why nobody knows where a subject is; empty where that is known."""
        cells = math.inf if self.grid is None else math.prod(self.grid.shape)
        share = math.exp(min(it.entropy, 99.0)) / cells
        if share > LOST:
            return f"{it.subject} is lost: it may be on {100 * share:.0f} % of the map"
        if it.lost is not None and it.lost >= LIKELY_LOST:
            return f"{it.subject} is lost with {100 * it.lost:.0f} %: it may not be where the team believes"
        return ""

    def _notice(self, moment: Moment, now: float) -> None:
        """Note which conflicts and which sources left out are new, and which did not come back for QUIET seconds."""
        found = dict[tuple[str, str], str]()
        alarms = dict[tuple[str, str], str]()
        for subject, about in moment.subjects.items():
            best = about.best
            if best is None or best.message.tick < moment.tick:
                continue
            it = best.message
            if it.conflict:
                found[subject, ""] = f"conflict about {subject}"
            for one in it.dissent:
                text = f"{one.source} keeps disagreeing about {subject}, by {one.sigmas:.1f} sigmas"
                found[subject, one.source] = alarms["liar", one.source] = text
            for out in it.left_out:
                found[subject, out.source] = f"{out.source} left out about {subject}: {out.reason}"
            if text := self._lost(it):
                alarms["lost", subject] = text
            for learned in it.learned:
                if learned.since is not None and not learned.echo:
                    times = math.sqrt(max(0.0, learned.variance))
                    text = f"{learned.source} is over-confident: its errors are {times:.1f} times what it claims"
                    alarms["over-confident", learned.source] = text
        self.alarms.look(alarms | self._said(), now)
        for (subject, source), text in found.items():
            if (subject, source) not in self._noticed:
                self._note("left out" if source else "conflict", subject, text, now)
            self._noticed[subject, source] = moment.time
        for (subject, source), last in list(self._noticed.items()):
            if moment.time - last > QUIET:
                del self._noticed[subject, source]
                text = f"{source} counts again about {subject}" if source else f"no conflict about {subject} any more"
                self._note("back in" if source else "agreement", subject, text, now)


def _unread(key: str) -> dict[str, Any] | None:
    """Who sends on a key whose messages show nothing new and are large: solo beliefs, evidence, memories; None for others."""
    if (parts := keys.SOLO.match(key)) is not None:
        return {"team": parts["team"], "kind": "robot", "name": parts["robot"], "sub_team": None}
    if (parts := keys.FORWARD.match(key) or keys.MEMORY.match(key)) is not None:
        return {"team": parts["team"], "kind": "board", "name": parts["board"], "sub_team": parts["sub_team"]}
    return None


def _keep(store: dict[str, dict[str, deque[Received[M]]]], subject: str, source: str, told: Received[M]) -> None:
    """Keep what a source told about a subject, unless it is older than what is kept. Refused: "too-many"."""
    if subject not in store and len(store) >= MAX_SUBJECTS:
        raise Refused("too-many", f"{subject} would be one more than {MAX_SUBJECTS} subjects")
    by_source = store.setdefault(subject, {})
    if source not in by_source and len(by_source) >= MAX_SOURCES:
        raise Refused("too-many", f"{source} would be one more than {MAX_SOURCES} sources on {subject}")
    recent = by_source.setdefault(source, deque(maxlen=RECENT))
    if not recent or told.message.time >= recent[-1].message.time:
        recent.append(told)


def _withdraw(store: dict[str, dict[str, deque[Received[M]]]], source: str, status: Status) -> None:
    """Drop what a source told before the tick of its status on subjects that the status lists no longer."""
    for subject, by_source in store.items():
        if (
            subject not in {*status.subjects, *status.kept}
            and source in by_source
            and by_source[source][-1].message.tick < status.tick
        ):
            del by_source[source]


def _younger(
    store: dict[str, dict[str, deque[Received[M]]]], oldest: float
) -> dict[str, dict[str, deque[Received[M]]]]:
    """What was told since `oldest`, team time in seconds."""
    kept = {
        subject: {source: recent for source, recent in by_source.items() if recent[-1].message.time >= oldest}
        for subject, by_source in store.items()
    }
    return {subject: by_source for subject, by_source in kept.items() if by_source}


def _keep_newest(table: dict[K, V], most: int) -> None:
    while len(table) > most:
        del table[next(iter(table))]


def _until(told: dict[str, deque[Received[M]]], time: float) -> dict[str, Received[M]]:
    """The newest of each source, by name, that is not later than a team time, and at most FORGET seconds older."""
    fits = {name: [it for it in recent if time - FORGET <= it.message.time <= time] for name, recent in told.items()}
    return {name: fits[name][-1] for name in sorted(fits) if fits[name]}
