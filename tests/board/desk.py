"""A board process under test without a network, and the messages that others send to it."""

from typing import Any

from blackboard.board.service import BoardService
from blackboard.config import BoardSection, TeamSection
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Report, Status
from tests.wire.envelopes import consensus, put, token, world

GRID = Grid((30, 20))
NOW = 1_000_000.0
WORLD = world()
ANOTHER_WORLD = world(Kind.GONE), WORLD  # the world was started again


def board_of(sub_team: str, kind: Kind = Kind.ALIVE, name: str | None = None) -> Envelope:
    """The token of a board, which has the name of its sub-team."""
    return token(keys.BOARD, name or sub_team, sub_team=sub_team, kind=kind)


class Desk:
    """One board process under test, and what it said; what it remembers is left out, which it may say once a second."""

    def __init__(
        self, *robots: str, world: bool = True, members: TeamSection | None = None, **settings: object
    ) -> None:
        """A board with these robots; a world is there unless `world` is False. `members`: as a scenario names them."""
        chosen = BoardSection.model_validate(settings)
        self.service = BoardService(team="t", sub_team="a", board="a", grid=GRID, settings=chosen, members=members)
        self.now = NOW
        self.said: list[Envelope] = []
        if world:
            self.tell(WORLD)
        self.register(*robots)

    def tell(self, *envelopes: Envelope) -> list[Envelope]:
        """One batch of messages, after which the board is woken if that is due, as by the loop."""
        said = [answer for envelope in envelopes for answer in self.service.receive(envelope, self.now)]
        return self._noted(said + (self._wake() if self.service.wake_at(self.now) == self.now else []))

    def wait(self, seconds: float) -> list[Envelope]:
        self.now += seconds
        return self._noted(self._wake())

    def _wake(self) -> list[Envelope]:
        """Wake the board, which then has nothing more to do at once: else its process would spin."""
        said, due = self.service.wake(self.now), self.service.wake_at(self.now)
        assert due is None or due > self.now
        return said

    def _noted(self, out: list[Envelope]) -> list[Envelope]:
        """What the board said, and that its invariants hold."""
        self.service.check()
        said = [envelope for envelope in out if keys.MEMORY.match(envelope.key) is None]
        self.said += said
        return said

    def register(self, *robots: str) -> None:
        self.tell(*(token(keys.MEMBER, robot) for robot in robots))

    def status(self) -> Status:
        self.wait(1.5)
        statuses = [decode(Status, e.payload) for e in self.said if "/status/" in e.key]
        return statuses[-1]


def clock(tick: int, *robots: str, run: str = "one", mode: str = "lockstep", **more: object) -> Envelope:
    """A Clock; in lockstep the robots of sub-team a take part, and `more` sub-teams with theirs."""
    named = {"a": list(robots), **more} if mode == "lockstep" else {}
    return put(Clock(run=run, tick=tick, time=0.2 * tick, mode=mode, robots=named))  # type: ignore[arg-type]


def ball(x: float = 10) -> Belief:
    return gaussian(GRID, (x, 10), 2)


def report(
    source: str, tick: int, belief: Belief | None = None, *, time: float | None = None, size: int = 0
) -> Envelope:
    """A report on the ball; with a `size`, one whose belief has so many bytes of data."""
    packed = pack(belief or ball())
    if size:
        packed = packed.model_copy(update={"data": bytes(size)})
    time = 0.2 * tick if time is None else time
    return put(Report(source=source, subject="object/ball", tick=tick, time=time, belief=packed))


def reported(source: str, tick: int, *subjects: str) -> Envelope:
    status = Status(process=source, kind="robot", tick=tick, time=0.2 * tick, phase="reported", subjects=list(subjects))
    return put(status)


def idle(robot: str) -> Envelope:
    """What a robot says before its first tick."""
    return put(Status(process=robot, kind="robot", tick=0, time=0.0))


def theirs(sub_team: str, tick: int, name: str | None = None, **more: Any) -> Envelope:
    """What the board of another sub-team says of the ball, from a robot r4."""
    time = 0.2 * tick
    fields = {"board": name or sub_team, "level": "consensus", "tick": tick, "time": time, "ancestors": {"r4": time}}
    belief = more.pop("belief", ball(12))
    return put(consensus(belief, sub_team=sub_team, **{**fields, **more}))


def settled(sub_team: str, tick: int, *subjects: str, name: str | None = None, phase: str = "consensus") -> Envelope:
    """What the board of another sub-team lists."""
    process = name or sub_team
    said = Status(process=process, kind="board", tick=tick, time=0.2 * tick, phase=phase, subjects=list(subjects))  # type: ignore[arg-type]
    return put(said, sub_team=sub_team)


def leading(board: str, **part: object) -> Envelope:
    """The status of another board of sub-team a, which leads."""
    fields = {"process": board, "kind": "board", "tick": 0, "time": 0.0, "since": 0.0, **part}
    return put(Status.model_validate(fields))


def levels(said: list[Envelope]) -> list[str]:
    return [e.key.split("/")[3] for e in said if "/consensus/" in e.key or "/agreed/" in e.key]


def exchanging() -> Desk:
    """A board of sub-team a that waits for the board of b, in tick 0."""
    desk = Desk()
    desk.tell(board_of("b"), clock(0, "r1", b=["r4"]))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus"]
    return desk
