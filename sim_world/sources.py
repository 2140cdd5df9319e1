"""Where sensor data come from: the simulated world, or the replay of a recording."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from blackboard.config import Scenario
from blackboard.faults import faults_of, is_of_sensors
from blackboard.wire.messages import Readings, Truth
from sim_world.mrclam.files import read_recording
from sim_world.mrclam.replay import Replay
from sim_world.scenario import WorldSection
from sim_world.world import Streams, World


class SensorSource(Protocol):
    """Makes the readings of all robots, tick by tick, and the truth beside them."""

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots that get readings."""

    def admit(self, robot: str) -> bool:
        """Take in a robot that the scenario does not name; False where there can be no readings for it."""

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        """The next tick: 0 is the start, k is k steps later. To be called once per tick, in order."""

    def judged(self, tick: int) -> bool:
        """Whether the referee scores this tick."""


def seeded_streams(seed: int) -> Streams:
    """Random numbers that only a seed decides: a generator of its own for each name, so that names do not disturb each other."""
    return lambda name: np.random.default_rng([seed, *name.encode()])


def open_sensor_source(scenario: Scenario, streams: Streams | None = None) -> SensorSource:
    """The source that [world] asks for; `streams` gives the simulated world its random numbers [default: by the scenario's seed].

    UserError: a section or a recording that is wrong, or robots and times that do not fit it.
    """
    source, faults = _sound_source(scenario, streams), [fault for fault in faults_of(scenario) if is_of_sensors(fault)]
    if not faults:
        return source
    from sim_world.faults import Faulted

    return Faulted(source, faults)


def _sound_source(scenario: Scenario, streams: Streams | None) -> SensorSource:
    settings = scenario.section("world", WorldSection)
    robots, time = scenario.team.robots, scenario.time
    if settings.kind == "mrclam":
        return Replay(settings, read_recording(settings.dir), robots, time.tick, time.seconds)
    return World(settings, scenario.grid, robots, time.tick, streams or seeded_streams(settings.seed))
