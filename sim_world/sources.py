"""Where sensor data come from: the simulated world, or the replay of a recording."""

import numpy as np

from blackboard.config import Scenario
from blackboard.config.pyfg import read_graph
from blackboard.config.world import DetectorSection, WorldSection
from blackboard.faults import faults_of, is_of_sensors
from sim_world.detector import Detected
from sim_world.faults import Faulted
from sim_world.mrclam.files import read_recording
from sim_world.mrclam.replay import MrclamSource
from sim_world.pyfg import GraphReplay
from sim_world.sensor_source import SensorSource
from sim_world.world import Streams, World


def seeded_streams(seed: int) -> Streams:
    """Random numbers that only a seed decides: a generator of its own for each name, so that names do not disturb each other."""
    return lambda name: np.random.default_rng([seed, *name.encode()])


def open_sensor_source(scenario: Scenario, streams: Streams | None = None) -> SensorSource:
    """The source that [world] asks for; `streams` gives the simulated world its random numbers [default: by the scenario's seed].

    UserError: a section or a recording that is wrong, or robots and times that do not fit it.
    """
    source: SensorSource = _sound_source(scenario, streams)
    if faults := [fault for fault in faults_of(scenario) if is_of_sensors(fault)]:
        source = Faulted(source, faults)
    settings = scenario.section("world", WorldSection)
    if not settings.people.count and settings.detector == DetectorSection():
        return source
    return Detected(source, settings.detector, settings.vision, streams or seeded_streams(settings.seed))


def replayed_from(scenario: Scenario) -> float | None:
    """When the replay of a scenario begins, Unix seconds; None where the world is simulated. UserError: as of `open_sensor_source`."""
    source = _sound_source(scenario, None)
    return source.start if isinstance(source, MrclamSource | GraphReplay) else None


def _sound_source(scenario: Scenario, streams: Streams | None) -> SensorSource:
    settings = scenario.section("world", WorldSection)
    robots, time = scenario.team.robots, scenario.time
    if settings.kind == "mrclam":
        return MrclamSource(settings, read_recording(settings.dir), robots, time.tick, time.seconds)
    streams = streams or seeded_streams(settings.seed)
    if settings.kind == "pyfg":
        return GraphReplay(settings, read_graph(settings.dir), robots, time.tick, time.seconds, streams)
    return World(settings, scenario.grid, robots, time.tick, streams)
