"""Sensors that creep or freeze: the [[fault]]s of a scenario in what the world measures. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from blackboard.faults import AnyFault, Drift, is_of_sensors
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.wire.messages import Readings, Truth
from sim_world.sensor_source import Changed


@dataclass
class Faulted(Changed):
    """A `SensorSource` whose readings are changed by faults; the truth stays."""

    faults: Sequence[AnyFault]
    _sound: dict[str, Readings] = field(default_factory=dict)  # robot -> its newest readings that were not frozen

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        truth, readings = self.source.advance(run, tick)
        return truth, [self._changed(own) for own in readings]

    def _changed(self, readings: Readings) -> Readings:
        mine = [f for f in self.faults if is_of_sensors(f) and f.concerns(readings.robot, readings.time)]
        before = self._sound.get(readings.robot)
        if before is None or all(isinstance(fault, Drift) for fault in mine):
            self._sound[readings.robot] = readings
        else:  # a fix is an event, and is not repeated
            measured = {"odometry": before.odometry, "compass": before.compass, "sightings": before.sightings}
            readings = readings.model_copy(update={**measured, "fix": None})
        for fault in mine:
            if isinstance(fault, Drift):
                readings = crept(readings, fault)
        return readings


def crept(readings: Readings, fault: Drift) -> Readings:
    """Readings with the error that a sensor has at their time."""
    error = fault.rate * (readings.time - fault.start)
    change: dict[str, Any] = {}
    if fault.sensor == "odometry" and readings.odometry is not None:
        distance = readings.odometry.distance * (1 + error)
        change["odometry"] = readings.odometry.model_copy(update={"distance": distance})
    elif fault.sensor == "compass" and readings.compass is not None:
        change["compass"] = wrap(readings.compass + error)
    elif fault.sensor == "range":
        change["sightings"] = [
            sighting.model_copy(update={"range": max(0.0, sighting.range + error)}) for sighting in readings.sightings
        ]
    elif fault.sensor == "fix" and readings.fix is not None:
        x, y = readings.fix.position
        change["fix"] = readings.fix.model_copy(update={"position": (x + error, y)})
    return readings.model_copy(update=change)
