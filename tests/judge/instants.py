"""Ticks with exact beliefs for the tests of the referee."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from blackboard.config.world import CheckSection
from blackboard.judge.instant import Instant
from blackboard.judge.referee import Referee
from blackboard.opinion.grid import Grid
from blackboard.wire.codec import encode
from blackboard.wire.messages import PackedBelief, PackedGrid, Solo, Truth, Used
from tests.wire import envelopes as messages

GRID = Grid((10, 10))
TEAMS = {"a": ["r1"], "b": ["r2"]}


def cells(masses: Mapping[tuple[int, int], float]) -> PackedBelief:
    """A belief with some mass in each of a few cells, exact on the wire."""
    p = np.zeros(GRID.shape, dtype="<f4")
    for index, mass in masses.items():
        p[index] = mass
    own = PackedGrid(shape=GRID.shape, cell=1.0, origin=(0.0, 0.0))
    return PackedBelief(grid=own, lo=(0, 0), box=GRID.shape, coding="f32", data=p.tobytes())


def at(x: int, y: int) -> PackedBelief:
    return cells({(x, y): 1.0})


def new_instant(
    positions: Mapping[str, tuple[float, float]],
    tick: int = 1,
    teams: Mapping[str, Sequence[str]] = TEAMS,
    velocities: Mapping[str, tuple[float, float]] | None = None,
    unnamed: Mapping[str, Sequence[str]] | None = None,
) -> Instant:
    shown = {robot: list(who) for robot, who in (unnamed or {}).items()}
    where = {"positions": dict(positions), "velocities": dict(velocities or {}), "unnamed": shown}
    truth = Truth.model_validate({"run": "x", "tick": tick, "time": tick / 5, **where})
    return Instant(truth, {sub_team: list(robots) for sub_team, robots in teams.items()})


def solo(instant: Instant, robot: str, beliefs: Mapping[str, PackedBelief]) -> None:
    instant.hear_message("", Solo(robot=robot, tick=instant.truth.tick, time=0.0, beliefs=dict(beliefs)), b"")


def consensus(
    instant: Instant,
    sub_team: str,
    level: str,
    subject: str,
    belief: PackedBelief,
    used: Sequence[Used] = (),
    **more: object,
) -> bytes:
    where = {"board": sub_team, "sub_team": sub_team, "level": level, **more}
    said = messages.consensus(belief, subject, tick=instant.truth.tick, used=list(used), **where)
    payload = encode(said)
    instant.hear_message(sub_team, said, payload)
    return payload


def both(
    instant: Instant, sub_team: str, subject: str, consensus_: PackedBelief, agreed: PackedBelief, **more: object
) -> None:
    """Both levels; `more` are fields of what is agreed."""
    consensus(instant, sub_team, "consensus", subject, consensus_)
    consensus(instant, sub_team, "agreed", subject, agreed, **more)


def referee(unnamed: Collection[str] = (), **check: object) -> Referee:
    return Referee(GRID, CheckSection.model_validate(check), ("r1", "r2"), unnamed=unnamed)
