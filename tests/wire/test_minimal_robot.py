"""The example robot: short, of nothing of ours, and what it says is understood."""

import ast
import sys
from pathlib import Path

import msgpack
import numpy as np
import pytest

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import PackedBelief, Report
from examples import minimal_robot
from tests.wire.beliefs import KINDS, belief_of
from tests.wire.messages import REPORT, as_map

GRID = Grid((6, 4))
SOURCE = Path(minimal_robot.__file__).read_text(encoding="utf-8")


def as_the_example_packs(belief: Belief) -> PackedBelief:
    grid = belief.grid
    fields = {"shape": grid.shape, "cell": grid.cell, "origin": grid.origin, "unit": grid.unit}
    report = as_map(REPORT) | {"belief": minimal_robot.pack(belief.p, fields)}
    return decode(Report, msgpack.packb(report)).belief


@pytest.mark.parametrize("kind", KINDS)
def test_what_it_packs_is_read_as_what_we_pack(kind: str) -> None:
    belief = belief_of(kind, GRID, np.random.default_rng(3))
    np.testing.assert_allclose(
        unpack(as_the_example_packs(belief), GRID).p, unpack(pack(belief), GRID).p, rtol=0.06, atol=1e-9
    )


def test_it_is_at_most_sixty_lines() -> None:
    assert len(SOURCE.splitlines()) <= 60


def test_it_uses_zenoh_numpy_and_msgpack_only() -> None:
    imports = [node for node in ast.walk(ast.parse(SOURCE)) if isinstance(node, ast.Import | ast.ImportFrom)]
    named = {alias.name for node in imports if isinstance(node, ast.Import) for alias in node.names}
    named |= {node.module or "." for node in imports if isinstance(node, ast.ImportFrom)}
    foreign = {name.split(".")[0] for name in named} - set(sys.stdlib_module_names)
    assert foreign == {"zenoh", "numpy", "msgpack"}
