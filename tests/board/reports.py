"""Reports and boards for the tests of this room, on one small grid."""

from __future__ import annotations

from collections.abc import Mapping

from blackboard.board.board import Board
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack
from blackboard.wire.messages import Consensus, Informed, Report

GRID = Grid((40, 30))


def report(
    source: str,
    belief: Belief,
    *,
    subject: str = "object/ball",
    time: float = 0.0,
    tick: int = 0,
    informed: tuple[Belief, Mapping[str, float]] | None = None,
) -> Report:
    packed = None if informed is None else Informed(belief=pack(informed[0]), ancestors=dict(informed[1]))
    return Report(source=source, subject=subject, tick=tick, time=time, belief=pack(belief), informed=packed)


def at(x: float, y: float, sigma: float) -> Belief:
    return gaussian(GRID, (x, y), sigma)


def board(**settings: object) -> Board:
    return Board("a", "a", GRID, BoardSection.model_validate(settings))


def only(consensuses: list[Consensus]) -> Consensus:
    (consensus,) = consensuses
    return consensus
