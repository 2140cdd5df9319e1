"""The world as a process sees it: who is there, when a tick is over, and what the referee gets to hear.

docs/design.md, "A tick in lockstep", is the protocol. In real time the world paces by `now` and waits for nobody.
"""

from __future__ import annotations

import logging
import math
from collections import Counter

from blackboard.config import Scenario
from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Message, Solo, Status
from sim_world.members import Members
from sim_world.referee import Instant, Referee
from sim_world.scenario import WorldSection
from sim_world.world import Source

log = logging.getLogger(__name__)

MAX_NAMES = 256  # of processes and strangers that are kept
LINGER = 1.0  # seconds that a tick may still be answered in real time


class WorldService:
    """The world process of a team (`blackboard.wire.envelope.Service`), with its referee."""

    def __init__(self, scenario: Scenario, source: Source, referee: Referee) -> None:
        self.team, self.time, self.rule = scenario.team, scenario.time, scenario.board.rule
        self.settings = scenario.section("world", WorldSection)
        self.lockstep = self.time.mode == "lockstep"
        self.source, self.referee = source, referee
        self.ticks = max(1, round(self.time.seconds / self.time.tick))  # after tick 0, the start
        self.members = Members(self.team.name, self.settings.grace, self.settings.comeback)
        self.counters: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.run, self.tick = "", -1
        self.link: dict[str, int] = {}  # the link's counters
        self._others: dict[tuple[str, str], Status] = {}  # (its sub-team if a board) and process -> its newest status
        self._strangers: set[str] = set()  # robots that cannot take part
        self._mute: set[str] = set()  # robots and boards that live and say nothing
        self._open: dict[int, Instant] = {}  # ticks that are not over
        self._said: list[Envelope] = []  # what was sent in the newest tick
        self._waiting: float | None = None  # since when too few are there to go on
        self._began = self._ticked = self._moved = self._now = 0.0  # Unix seconds
        self._end: str | None = None  # why it ended; "" when all ticks are done

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return (self.members.own,)

    @property
    def listens(self) -> tuple[str, ...]:
        team = self.team.name
        return (
            keys.SOLO.key(team=team, robot="*"),
            keys.CONSENSUS.key(team=team, sub_team="*", subject="**"),
            keys.AGREED.key(team=team, sub_team="*", subject="**"),
            keys.STATUS.key(team=team, sub_team="*", process="*"),
        )

    @property
    def watches(self) -> tuple[str, ...]:
        team = self.team.name
        return (
            self.members.own,  # when this one vanishes, the router is down
            keys.MEMBER.key(team=team, sub_team="*", robot="*"),
            keys.BOARD.key(team=team, sub_team="*", board="*"),
        )

    @property
    def done(self) -> bool:
        return self._end is not None

    def note(self, counters: dict[str, int]) -> None:
        self.link = counters

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._now = now
        out: list[Envelope] = []
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            if self._liveliness(envelope, now) and self._open:
                out = self._send(self._said)
        elif envelope.kind is Kind.PUT:
            self.counters["received"] += 1
            self.counters["bytes"] += len(envelope.payload)
            try:
                _, parts, message = open_envelope(envelope)
                self._hear(parts, message, envelope.payload)
            except Refused as refusal:
                self._refuse(envelope.key, refusal)
        return out + self._advance(now)

    def wake(self, now: float) -> list[Envelope]:
        self._now = now
        return self._advance(now)

    def wake_at(self, now: float) -> float | None:
        if self._end is not None:
            return None
        if self._waiting is not None:
            changes = math.inf if self.members.away else self.members.changes_at()
            return min(self._waiting + self.settings.gather, changes)
        if self.tick < 0:
            return now
        if not self.lockstep:
            last = self.tick == self.ticks
            return self._open[self.tick].began + LINGER if last else self._ticked + self.time.tick
        patience = min(self._moved + self.settings.patience, self._ticked + self.settings.give_up)
        return min(patience, self.members.changes_at())

    # --- what the scorecard asks --------------------------------------------------------------------------------------

    @property
    def why(self) -> str:
        """Why not all ticks were done; empty if they were."""
        return f"stopped in tick {self.tick} of {self.ticks}" if self._end is None else self._end

    @property
    def wall(self) -> float:
        """Wall seconds from the first tick to the newest event."""
        return self._now - self._began if self._began else 0.0

    @property
    def others(self) -> list[Status]:
        """The newest status of every other process."""
        return list(self._others.values())

    # --- what is heard ------------------------------------------------------------------------------------------------

    def _liveliness(self, envelope: Envelope, now: float) -> bool:
        """Whether somebody who takes part is back and wants to be told again."""
        back = self.members.hear(envelope, now)
        member = keys.MEMBER.match(envelope.key)
        if member and envelope.kind is Kind.ALIVE and not self.source.welcome(member["robot"]):
            if member["robot"] not in self._strangers and len(self._strangers) < MAX_NAMES:
                self._strangers.add(member["robot"])
                log.warning("%s cannot take part: there are no sensor data for it", member["robot"])
            self.counters["strangers"] = len(self._strangers)
        return back

    def _hear(self, parts: dict[str, str], message: Message, payload: bytes) -> None:
        if isinstance(message, Status):
            name = parts["sub_team"] if message.kind == "board" else "", message.process
            if name in self._others or len(self._others) < MAX_NAMES:
                self._others[name] = message
            if message.kind != "board" or message.phase not in ("consensus", "agreed"):
                return
        if not isinstance(message, Solo | Consensus | Status):
            return
        self._mute.discard(f"robot/{message.robot}" if isinstance(message, Solo) else f"board/{parts['sub_team']}")
        instant = self._open.get(message.tick)
        if instant is None:
            self.counters["late"] += not isinstance(message, Status)  # statuses are said again, for life
        elif instant.hear(parts.get("sub_team", ""), message, payload):
            self._moved = self._now

    def _refuse(self, key: str, refusal: Refused) -> None:
        self.refused[refusal.reason] += 1
        if self.refused[refusal.reason] == 1:
            log.warning("refused %.200s (%s); counted, and not logged again for this reason", key, refusal)

    # --- when a tick is over ------------------------------------------------------------------------------------------

    def _advance(self, now: float) -> list[Envelope]:
        """Do what can be done."""
        if self._end is not None:
            return []
        self.members.forget(now)
        if (self.lockstep or self.tick < 0) and not self._enough(now):
            return self._farewell() if self._end is not None else []
        if self.tick < 0:
            self.run = f"{self.settings.seed}-{now:.6f}"
            self._began = now
            return self._next(now, {})
        return self._step(now) if self.lockstep else self._pace(now)

    def _enough(self, now: float) -> bool:
        """Whether there are enough to go on: everybody at the start, later some board and some robot.

        Where that lasts too long, the run starts with those who came, or ends with nobody.
        """
        here = not self.members.away and any(self._teams().values())
        absent = self._absent() if self.tick < 0 else []
        since = now if self._waiting is None else self._waiting
        if here and (not absent or now - since >= self.settings.gather):
            if absent:
                log.warning("not there after %g s: %s; going on without", self.settings.gather, ", ".join(absent))
            self._waiting = None
            self._ticked += now - since  # the time away does not count against anybody
            return True
        self._waiting = since
        if now - since >= self.settings.gather:
            who = "no router" if self.members.away else f"nobody ({', '.join(absent) or 'all went'})"
            self._end = f"{who} there for {self.settings.gather:g} s, in tick {self.tick} of {self.ticks}"
        return False

    def _absent(self) -> list[str]:
        """Those of the scenario that are not there."""
        boards, robots = self.members.boards, self.members.robots
        found = [f"the board of {sub_team}" for sub_team in self.team.sub_teams if sub_team not in boards]
        for sub_team, names in self.team.sub_teams.items():
            found += [f"{name} of {sub_team}" for name in names if name not in robots.get(sub_team, [])]
        return found

    def _teams(self) -> dict[str, list[str]]:
        """Who takes part: the sub-teams that have a board, with those of their robots that get readings and answer."""
        known = set(self.source.robots)
        return {
            sub_team: [
                name
                for name in self.members.robots.get(sub_team, [])
                if name in known and f"robot/{name}" not in self._mute
            ]
            for sub_team in sorted(self.members.boards)
            if f"board/{sub_team}" not in self._mute
        }

    def _step(self, now: float) -> list[Envelope]:
        """Lockstep: the next tick, once everybody who takes part and still lives has answered; else ask again."""
        instant = self._open[self.tick]
        missing = self._missing(instant)
        if missing and now - self._ticked >= self.settings.give_up:
            log.warning("tick %d: %s alive and silent; no longer waited for", self.tick, ", ".join(sorted(missing)))
            self.counters["given_up"] += len(missing)
            self._mute |= missing
            missing = set()
        if not missing:
            settled = {s: instant.statuses[s, "agreed"].subjects for s in instant.teams if instant.settled(s)}
            self._over(self.tick)
            return self._next(now, settled)
        if now - self._moved >= self.settings.patience:
            self._moved = now
            self.counters["repeated"] += 1
            return self._send(self._said)
        return []

    def _missing(self, instant: Instant) -> set[str]:
        """Who takes part in a tick, is alive, and has not said everything."""
        alive = self._teams()
        boards = {f"board/{s}" for s in instant.teams if s in alive and not instant.settled(s)}
        robots = {r for s, names in instant.teams.items() for r in names if r in alive.get(s, [])}
        return boards | {f"robot/{robot}" for robot in robots - set(instant.solos)}

    def _pace(self, now: float) -> list[Envelope]:
        """Real time: a tick every `tick` seconds, without catching up; what is said within LINGER counts."""
        for tick, instant in list(self._open.items()):
            if now - instant.began >= LINGER:
                self._over(tick)
        if self.tick < self.ticks and now - self._ticked >= self.time.tick:
            return self._next(now, {})
        return self._next(now, {}) if self.tick == self.ticks and not self._open else []

    def _over(self, tick: int) -> None:
        self.referee.hear(self._open.pop(tick), self.source.judged(tick))

    # --- what is said -------------------------------------------------------------------------------------------------

    def _next(self, now: float, settled: dict[str, list[str]]) -> list[Envelope]:
        """Begin the next tick, or end after the last one."""
        if self.tick == self.ticks:
            self._end = ""
            return self._farewell()
        self.tick += 1
        if self.tick % max(1, self.ticks // 10) == 0:
            log.info("tick %d of %d", self.tick, self.ticks)
        truth, readings = self.source.advance(self.run, self.tick)
        teams = self._teams()
        # in real time without drift, unless the world itself fell behind
        on_time = not self.lockstep and self.tick and now - self._ticked < 2 * self.time.tick
        self._ticked = self._ticked + self.time.tick if on_time else now
        self._moved = now
        self._open[self.tick] = Instant(truth, teams, began=now)
        named = teams if self.lockstep else {}
        mode, team = self.time.mode, self.team.name
        clock = Clock(run=self.run, tick=self.tick, time=truth.time, mode=mode, robots=named, settled=settled)
        self._said = [Envelope(keys.READING.key(team=team, robot=r.robot), encode(r)) for r in readings]
        self._said.append(Envelope(keys.TRUTH.key(team=team), encode(truth)))
        self._said.append(Envelope(keys.CLOCK.key(team=team), encode(clock)))
        return self._send(self._said)

    def _farewell(self) -> list[Envelope]:
        """The last word to everybody."""
        tick = max(0, self.tick)
        clock = Clock(run=self.run, tick=tick, time=tick * self.time.tick, mode=self.time.mode, end=True)
        return self._send([Envelope(keys.CLOCK.key(team=self.team.name), encode(clock))])

    def _send(self, envelopes: list[Envelope]) -> list[Envelope]:
        self.counters["sent"] += len(envelopes)
        self.counters["bytes"] += sum(len(envelope.payload) for envelope in envelopes)
        return list(envelopes)
