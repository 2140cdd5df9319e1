"""The state of one team, by what it sent. Pure: time is an argument, memory is bounded whatever arrives.

A moment is complete when every board that is alive has its status "agreed" of a tick in, or when a later tick is agreed on.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from blackboard.errors import Refused
from blackboard.opinion.gaussian.coalitions import named
from blackboard.opinion.grid import Anchor, Grid
from blackboard.process.bounded import put
from blackboard.state.alarms import QUIET, Alarms, of_robot, shown_by
from blackboard.state.moments import MAX_BYTES, About, Moment, Point, Timeline
from blackboard.state.processes import MAX_PROCESSES, SILENT, Process
from blackboard.state.received import Received
from blackboard.state.store import FORGET, MAX_SOURCES, MAX_SUBJECTS, Store
from blackboard.wire import keys
from blackboard.wire.arrays import unpacked_grid
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Disk, Readings, Refusal, Report, Status, Truth
from blackboard.wire.types import Message

MAX_TRUTHS = 64  # ticks whose truth is kept until they are settled
MAX_SIGHTINGS = 1024
MAX_EVENTS = 1000
AHEAD = 5.0  # seconds that the stamp of a settled tick may be ahead of Unix time, where no world gives the time
TICKS_AHEAD = 2  # that a settled tick may be ahead of the world's newest Clock, which comes from another sender

TOKENS = {keys.MEMBER.name: ("robot", "robot"), keys.BOARD.name: ("board", "board"), keys.WORLD.name: ("world", "")}

WORLD = ("world", "world")  # kind and name of the process of which a team has one


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
        #: by run and tick; the first of a run comes before its Clock
        self._truths: dict[tuple[str, int], dict[str, Point]] = {}
        self._forget()

    def expect(self, sub_team: str, robot: str) -> None:
        """A scenario names this robot: it is shown although it was never heard. Refused: "too-many"."""
        self._process("robot", robot, sub_team).expected = True
        for board in list(self.processes.values()):
            if board.kind == "board" and board.status is not None and sub_team in board.sub_teams:
                self._hear_ages(sub_team, board.status, board.heard_at)

    def _forget(self) -> None:
        """A new run: nothing of the beliefs and ticks before it counts."""
        self.moments.clear()
        for process in self.processes.values():
            process.tick = -1
            process.speeds.clear()
            process.believed = None
        self._reports, self._consensus, self._agreed = Store[Report](), Store[Consensus](), Store[Consensus]()
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
            store.check()
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
            self._note("here" if process.alive else "gone", process.name, process.name, now)

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
        self._process(kind, name, sub_team).note_message(now, size)

    # --- messages -------------------------------------------------------------------------------------------------------

    def hear_message(self, parts: dict[str, str], message: Message, size: int, now: float) -> None:
        """Take a message; Refused: "too-many"."""
        if isinstance(message, Clock):
            self._process(*WORLD).note_message(now, size)
            self._hear_clock(message, now)
        elif isinstance(message, Truth):
            self._process(*WORLD).note_message(now, size)
            truths = dict(list(message.positions.items())[:MAX_SUBJECTS])
            put(self._truths, (message.run, message.tick), truths, MAX_TRUTHS)
        elif isinstance(message, Readings):
            self._see(message.robot, message.subjects)
        elif isinstance(message, Report):
            self._process("robot", message.source, parts["sub_team"]).note_message(now, size)
            self._hear_report(message, size, now)
        elif isinstance(message, Consensus):
            self._process("board", message.board, message.sub_team).note_message(now, size)
            self._hear_consensus(message, size, now)
        elif isinstance(message, Status) and message.kind in ("robot", "board"):
            process = self._process(message.kind, message.process, parts["sub_team"])
            process.note_message(now, size)
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
        if clock.end:
            self.alarms.drop("gone", WORLD[1])  # its token went by another way, and may be here first
        self._process(*WORLD).finished(clock.tick, clock.time, now)

    def _see(self, observer: str, subjects: Iterable[str]) -> None:
        put(self._sightings, observer, tuple(dict.fromkeys(subjects))[:MAX_SOURCES], MAX_SOURCES)

    def _hear_report(self, report: Report, size: int, now: float) -> None:
        if report.evidence is not None:
            if report.subject == f"robot/{report.source}":
                self._see(report.source, report.evidence.subjects)
            report = report.model_copy(update={"evidence": None})  # it is not shown, and large
        self._reports.keep(report.subject, report.source, Received(report, now, size))

    def _hear_consensus(self, consensus: Consensus, size: int, now: float) -> None:
        store = self._consensus if consensus.level == "consensus" else self._agreed
        store.keep(consensus.subject, consensus.sub_team, Received(consensus, now, size))
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
                put(self._refusing, (process.name, reason), now, MAX_PROCESSES)
        if process.status is not None and status.namesakes > process.status.namesakes:
            text = f"{process.name}: another process sends under this name, too"
            self._note("namesake", process.name, text, now)
        process.status = status
        process.learn_speed(status)
        if status.kind == "board" and status.grid is not None:
            at = status.anchor
            anchor = None if at is None else Anchor(at.latitude, at.longitude, at.bearing)
            self.grid = replace(unpacked_grid(status.grid), anchor=anchor)
        if status.kind == "board":
            self._hear_board(process, sub_team, status, now)
        elif status.phase == "reported":
            process.finished(status.tick, status.time, now)
            self._reports.withdraw(status.process, status)

    def _hear_board(self, process: Process, sub_team: str, status: Status, now: float) -> None:
        self._hear_ages(sub_team, status, now)
        if status.follows:
            process.finished(status.tick, status.time, now)  # what its sub-team has settled, another board says
        elif status.phase == "consensus":
            self._consensus.withdraw(sub_team, status)
        elif status.phase == "agreed":
            self._agreed.withdraw(sub_team, status)
            process.finished(status.tick, status.time, now)
            self._settled(status, now)

    def _hear_disk(self, disk: Disk, now: float) -> None:
        if disk.trouble:
            text = f"{disk.recorder} cannot write its tape ({disk.trouble}), {disk.missing} messages are missing"
            self.alarms.raise_("full disk", disk.recorder, text, now)
        else:
            self.alarms.end("full disk", disk.recorder, now)

    def _hear_ages(self, sub_team: str, status: Status, now: float) -> None:
        """A board knows robots that left before this fold began.

        Those that it heard in the last minute are taken in here, too, and those that a scenario names whenever it heard them.
        """
        for robot, age in status.ages.items():
            known = self.processes.get(("robot", robot))
            is_missed = known is not None and known.expected and not known.alive and not known.messages
            is_news = is_missed and known is not None and known.heard_at < now - age <= now
            if is_news or (known is None and 0 <= age < FORGET):
                process = self._process("robot", robot, sub_team)
                process.heard_at = process.gone_at = now - age
                if age > SILENT:
                    self.alarms.raise_("gone", robot, f"{robot} is gone", process.gone_at)
                else:
                    self.alarms.end("gone", robot, now)
        for name in status.lacks:
            kind, _, robot = name.partition("/")
            waited = self.processes.get((kind, robot))
            if waited is not None and waited.expected and waited.state(now) == ("gone", None):
                self.alarms.raise_("gone", robot, f"{robot} is waited for and was never heard", now)

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
                by_subject = (self._agreed.newest(subject, sub_team) for subject in told.subjects)
                if any(newest is not None and newest.message.tick < tick for newest in by_subject):
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
        for subject in sorted(
            self._agreed.subjects | self._consensus.subjects | self._reports.subjects | truths.keys()
        ):
            about = About(
                agreed=self._agreed.until(subject, time),
                consensus=self._consensus.until(subject, time),
                reports=self._reports.until(subject, time),
                truth=truths.get(subject),
            )
            if about.best is not None or about.reports or about.truth is not None:
                subjects[subject] = about
            kind, _, name = subject.partition("/")
            if about.best is not None and (process := self.processes.get((kind, name))) is not None:
                process.believed = about.best.message.tick, about.best.message.time
        for store in (self._agreed, self._consensus, self._reports):
            store.drop_before(time - FORGET)
        seen = [
            (f"robot/{observer}", subject) for observer, all_ in sorted(self._sightings.items()) for subject in all_
        ]
        speeds = {
            process.name: speed for process in self.processes.values() if (speed := process.speed_at(time)) is not None
        }
        moment = Moment(run, tick, time, now, subjects, tuple(seen[:MAX_SIGHTINGS]), speeds)
        self.moments.add(moment)
        self.changes += 1
        self._notice(moment, now)

    def _said(self) -> dict[tuple[str, str], str]:
        """The alarms that robots raise themselves."""
        told = [(process.name, process.status) for process in self.processes.values() if process.kind == "robot"]
        return {
            key: text
            for name, status in told
            if status is not None
            for key, text in of_robot(name, status.settings).items()
        }

    def _notice(self, moment: Moment, now: float) -> None:
        """Note which conflicts and which sources left out are new, and which did not come back for QUIET seconds."""
        cells = math.inf if self.grid is None else math.prod(self.grid.shape)
        shown, alarms = shown_by(moment, cells)
        self.alarms.raise_all(alarms | self._said(), now)
        begun = {key: text for key, text in shown.items() if key not in self._noticed}
        self._noticed |= dict.fromkeys(shown, moment.time)
        over = [key for key, last in self._noticed.items() if moment.time - last > QUIET]
        for key in over:
            del self._noticed[key]
        for (subject, source), text in begun.items():
            if source:
                self._note("left out", subject, text, now)
        if subjects := [subject for subject, source in begun if not source]:
            self._note("conflict", subjects[0], f"conflict about {', '.join(subjects)}", now)
        if subjects := [subject for subject, source in over if not source]:
            self._note("agreement", subjects[0], f"no conflict about {', '.join(subjects)} any more", now)
        for subject in dict.fromkeys(subject for subject, source in over if source):
            sources = [named(source) for about, source in over if source and about == subject]
            text = f"{', '.join(sources)} {'counts' if len(sources) == 1 else 'count'} again about {subject}"
            self._note("back in", subject, text, now)
