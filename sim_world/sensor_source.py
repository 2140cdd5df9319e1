"""What every source of sensor data can do: the simulated world, the replay of a recording, and either of them under faults."""

from dataclasses import dataclass
from typing import Protocol

from blackboard.wire.messages import Readings, Truth


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


@dataclass
class Changed:
    """What is the same of a source whose readings are those of another one, changed."""

    source: SensorSource

    @property
    def robots(self) -> tuple[str, ...]:
        return self.source.robots

    def admit(self, robot: str) -> bool:
        return self.source.admit(robot)

    def judged(self, tick: int) -> bool:
        return self.source.judged(tick)
