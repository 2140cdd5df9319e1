"""The stage of a night: the processes of a team in virtual time, with whatever the faults that are active do to them.

What runs, who is frozen, who sees whose tokens and which clock is off follows at each moment from the faults that are active then.
"""

import errno
import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from random import Random
from typing import Any

import numpy as np

from blackboard.board.service import BoardService, board_of
from blackboard.chaos.lies.catalogue import CATALOGUE
from blackboard.chaos.lies.liar import Liar
from blackboard.chaos.lies.scene import Scene
from blackboard.client.member import Member
from blackboard.errors import Refused, RunFailed
from blackboard.net.bus import intersects
from blackboard.net.scheduler import AT_ONCE, Scheduler
from blackboard.opinion.belief import gaussian, uniform
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.once import SettledOnce, settle_alone
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.process.service import Around, Checked, Service
from blackboard.tape.file import TapeWriter
from blackboard.tape.journal import Journaled, digest
from blackboard.tape.recorder import Recorder
from blackboard.wire.arrays import pack
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Readings, Status, Truth
from robot_agent.config import settings_of
from robot_agent.driven import Driven, SinceStep
from robot_agent.gaussian.sensors import sensors_of
from robot_agent.service import AgentService
from robot_agent.team import robot_of
from sim_world.sensor_source import SensorSource
from sim_world.service import WorldService
from sim_world.sources import open_sensor_source
from tests.nights import faults
from tests.nights.events import (
    Began,
    Died,
    Ended,
    Event,
    Healed,
    Heard,
    Looked,
    Moved,
    Over,
    Recovered,
    Sensed,
    Stepped,
    Unsound,
    said,
)
from tests.nights.night import CELLS, Night
from tests.wire.envelopes import consensus, put

#: One step of a joint in so many is made by a board for itself: boards that differ once differ from then on, and are noticed.
ALONE = 5
CHECKED = 1.0  # seconds between two looks at the invariants of all machines
RECORDER = "recorder"
OFTEN = 5000  # times that a process is woken in a second after which it does nothing else


@dataclass(frozen=True, slots=True)
class Seen(Envelope):
    """A token as one process sees it come or go: with partitions not all see the same."""


class Watched(Around):
    """A process by its name: the oracles see all that it says and does, and every exception that leaves it."""

    def __init__(self, name: str, service: Service, stage: "Stage") -> None:
        super().__init__(service)
        self.name, self._stage = name, stage
        self._woken: deque[float] = deque(maxlen=OFTEN)  # when it was woken last, seconds of the night

    @property
    def done(self) -> bool:
        return False

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind is Kind.PUT:
            self._stage.tell(Heard(self._stage.at, self.name, self.machine, envelope))
        return self.act(lambda: self.inner.receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        self._woken.append(self._stage.at)
        return self.act(lambda: self.inner.wake(now))

    def wake_at(self, now: float) -> float | None:
        if len(self._woken) < OFTEN or self._stage.at - self._woken[0] > 1.0:
            return self.inner.wake_at(now)
        error = RunFailed(f"it is woken {OFTEN} times in a second")
        self._stage.tell(Died(self._stage.at, self.name, self.machine, error))
        return None  # else the night would never end

    def check(self) -> None:
        """Tell which invariant does not hold."""
        try:
            if isinstance(self.inner, Checked):
                self.inner.check()
        except AssertionError as error:
            self._stage.tell(Unsound(self._stage.at, self.name, self.machine, error))

    @property
    def machine(self) -> Service:
        """The service itself, without its journal."""
        return self.inner.inner if isinstance(self.inner, Journaled | Liar) else self.inner

    def act(self, act: Callable[[], list[Envelope]]) -> list[Envelope]:
        """Let the process do something: what it says. The oracles see that, and an exception."""
        stage, self._stage.acting = self._stage, self.name
        try:
            out = act()
        except Exception as error:
            stage.tell(Died(stage.at, self.name, self.machine, error))
            return []
        for envelope in out:
            stage.tell(event := said(stage.at, self.name, self.machine, envelope))
            if isinstance(event.message, Truth) and self.name == "world":
                stage.truth = event.message
        stage.tell(Moved(stage.at, self.name, self.machine))
        return out


class Unjudged:
    """In place of a world's referee: the oracles judge."""

    def judge_instant(self, *ticks: object) -> None:
        """Nothing is kept."""


class Disk(BytesIO):
    """A file on a disk that may be full."""

    full = False

    def write(self, data: Any) -> int:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


class Guest(Around):
    """A program of other people: it reports twice a second where it sees an object."""

    def __init__(self, stage: "Stage", member: Member, chance: Random) -> None:
        super().__init__(member)
        self._stage, self._member, self._chance, self._due = stage, member, chance, 0.0

    def wake_at(self, now: float) -> float:
        inner = self.inner.wake_at(now)
        return self._due if inner is None else min(self._due, inner)

    def wake(self, now: float) -> list[Envelope]:
        out, truth = self.inner.wake(now), self._stage.truth
        if now >= self._due:
            self._due = now + 0.5
            if truth is not None:
                measured = [x + self._chance.gauss(0.0, 1.0) for x in truth.positions["object/ball"]]
                place = [min(max(x, 0.0), float(CELLS)) for x in measured]
                with suppress(Refused):
                    out += self._member.report("object/ball", gaussian(self._member.grid, place, 1.0), now)
        return out

    def check(self) -> None:
        self._member.check()


class Stage(Scheduler):
    """The team of a night; `tell` is called with each event."""

    def __init__(
        self, night: Night, tell: Callable[[Event], None], *, record: bool = False, alone: int = ALONE
    ) -> None:
        """With `record` the boards keep journals and a recorder writes a tape, to `disk`. `alone`: instead of `ALONE`."""
        super().__init__()
        self._settle_once, self._alone, self._steps = SettledOnce(), alone, 0
        self.night, self.tell, self.began = night, tell, self.now
        self.scenario = night.team.scenario(night.seed)
        self.truth: Truth | None = None
        self.acting = ""  # the process that hears something, or was woken, last
        self.running: dict[str, Watched] = {}
        self._chance = {fault: Random(f"{night.seed} {fault}") for fault in night.faults}
        self._active: list[faults.Fault] = []
        self._seen: dict[str, set[str]] = {}  # process -> the tokens that it sees
        self._arrivals: dict[tuple[str, str, str], float] = {}  # sender, receiver and key -> when the newest arrives
        self._frozen: set[str] = set()
        self._renewed: dict[str, list[faults.Fault]] = {}  # process -> the faults that it was started under
        self._sensors: SensorSource | None = None
        self._ticks = 0  # of the sensors, where there is no world
        self._untold: dict[str, SinceStep] = {}  # robot that is frozen -> what its sensors measured meanwhile
        self.route = self._route
        self.disk, self.records = Disk(), record
        self.strange: set[str] = set()  # the digests of what strangers said
        if record:
            writer = TapeWriter(self.disk, {"team": "t", "scenario": self.scenario.to_json()})
            self.writer, self._recorder = writer, Recorder("t", writer)

    @property
    def at(self) -> float:
        """Seconds of the night that are over; rounded, because a fault begins and ends at a number, not a little before it."""
        return round(self.now - self.began, 9)

    def play(self, until: float = math.inf) -> None:
        """The night, from its beginning until so many seconds of it are over."""
        night = self.night
        turns: dict[float, type[Event]] = {night.healed: Healed, night.well: Recovered, night.end: Over}
        moments = {0.0, *turns, *(at for fault in night.faults for at in fault.moments())}
        moments |= {CHECKED * n for n in range(1, math.floor(night.end / CHECKED) + 1)}
        sensed = {night.team.tick * n for n in range(1, math.floor(night.end / night.team.tick) + 1)}
        for at in sorted(moments | sensed if night.team.mode == "free" else moments):
            if at > until:
                self.run_to(self.began + until)
                break
            self.run_to(self.began + at)
            self._update(at)
            if at in sensed and night.team.mode == "free":
                self._sense()
            if at in turns:
                self.tell(turns[at](at))
        for watched in self.running.values():
            self.tell(Ended(self.at, watched.name, watched.machine))
        if self.records:
            self.disk.full = False
            self.writer.close()

    def settle(self, team: TeamJoint, number: int, dt: float, batch: Sequence[Evidence]) -> TeamJoint:
        """The joint of the board that acts makes a step (`once.Settle`), which boards that settle alike make once."""
        before, machine = team.joint.copy(), self.running[self.acting].machine
        self._steps += 1
        after = (settle_alone if self._steps % self._alone == 0 else self._settle_once)(team, number, dt, batch)
        assert isinstance(machine, BoardService)
        run, board, made = machine.clock.run, machine.board, after.tally
        outvoted = [robot for robot, choice in made.choices.items() if choice.outvoted]
        told = before, after.joint, list(made.unnamed), outvoted, list(made.verdicts), made.silent
        self.tell(Stepped(self.at, self.acting, run, board, number, dt, batch, *told))
        return after

    # --- who runs ---------------------------------------------------------------------------------------------------------

    def _update(self, at: float) -> None:
        """Let everything be as the faults that are active at a time have it."""
        self._active = [fault for fault in self.night.faults if fault.is_active(at)]
        added = [name for fault in self._active if (name := fault.adds())]
        cast = [*([RECORDER] if self.records else []), *self.night.team.processes, *added]
        for name in [name for name in self.running if name not in cast]:
            self._stop(name)
        for name in dict.fromkeys(cast):
            stopped = any(fault.stops(name, at) for fault in self._active)
            renewed = [fault for fault in self._active if fault.renews(name)]
            if name in self.running and (stopped or renewed != self._renewed.get(name, [])):
                self._stop(name)
            if not stopped and name not in self.running:
                self._renewed[name] = renewed
                self._start(name)
        for name, watched in self.running.items():
            self.set_clock(watched, self._ahead(name))
            frozen = any(fault.freezes(name, at) for fault in self._active)
            if frozen and name not in self._frozen:
                self._frozen.add(name)
                self.freeze(watched)
        self._tell_to_lie()
        self.disk.full = any(isinstance(fault, faults.FullDisk) for fault in self._active)
        self._show_tokens()
        for fault in self.night.faults:
            if isinstance(fault, faults.Crowd):
                self._hear_crowd(fault, at)
        for name in sorted(self._frozen):
            if not any(fault.freezes(name, at) for fault in self._active):
                self._frozen.discard(name)
                self.thaw(self.running[name])

    def _start(self, name: str) -> None:
        service = self.running[name] = Watched(name, self._made(name), self)
        self._seen[name] = set()
        self.join(service, self._ahead(name))
        self.tell(Began(self.at, name, service.machine))

    def _stop(self, name: str) -> None:
        service = self.running.pop(name)
        self._frozen.discard(name)
        self.leave(service)
        del self._seen[name]
        self._untold.pop(name, None)
        self.tell(Ended(self.at, name, service.machine))

    def _made(self, name: str) -> Service:
        kind, *rest = name.split("/")
        if kind == "robot":
            return self._robot(name, rest[0])
        if kind == "world":
            unjudged: Any = Unjudged()
            return WorldService(self.scenario, open_sensor_source(self.scenario), unjudged)
        if kind == "guest":
            sub_team = min(self.night.team.sub_teams)
            grid, settings = self.scenario.grid, self.scenario.board
            member = Member(team="t", sub_teams=(sub_team,), robot=rest[0], grid=grid, settings=settings)
            return Guest(self, member, Random(f"{self.night.seed} {name} {self.at}"))
        if kind == RECORDER:
            return self._recorder
        board = board_of(self.scenario, rest[0], rest[1], self.settle)
        return Journaled(board, team="t", sub_team=rest[0], board=rest[1]) if self.records else board

    def _robot(self, name: str, robot: str) -> Service:
        """A robot; one that lies does so as long as `_update` says."""
        guest = next(
            (fault for fault in self.night.faults if isinstance(fault, faults.LyingGuest) and fault.adds() == name),
            None,
        )
        sub_teams = self.scenario.team.of(robot) if guest is None else [guest.sub_team]
        if robot in self.night.team.driven and name not in self.night.liars:
            board, grid = self.scenario.board, self.scenario.grid
            who: dict[str, Any] = {"team": "t", "sub_teams": sub_teams, "robot": robot, "grid": grid}
            who |= {"joint": board.fusion == "joint", "feedback": board.feedback, "drift": board.drift}
            settings = settings_of(self.scenario, robot)
            robots = len(self.scenario.team.robots)
            return Driven(lambda news, now: None, settings=settings, sensors=sensors_of(settings), robots=robots, **who)
        service = robot_of(self.scenario, robot, sub_teams=sub_teams)
        lie = next((lies[name] for fault in self.night.faults if name in (lies := fault.lies())), None)
        if lie is None:
            return service
        mates = sorted(set(self.night.team.robots) - {liar.removeprefix("robot/") for liar in self.night.liars})
        scene = Scene(robot, self.scenario.grid, mates, np.random.default_rng(self.night.seed))
        return Liar(service, scene, CATALOGUE[lie], math.inf, math.inf)

    def _tell_to_lie(self) -> None:
        """Let whoever lies begin and end, in its own team time."""
        for name in self.night.liars & self.running.keys():
            liar = self.running[name].inner
            assert isinstance(liar, Liar)
            agent = liar.inner
            assert isinstance(agent, AgentService)
            knows_the_time = self.night.team.mode == "free" or agent.clock.followed is not None
            lies = knows_the_time and any(name in fault.lies() for fault in self._active)
            if lies != (liar.begin < math.inf):
                liar.begin = agent.clock.time(self.now + self._ahead(name)) if lies else math.inf

    def _ahead(self, name: str) -> float:
        return sum(fault.ahead(name, self.at) for fault in self.night.faults)

    # --- who hears whom ---------------------------------------------------------------------------------------------------

    def _are_parted(self, one: str, other: str) -> bool:
        return any(fault.parts(one, other) for fault in self._active)

    def _show_tokens(self) -> None:
        """Tell each process which tokens have come or gone, as far as it sees them now."""
        held = {name: watched.tokens for name, watched in self.running.items()}
        hidden = {name for name in held if any(fault.hides(name, self.at) for fault in self._active)}
        for name, watched in self.running.items():
            link = self.link(watched)
            visible = {
                token
                for holder, tokens in held.items()
                if not self._are_parted(holder, name) and (holder == name or holder not in hidden)
                for token in tokens
                if any(intersects(watch, token) for watch in link.watched)
            }
            before, self._seen[name] = self._seen[name], visible
            for token in sorted(before - visible):
                self.bus.deliver(link, Seen(token, kind=Kind.GONE))
            for token in sorted(visible - before):
                self.bus.deliver(link, Seen(token, kind=Kind.ALIVE))

    def _route(self, sender: Service | None, receiver: Service, envelope: Envelope) -> Sequence[float]:
        latency = self.night.team.latency
        assert isinstance(receiver, Watched)
        if isinstance(envelope, Seen):
            return (latency,)
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            return ()  # tokens are shown to each process by itself
        if sender is None:
            return AT_ONCE
        assert isinstance(sender, Watched)
        if receiver.name == RECORDER:
            return (latency,)
        if self._are_parted(sender.name, receiver.name):
            return ()
        way = faults.Way(sender.name, receiver.name, envelope)
        delays: Sequence[float] = (latency,)
        for fault in self._active:
            delays = fault.copies(way, delays, self._chance[fault])
        astray = [latency + more for fault in self._active for more in fault.astray(way, self._chance[fault])]
        return [*self._in_order(way, delays), *astray]

    def _in_order(self, way: faults.Way, delays: Sequence[float]) -> Sequence[float]:
        """Delays such that what is sent on one key arrives in the order of sending, as a network keeps it."""
        key = way.sender, way.receiver, way.envelope.key
        least = self._arrivals.get(key, 0.0) - self.now
        delays = [max(delay, least) for delay in delays]
        if delays:
            self._arrivals[key] = self.now + max(delays)
        return delays

    def _hear_crowd(self, crowd: faults.Crowd, at: float) -> None:
        """Let strangers speak when they begin, and show every process when they end."""
        if at == crowd.end:
            for name in sorted(self.running.keys() - {RECORDER}):  # which numbers the keys of its tape, up to 4 096
                self.tell(Looked(at, name, self.running[name].machine))
        belief, sub_team = pack(uniform(self.scenario.grid)), crowd.sub_team
        more: dict[str, Any] = {"tick": 0, "time": self.now}
        for name in crowd.names if at == crowd.begin else ():
            status = Status(process=name, kind="robot", phase="reported", subjects=["object/ball"], **more)
            said = consensus(belief, f"object/{name}", board=name, sub_team=sub_team, entropy=0.0, **more)
            for envelope in (put(status, sub_team=sub_team), put(said)):
                self.strange.add(digest(envelope))
                self.bus.send(envelope)

    # --- a team without a world -------------------------------------------------------------------------------------------

    def _sense(self) -> None:
        """Give each robot its readings, stamped by its own clock: its sensors are its own."""
        if self._sensors is None:
            self._sensors = open_sensor_source(self.scenario)
        self.truth, all_readings = self._sensors.advance("free", self._ticks)
        self._ticks += 1
        self.tell(Sensed(self.at, self.truth))
        for readings in all_readings:
            name = f"robot/{readings.robot}"
            if name in self.running:
                time = self.now + self._ahead(name)
                self._give(self.running[name], readings.model_copy(update={"time": time}))

    def _give(self, to: Watched, readings: Readings) -> None:
        if isinstance(to.machine, Driven):
            self._step(to, to.machine, readings)
            return
        self.bus.deliver(self.link(to), put(readings))

    def _step(self, to: Watched, machine: Driven, readings: Readings) -> None:
        """Let a robot's program make a step with what its sensors measured since the last one. A frozen program makes it later."""
        compass = None if readings.compass is None else (readings.compass, readings.compass_sigma)
        told = readings.odometry, compass, readings.fix, tuple(readings.sightings), tuple(readings.seen)
        since = SinceStep(*told)
        for fault in self._active:
            if part := fault.silences(to.name):
                since = replace(since, **{part: faults.PARTS[part]})
        since = self._untold.get(to.name, SinceStep()).plus(since)
        if to.name in self._frozen:
            self._untold[to.name] = since
            return
        self._untold.pop(to.name, None)
        self.send(to, to.act(lambda: machine.step(since, readings.time)[1]))
