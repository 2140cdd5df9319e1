"""Who looks at a team knows in which frame its grid is and where on Earth that is; a grid that is none breaks nothing."""

import pytest

from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Anchor, Grid
from blackboard.state.fold import Fold
from blackboard.view.frame import frame
from blackboard.wire.arrays import pack, packed_grid
from blackboard.wire.messages import PackedAnchor, PackedGrid, Status
from blackboard.wire.types import Message
from tests.view.recorded import read
from tests.wire.envelopes import put
from tests.wire.messages import CONSENSUS

GRID = Grid((9, 7), 0.5, (1.0, -2.0), "m", "map")


def folded(*messages: Message) -> Fold:
    fold = Fold()
    for message in messages:
        fold.hear_envelope(put(message), 1.0)
    return fold


def status(grid: PackedGrid) -> Status:
    anchor = PackedAnchor(latitude=59.3, longitude=18.1, bearing=90.0)
    return Status(process="a1", kind="board", tick=3, time=0.6, phase="agreed", grid=grid, anchor=anchor)


def test_the_frame_and_the_anchor_reach_the_page() -> None:
    belief = CONSENSUS.model_copy(update={"level": "agreed", "belief": pack(uniform(GRID))})
    fold = folded(status(packed_grid(GRID)), belief)
    team = fold.teams["t"]
    assert team.grid == GRID
    assert team.grid.anchor == Anchor(59.3, 18.1, 90.0)
    header, _ = read(frame(team, team.moments.newest, 1, 2.0))
    assert header["grid"]["frame"] == "map"
    assert header["grid"]["anchor"] == {"latitude": 59.3, "longitude": 18.1, "bearing": 90.0}


@pytest.mark.parametrize("shape", [(9, 7, 2), (1 << 20, 1 << 20)])
def test_a_grid_that_is_none_is_refused(shape: tuple[int, ...]) -> None:
    wrong = packed_grid(GRID).model_copy(update={"shape": shape})
    belief = pack(uniform(GRID)).model_copy(update={"grid": wrong})
    consensus = CONSENSUS.model_copy(update={"level": "agreed", "belief": belief})
    fold = folded(status(wrong), consensus)
    assert fold.refused == {"fields": 2}
    assert fold.teams["t"].grid is None
