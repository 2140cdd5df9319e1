"""How a belief is drawn: the box of bytes, the region, and the frame that carries them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import hdr_level, region_area
from blackboard.state.received import DEPTH, STEP, draw
from blackboard.view.frame import frame
from tests.present import present
from tests.view.recorded import read, team_of

GRID = Grid((7, 5), 0.5, (1.0, -2.0))
BELIEFS = arrays(np.float64, GRID.shape, elements=st.floats(0, 1) | st.floats(0, 1e-6)).filter(lambda p: p.sum() > 1e-3)


@given(BELIEFS)
def test_the_levels_are_the_logarithms_and_the_region_is_that_of_the_scores(p: np.ndarray) -> None:
    belief = Belief(GRID, p / p.sum())
    drawing = draw(belief)
    box = np.frombuffer(drawing.levels, np.uint8).reshape(drawing.box)
    levels = np.zeros(GRID.shape, np.uint8)
    levels[drawing.lo[0] : drawing.lo[0] + drawing.box[0], drawing.lo[1] : drawing.lo[1] + drawing.box[1]] = box
    drawn = levels > 0
    below = np.log(belief.p[drawn] / belief.p.max())
    assert np.abs(below - (levels[drawn].astype(float) - 255) * STEP).max() <= STEP / 2 + 1e-9
    assert (belief.p[~drawn] <= drawing.peak * math.exp(-DEPTH + STEP)).all()
    assert drawing.area == pytest.approx(region_area(belief, 0.95))


@given(BELIEFS, st.tuples(st.integers(0, 6), st.integers(0, 4)))
def test_a_cell_beyond_the_edge_is_in_the_region(p: np.ndarray, cell: tuple[int, int]) -> None:
    belief = Belief(GRID, p / p.sum())
    drawn = draw(belief)
    if belief.p[cell] > 0 and abs(hdr_level(belief.p, cell) - 0.95) > 1e-9:
        level = 255 + math.log(belief.p[cell] / drawn.peak) / STEP
        assert (level >= drawn.edge - 1e-6) == (hdr_level(belief.p, cell) < 0.95)


def test_a_sharp_and_a_flat_belief_are_drawn() -> None:
    sharp = draw(gaussian(GRID, (2.2, -1.2), 1e-3))
    assert (sharp.box, sharp.levels) == ((1, 1), b"\xff")
    flat = draw(uniform(GRID))
    assert flat.box == GRID.shape
    assert set(flat.levels) == {255}


def test_a_frame_carries_every_belief_of_the_moment() -> None:
    team = team_of()
    moment = present(team.moments.newest)
    header, cells = read(frame(team, moment, 7, 12.0))
    assert (header["frame"], header["tick"], header["grid"]["shape"]) == (7, moment.tick, [24, 24])
    begin = 0
    for name, about in moment.subjects.items():
        beliefs = header["subjects"][name]["beliefs"]
        assert [belief["kind"] for belief in beliefs].count("consensus") == len(about.consensus)
        assert [belief["who"] for belief in beliefs if belief["kind"] == "firsthand"] == sorted(about.reports)
        for belief in beliefs:
            size = belief["box"][0] * belief["box"][1]
            levels = cells[begin : begin + size]
            assert max(levels) == 255
            begin += size
        agreed = next(belief for belief in beliefs if belief["kind"] == "agreed")
        assert agreed["mean"] == pytest.approx(present(present(about.best).drawn).mean, rel=1e-4)
    assert begin == len(cells)
    assert [process["name"] for process in header["processes"]] == ["world", "board-a", "board-b", "r1", "r2", "r3"]
