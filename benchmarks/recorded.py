"""Robots of the demo that ran once, and say the same again in teams of other names."""

from dataclasses import dataclass

from blackboard.config import Scenario, load
from blackboard.lab.team import InProcessTeam
from blackboard.process.service import Around, Quiet, Service
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope

Said = list[tuple[float, Envelope]]  # when, in Unix seconds, and what


@dataclass(frozen=True)
class RecordedRun:
    """A run of the demo's robots in one sub-team: what they and their world said, and the key expressions that one of them hears."""

    scenario: Scenario
    robots: Said
    world: Said
    listens: tuple[str, ...]


class Recorded(Around):
    """A robot of which everything is kept that it says to boards."""

    def __init__(self, robot: Service, said: Said) -> None:
        super().__init__(robot)
        self.said = said

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        return self._kept(super().receive(envelope, now), now)

    def wake(self, now: float) -> list[Envelope]:
        return self._kept(super().wake(now), now)

    def _kept(self, out: list[Envelope], now: float) -> list[Envelope]:
        self.said += [(now, envelope) for envelope in out if not keys.SOLO.match(envelope.key)]
        return out


def record(robots: int, fusion: str, seconds: float, subject: str = "ball") -> RecordedRun:
    """Let the demo's robots run at 1 Hz, with its ball under the name `seen`."""
    names = [f"r{i + 1}" for i in range(robots)]
    demo = load("demo").changed("team", name="fleet", sub_teams={"a": names}).changed("board", fusion=fusion)
    objects = {subject if name == "ball" else name: table for name, table in demo.tables["world"]["objects"].items()}
    tables = demo.tables | {"world": demo.tables["world"] | {"objects": objects}}
    scenario = Scenario(tables).changed("time", tick=1.0, seconds=seconds + 2.0, mode="realtime")
    said, world = Said(), Said()
    team = InProcessTeam(scenario, around=lambda _, robot: Recorded(robot, said))
    team.bus.spies.append(
        lambda envelope: world.append((team.now, envelope)) if keys.CLOCK.match(envelope.key) else None
    )
    team.run()
    return RecordedRun(scenario, said, world, team.robots[names[0]].listens)


class Voice(Quiet):
    """A service that says what was recorded, `later` by so many seconds, in a team of another name."""

    def __init__(
        self, said: Said, team: str, later: float, tokens: tuple[str, ...], listens: tuple[str, ...] = ()
    ) -> None:
        self.said, self.team, self.later, self.next = said, team, later, 0
        self.tokens, self.listens = (tuple(_of(team, key) for key in key_exprs) for key_exprs in (tokens, listens))

    def wake(self, now: float) -> list[Envelope]:
        out = []
        while (at := self.wake_at(now)) is not None and at <= now:
            envelope = self.said[self.next][1]
            out.append(Envelope(_of(self.team, envelope.key), envelope.payload, envelope.kind))
            self.next += 1
        return out

    def wake_at(self, now: float) -> float | None:
        return self.said[self.next][0] + self.later if self.next < len(self.said) else None


def _of(team: str, key: str) -> str:
    """A key of the recorded team as one of another team."""
    return key.replace("cop/fleet/", f"cop/{team}/", 1)
