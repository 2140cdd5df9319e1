"""A whole team with a lie, in one process and with real bytes: what was believed of the honest, and who was named."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from blackboard.chaos.lies.catalogue import Lie
from blackboard.chaos.lies.liar import Liar
from blackboard.chaos.lies.scene import Scene
from blackboard.config import Scenario
from blackboard.judge.samples import Keep, Sample
from blackboard.lab.team import InProcessTeam
from blackboard.process.service import Service
from blackboard.run.logs import quiet
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status


@dataclass
class Trial:
    """What came of a run."""

    samples: list[Sample] = field(default_factory=list)  # of what was agreed
    named: dict[str, list[float]] = field(default_factory=dict)  # robot -> team times (s) at which a board named it
    seconds: float = 0.0  # of the processor


def liars_of(scenario: Scenario, count: int) -> list[str]:
    """The robots that lie: the last one of each sub-team, then the last but one, and so on."""
    teams = [list(reversed(robots)) for robots in scenario.team.sub_teams.values()]
    turns = [robots[place] for place in range(max(map(len, teams))) for robots in teams if place < len(robots)]
    return list(dict.fromkeys(turns))[:count]


def guests_of(count: int) -> list[str]:
    return [f"guest{number}" for number in range(1, count + 1)]


def span(scenario: Scenario, lie: Lie) -> tuple[float, float]:
    """Team times (s) at which a lie begins and ends."""
    return lie.start * scenario.time.seconds, lie.end * scenario.time.seconds


def lying_team(
    scenario: Scenario, lie: Lie | None, rng: np.random.Generator, record: Keep | None = None
) -> InProcessTeam:
    """A team in lockstep with its liars; guests are not yet there. `record` is given every sample that counts."""
    liars = [] if lie is None else [*liars_of(scenario, lie.liars), *guests_of(lie.guests)]
    mates = sorted(set(scenario.team.robots) - set(liars))

    def lying(name: str, service: Service) -> Service:
        if lie is None or name not in liars:
            return service
        return Liar(service, Scene(name, scenario.grid, mates, rng), lie, *span(scenario, lie))

    return InProcessTeam(scenario.changed("time", mode="lockstep"), around=lying, record=record)


def run_lie(team: InProcessTeam, lie: Lie | None) -> None:
    """Run a team to its end; guests join the first sub-team when their lie begins. RunFailed: the run did not end."""
    time = team.scenario.time
    if lie is not None and lie.guests:
        team.run_until(lambda: team.world.tick * time.tick >= span(team.scenario, lie)[0])
        for guest in guests_of(lie.guests):
            team.add_robot(guest, list(team.scenario.team.sub_teams)[:1])
    team.run()


def try_lie(scenario: Scenario, lie: Lie | None, rng: np.random.Generator) -> Trial:
    """Run a scenario with a lie; None: nobody lies. RunFailed: the run did not end."""
    trial = Trial()

    def keep(sample: Sample) -> None:
        if sample.level == "agreed":
            trial.samples.append(sample)

    with quiet():
        before = os.times().user
        team = lying_team(scenario, lie, rng, keep)
        team.bus.spies.append(lambda envelope: _note(envelope, trial.named))
        run_lie(team, lie)
        trial.seconds = os.times().user - before
    return trial


def honest(samples: Collection[Sample], robots: Collection[str], begin: float) -> list[Sample]:
    """What was agreed on honest robots and, by these, on objects, from a team time (s) on."""
    about = {f"robot/{robot}" for robot in robots}
    return [
        sample
        for sample in samples
        if sample.time >= begin
        and sample.robot in robots
        and (sample.subject in about or sample.subject.startswith("object/"))
    ]


def _note(envelope: Envelope, named: dict[str, list[float]]) -> None:
    if envelope.kind is not Kind.PUT or keys.STATUS.match(envelope.key) is None:
        return
    status = decode(Status, envelope.payload)
    for source in {named.source for named in status.dissent} if status.kind == "board" else ():
        times = named.setdefault(source, [])
        if not times or times[-1] < status.time:
            times.append(status.time)
