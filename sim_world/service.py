"""The world process: it sends the readings and the Clock of each tick, waits for the answers, and gives the tick to the referee.

The protocol is in docs/ticks.md, "A tick in lockstep", and the table of its phases in `blackboard.process.rounds.WORLD`.
"""

import logging
import math
from collections import Counter
from collections.abc import Sequence

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.faults import faulty_robots
from blackboard.judge.card import COUNTED, RunResult
from blackboard.judge.instant import PHASES, Instant, who_saw_landmarks
from blackboard.judge.referee import Referee
from blackboard.judge.samples import Keep
from blackboard.judge.traffic import Traffic
from blackboard.process.intake import Intake
from blackboard.process.roster import Roster
from blackboard.process.rounds import WORLD, Rounds
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.codec import enveloped
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Solo, Status
from blackboard.wire.types import MAX_OPINIONS, Message
from sim_world.members import Members, who
from sim_world.sensor_source import SensorSource
from sim_world.sources import open_sensor_source

log = logging.getLogger(__name__)

LONGEST = 5  # times that the wait until asking again is doubled
SHOWN_TICKS = 1000  # a run without end logs its progress ten times in so many ticks


def world_of(scenario: Scenario, record: Keep | None) -> "WorldService":
    """The world of a scenario with its referee; `record` is given every sample that counts. UserError: a mistake in the scenario."""
    sensors = open_sensor_source(scenario)
    world = scenario.section("world", WorldSection)
    faulty, unnamed = faulty_robots(scenario), world.detector.anonymous
    referee = Referee(scenario.grid, world.check, sensors.robots, record, faulty=faulty, unnamed=unnamed)
    return WorldService(scenario, sensors, referee)


class WorldService:
    """The world process of a team (`blackboard.process.service.Service`), with its referee."""

    def __init__(self, scenario: Scenario, sensors: SensorSource, referee: Referee) -> None:
        self.team, self.time, self.board = scenario.team, scenario.time, scenario.board
        self.settings = settings = scenario.section("world", WorldSection)
        self.pace = Pace.LOCKSTEP if self.time.mode == "lockstep" else Pace.REALTIME
        self.sensors, self.referee = sensors, referee
        # after tick 0; None: until it is stopped
        self.ticks = None if math.isinf(self.time.seconds) else self.time.ticks
        self.intake = Intake()
        self.counters, self.refused = self.intake.counters, self.intake.refused
        self.roster = Roster(*self.tokens, grace=settings.grace, comeback=settings.comeback)
        self.members = Members(self.team, sensors, self.roster)
        waits = {name: getattr(settings, name) for name in ("gather", "give_up", "linger")} | {"tick": self.time.tick}
        self.traffic, self.rounds = Traffic(), Rounds(WORLD, waits, "start")
        self.run, self.tick = "", -1
        self._open: dict[int, Instant] = {}  # ticks that are not over
        self._over: list[tuple[Instant, bool]] = []  # ticks that are to be judged once the next one has been sent
        self._sent: list[Envelope] = []  # the readings of the newest tick
        self._clock: Clock | None = None  # of the newest tick
        self._news_at = 0.0  # Unix seconds of the newest first answer to the tick, or of asking again
        self._rounds_asked = 0  # how often in this tick who was missing was asked
        self._spoke: set[str] = set()  # whose status of this tick came, and is not idle
        self._done: set[str] = set()  # who said so that it is done with the tick
        self._lacked: set[str] = set()  # whose messages boards lacked since who is missing was asked
        self._elapsed = 0.0  # seconds of the tick that had passed when too few were there to go on
        self._began = self._now = 0.0  # Unix seconds of the first tick, and of the newest event
        self._end: str | None = None  # why it ended; "" when all ticks are done

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return (keys.WORLD.key(team=self.team.name),)

    @property
    def listens(self) -> tuple[str, ...]:
        topics = (keys.SOLO, keys.CONSENSUS, keys.AGREED, keys.STATUS)
        return tuple(
            topic.key(team=self.team.name, sub_team="*", robot="*", process="*", subject="**") for topic in topics
        )

    @property
    def watches(self) -> tuple[str, ...]:
        """Also its own token: when that vanishes, the router is down."""
        topics = (keys.WORLD, keys.MEMBER, keys.BOARD)
        return tuple(topic.key(team=self.team.name, sub_team="*", robot="*", board="*") for topic in topics)

    @property
    def done(self) -> bool:
        return self._end is not None

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.intake.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._now = now
        out: list[Envelope] = []
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            if self.members.hear_token(envelope, now) and self._open:
                name = who(envelope.key)  # none: it was the router that had gone
                out += self._ask(asked=[name] if name else sorted({*self.members.missing(self._open[max(self._open)])}))
        else:
            out = self.intake.on_envelope(
                envelope, lambda parts, message: self._hear(parts, message, envelope.payload), now
            )
        return out + self._advance(now)

    def wake(self, now: float) -> list[Envelope]:
        self._now = now
        self._judge()
        return self._advance(now)

    def wake_at(self, now: float) -> float | None:
        if self._end is not None:
            return None
        if self._over:
            return now
        due = min(self.rounds.ends_at(self.pace), self.roster.changes_at())
        return min(due, self._asks_at) if self._is_waiting_for_answers else due

    # --- for the scorecard --------------------------------------------------------------------------------------------

    @property
    def why(self) -> str:
        """Why not all ticks were done; empty if they were."""
        if self._end is not None:
            return self._end
        without_end = self.ticks is None and self.tick >= 0
        return "" if without_end else f"stopped in tick {self._progress}"

    @property
    def _progress(self) -> str:
        return f"{self.tick}" if self.ticks is None else f"{self.tick} of {self.ticks}"

    def result(self) -> RunResult:
        """The run until now; traffic is the world's own, and what the newest status of every other process counts."""
        self._judge()
        judgement = self.referee.judgement()
        counts = self.traffic.counters({**self.counters, "late": 0})  # the world's own are answers that came again
        return RunResult(
            judgement=judgement,
            stopped=self.why,
            seed=self.settings.seed,
            rule=self.board.rule,
            fusion=self.board.fusion,
            mode=self.time.mode,
            protocol=self.settings.protocol if self.settings.kind == "mrclam" else None,
            ticks=max(0, self.tick),
            tick_seconds=self.time.tick,
            wall_seconds=self._now - self._began if self._began else 0.0,
            messages={name: counts[name] for name in COUNTED},
            refused=self.traffic.refused(self.refused + Counter(judgement.refused)),
            bytes=counts["bytes"],
            counters=dict(self.counters),
        )

    # --- receiving ----------------------------------------------------------------------------------------------------

    def _hear(self, parts: dict[str, str], message: Message, payload: bytes) -> list[Envelope]:
        sub_team = parts.get("sub_team", "")
        if isinstance(message, Status):
            self.traffic.hear_status(sub_team, message)
            self.members.hear_status(sub_team, message)
            if self.members.strangers:
                self.counters["strangers"] = len(self.members.strangers)
            self._note(sub_team, message)
            if message.kind != "board" or message.phase not in PHASES:
                return []
        if isinstance(message, Solo | Consensus | Status):
            self._hear_answer(sub_team, message, payload)
        return []

    def _hear_answer(self, sub_team: str, message: Solo | Consensus | Status, payload: bytes) -> None:
        instant = self._open.get(message.tick)
        if message.tick <= self.tick:
            self.members.hear_answer(sub_team, message, in_time=instant is not None)
        if instant is not None and instant.hear_message(sub_team, message, payload):
            self._news_at = self._now
        elif instant is None and not isinstance(message, Status):  # statuses are sent again once a second
            self.counters["late"] += 1

    # --- asking again -------------------------------------------------------------------------------------------------

    @property
    def _asks_at(self) -> float:
        """When to ask next, Unix seconds: twice after `patience` without an answer, then twice after twice as long, and so on."""
        return self._news_at + self.settings.patience * 2.0 ** min(self._rounds_asked // 2, LONGEST)

    def _note(self, sub_team: str, status: Status) -> None:
        """What a process says of this tick: that it has sent its answers, or at least what others wait for, and what it lacks."""
        name = f"robot/{status.process}" if status.kind == "robot" else f"board/{sub_team}/{status.process}"
        members = self.members.names()
        if name not in members:
            return  # what strangers say is not kept
        if status.tick == self.tick and status.phase != "idle":
            self._spoke.add(name)
            if status.phase != "consensus":
                self._done.add(name)
        self._lacked |= members.intersection(status.lacks)

    def _ask_again(self, now: float) -> list[Envelope]:
        """Ask who is missing for its status; and the next time, whose answers were sent and are still not here, for these.

        In between there is time for what was on its way: a status may overtake the answers.
        """
        missing = {*self.members.missing(self._open[self.tick])}
        lost = (self._done & missing) | (self._spoke & self._lacked)
        owing = lost if self._rounds_asked % 2 else set[str]()
        self._rounds_asked += 1
        self._news_at = now
        self._lacked.clear()
        return self._ask(again=sorted(owing)) if owing else self._ask(asked=sorted(missing))

    def _ask(self, asked: Sequence[str] = (), again: Sequence[str] = ()) -> list[Envelope]:
        """The Clock once more, which says who shall tell its status, after their readings, and who shall send its answers again."""
        assert self._clock is not None, "a tick has begun"
        self.counters["repeated"] += 1
        robots = {name.removeprefix("robot/") for name in asked if name.startswith("robot/")}
        mine = {keys.READING.key(team=self.team.name, robot=robot) for robot in robots}
        clock = self._clock.model_copy(
            update={"asked": list(asked)[:MAX_OPINIONS], "again": list(again)[:MAX_OPINIONS]}
        )
        readings = [envelope for envelope in self._sent if envelope.key in mine]
        return [*readings, enveloped(keys.CLOCK.key(team=self.team.name), clock)]

    # --- when a tick is over ------------------------------------------------------------------------------------------

    @property
    def _is_waiting_for_answers(self) -> bool:
        return self.pace is Pace.LOCKSTEP and self.rounds.phase == "tick"

    def _advance(self, now: float) -> list[Envelope]:
        """End the phases that are over, and send the tick again where answers are missing."""
        if self._end is not None:
            return []
        self.roster.forget(now)
        if self._is_waiting_for_answers and not self.members.enough():
            self._elapsed = now - self.rounds.began
            self.rounds.enter("gather", now)
        if self.pace is Pace.REALTIME:
            self._close(*[tick for tick, instant in self._open.items() if now - instant.began >= self.settings.linger])
        out: list[Envelope] = []
        began = self.rounds.began
        while self._end is None and (ended := self.rounds.turn(self.pace, now, self._holds)) is not None:
            phase, _ = ended
            if phase == "gather":
                out += self._set_off(now)
            elif phase != "start":
                out += self._finish_tick(began, now)
            began = self.rounds.began
        if self._end is None and self._is_waiting_for_answers and now >= self._asks_at:
            out += self._ask_again(now)
        return out

    def _holds(self, fact: str) -> bool:
        """Whether the "team" is there (all of it, before the first tick), or all "answers" to the tick."""
        if fact == "team":
            return self.members.enough() and not (self.tick < 0 and self.members.absent())
        return next(self.members.missing(self._open[self.tick]), None) is None

    def _set_off(self, now: float) -> list[Envelope]:
        """The team is there, or the wait for it is over: begin, or go on, with those who are there; end where there is none."""
        absent = ", ".join(self.members.absent()) if self.tick < 0 else ""
        if not self.members.enough():
            who = "no router" if self.roster.away else f"nobody ({absent or 'all went'})"
            return self._stop(f"{who} there for {self.settings.gather:g} s, in tick {self._progress}")
        if self.tick >= 0:
            self.rounds.enter("tick", now - self._elapsed)  # the time without them does not count towards `give_up`
            return []
        if absent:
            log.warning("not there after %g s: %s; going on without", self.settings.gather, absent)
        self.run = f"{self.settings.seed}-{now:.6f}"
        self._began = now
        return self._begin_tick(now, now, {})

    def _finish_tick(self, began: float, now: float) -> list[Envelope]:
        """A tick that began at `began` is over: begin the next one, or end after the last."""
        if self.pace is Pace.REALTIME:
            if self.tick == self.ticks:
                self._close(*self._open)
                return self._stop("")
            fell_behind = now - began >= 2 * self.time.tick  # the world does not catch up; otherwise there is no drift
            return self._begin_tick(now, now if fell_behind else began + self.time.tick, {})
        instant = self._open[self.tick]
        if given_up := self.members.give_up(instant):
            self.counters["given_up"] += given_up
        self._close(self.tick)
        return self._stop("") if self.tick == self.ticks else self._begin_tick(now, now, instant.agreed_subjects())

    def _close(self, *ticks: int) -> None:
        """Take no more answers to these ticks, and keep them for the referee."""
        self._judge()
        self._over = [(self._open.pop(tick), self.sensors.judged(tick)) for tick in ticks]

    def _judge(self) -> None:
        """Give what is over to the referee, while the others work on what was sent."""
        while self._over:
            self.referee.judge_instant(*self._over.pop(0))

    # --- sending ------------------------------------------------------------------------------------------------------

    def _begin_tick(self, now: float, due: float, settled: dict[str, list[str]]) -> list[Envelope]:
        """Begin the next tick, which was `due` at a time: readings, the truth, and the Clock last."""
        self.tick += 1
        if self.tick % max(1, (self.ticks or SHOWN_TICKS) // 10) == 0:
            log.info("tick %s", self._progress)
        truth, readings = self.sensors.advance(self.run, self.tick)
        teams = self.members.teams()
        self._open[self.tick] = Instant(truth, teams, began=now, landmark_seen=who_saw_landmarks(readings))
        self._news_at, self._rounds_asked = now, 0
        for names in (self._spoke, self._done, self._lacked):
            names.clear()
        if self.pace is Pace.REALTIME and self.tick == self.ticks:
            self.rounds.enter("last", now)
        else:
            self.rounds.enter("tick", due)
        named = teams if self.pace is Pace.LOCKSTEP else {}
        clock = Clock(run=self.run, tick=self.tick, time=truth.time, mode=self.time.mode, robots=named, settled=settled)
        team = self.team.name
        self._sent = [enveloped(keys.READING.key(team=team, robot=r.robot), r) for r in readings]
        self._clock = clock
        told = [enveloped(keys.TRUTH.key(team=team), truth), enveloped(keys.CLOCK.key(team=team), clock)]
        return [*self._sent, *told]

    def _stop(self, why: str) -> list[Envelope]:
        """End, and send a last Clock that says so; `why` is empty where all ticks are done."""
        self._end = why
        self._judge()
        tick = max(0, self.tick)
        clock = Clock(run=self.run, tick=tick, time=tick * self.time.tick, mode=self.time.mode, end=True)
        return [enveloped(keys.CLOCK.key(team=self.team.name), clock)]
