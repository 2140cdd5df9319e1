"""A robot's process without a network, and what its world and its team say to it."""

from collections.abc import Iterable

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock, Fix, Odometry
from robot_agent.config import RobotSection
from robot_agent.service import AgentService
from tests.robot_agent.robots import measured
from tests.wire import envelopes
from tests.wire.envelopes import consensus, opened, put, token

GRID = Grid((20, 20))
NOW = 1_000_000.0
WORLD = keys.WORLD.key(team="t")


def new_service(*told: Envelope) -> AgentService:
    """A robot that knows of three boards, and was told this at `NOW`."""
    robot = AgentService(team="t", sub_teams=("a",), robot="r1", grid=GRID, settings=RobotSection())
    for envelope in (*(token(keys.BOARD, board) for board in ("board-a", "one", "two")), *told):
        robot.receive(envelope, NOW)
    return robot


def readings(tick: int, run: str = "x", time: float | None = None) -> Envelope:
    what = {"odometry": Odometry(distance=0.1, turn=0.0, dt=0.2), "compass": 0.0}
    fix = None if tick else Fix(position=(10.0, 10.0), sigma=1.0)
    return put(measured(tick, run=run, time=0.2 * tick if time is None else time, fix=fix, **what))


def clock(tick: int, run: str = "x", *, settled: Iterable[str] = (), end: bool = False) -> Envelope:
    return put(Clock(run=run, tick=tick, time=0.2 * tick, mode="lockstep", settled={"a": list(settled)}, end=end))


def agreed(tick: int, subject: str = "robot/r1", board: str = "board-a", time: float | None = None) -> Envelope:
    ancestors = {"r1": 0.0, "r2": 0.0}
    time = 0.2 * tick if time is None else time
    return put(
        consensus(gaussian(GRID, (10, 10), 1.0), subject, board=board, tick=tick, time=time, ancestors=ancestors)
    )


def kinds(answers: Iterable[Envelope]) -> list[str]:
    return envelopes.kinds(opened(answers))
