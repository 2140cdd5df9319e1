"""Reports and boards for the tests of this room, on two grids."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from blackboard.board.board import Board
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, Report, UnnamedBelief

GRID = Grid((40, 30))

#: Whose cell is not 1 and whose origin is not 0: for exact expectations.
FINE = Grid((40, 30), 0.5, (2.0, -1.0), "m")


def report(
    source: str,
    belief: Belief,
    time: float = 0.0,
    *,
    subject: str = "object/ball",
    tick: int = 0,
    informed: tuple[Belief, Mapping[str, float]] | None = None,
) -> Report:
    packed = None if informed is None else Informed(belief=pack(informed[0]), ancestors=dict(informed[1]))
    return Report(source=source, subject=subject, tick=tick, time=time, belief=pack(belief), informed=packed)


def sees(source: str, own: Belief, things: Sequence[tuple[str, Belief]], tick: int) -> Report:
    """What a robot reports of itself where it sees things of some classes, in ticks of a second."""
    unnamed = [UnnamedBelief(kind=kind, belief=pack(belief), mark=mark) for mark, (kind, belief) in enumerate(things)]
    message = report(source, own, float(tick), subject=f"robot/{source}", tick=tick)
    return message.model_copy(update={"unnamed": unnamed})


def at(x: float, y: float, sigma: float) -> Belief:
    return gaussian(GRID, (x, y), sigma)


def fine(x: float, y: float, sigma: float) -> Belief:
    """On the fine grid, as it is read from the wire."""
    return unpack(pack(gaussian(FINE, (x, y), sigma)))


def new_board(sub_team: str = "a", *, grid: Grid = GRID, name: str | None = None, **settings: object) -> Board:
    return Board(sub_team, name or f"board-{sub_team}", grid, BoardSection.model_validate(settings))


def only(consensuses: list[Consensus]) -> Consensus:
    (consensus,) = consensuses
    return consensus


def same(consensus: Consensus, p: object, abs: float = 1e-12) -> None:
    """A consensus on the fine grid is this, as it is read from the wire."""
    assert unpack(consensus.belief).p == pytest.approx(unpack(pack(Belief(FINE, np.asarray(p)))).p, abs=abs)


def said_by(
    sub_team: str,
    belief: Belief,
    *,
    subject: str = "object/ball",
    name: str | None = None,
    time: float = 0.0,
    tick: int = 0,
) -> Consensus:
    """The consensus of one board on a subject, from one robot of its sub-team."""
    board = new_board(sub_team, grid=belief.grid, name=name)
    board.hear(report(f"robot-{sub_team}", belief, time, tick=tick, subject=subject), time)
    return only(board.settle(tick, time))
