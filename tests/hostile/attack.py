"""A team of real services in one process, and somebody who sends it what he likes in the middle of a run."""

from collections.abc import Callable
from functools import cache
from typing import Any

import msgpack

from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.types import Message
from tests.scenarios import SCENARIO


class Attack:
    """A run that is stopped after the first messages of a tick, with the newest message that was sent on each key."""

    def __init__(self, scenario: Scenario = SCENARIO, tick: int = 2) -> None:
        self.team = InProcessTeam(scenario)
        self.newest: dict[str, Envelope] = {}
        self.team.bus.spies.append(self._remember)
        self.card: dict[str, Any] = {}  # the scorecard, at the end
        self.team.run_until(lambda: self.team.world.tick == tick)

    def _remember(self, envelope: Envelope) -> None:
        self.newest[envelope.key] = envelope

    def message(self, key: str) -> Any:
        """The newest message on a key."""
        return open_envelope(self.newest[key])[2]

    def say(self, key: str, message: Message | dict[str, Any]) -> None:
        """Send a message, or any map, on a key, from nobody in particular."""
        payload = encode(message) if isinstance(message, Message) else msgpack.packb(message)
        self.team.bus.send(Envelope(key, payload))

    def instead(self, key: str, change: Callable[[Any], list[tuple[str, Message | dict[str, Any]]]]) -> None:
        """From now on a member is broken: instead of what it sends on a key, `change` of that is sent, as (key, message)."""
        before, changing = self.team.bus.lose, False

        def lose(envelope: Envelope) -> bool:
            nonlocal changing
            if changing or envelope.key != key:
                return before(envelope)
            changing = True
            for other, message in change(open_envelope(envelope)[2]):
                self.say(other, message)
            changing = False
            return True

        self.team.bus.lose = lose

    def goes_on(self) -> None:
        """Run to the end: the world did all ticks, no service met an exception, and every board settled the last tick."""
        self.card = self.team.run()
        assert self.team.world.why == ""
        services: list[Any] = [*self.team.boards.values(), *self.team.robots.values(), self.team.world]
        assert {service.counters["failed"] for service in services} == {0}
        for board in self.team.boards.values():
            assert board.clock.tick == self.team.world.tick

    @property
    def hash(self) -> str:
        """Over all consensuses of the run."""
        return self.team.world.referee.hash


@cache
def calm(scenario: Scenario = SCENARIO) -> str:
    """The hash of the undisturbed run."""
    team = InProcessTeam(scenario)
    team.run()
    return team.world.referee.hash


def report_key(robot: str, subject: str) -> str:
    return keys.REPORT.key(team="t", sub_team="a", source=robot, subject=subject)


def status_key(process: str, sub_team: str = "a") -> str:
    return keys.STATUS.key(team="t", sub_team=sub_team, process=process)
