"""Whatever numbers a member sends as evidence, the board goes on and its honest members are not shut out."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest

from blackboard.errors import Refused
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedEvidence, PackedRelative
from tests.board.joint.test_desk import GRID, MAKE, at, desk, means


def wild(rng: np.random.Generator, size: int | None = None) -> np.ndarray:
    """Numbers of all magnitudes that a message may hold, zeros among them."""
    values = rng.choice([-1.0, 1.0], size) * 10.0 ** rng.uniform(-12, 11, size)
    return np.asarray(np.where(rng.random(size) < 0.2, 0.0, values))


def absurd(rng: np.random.Generator) -> PackedEvidence:
    """Evidence that is a message, and otherwise anything."""
    root = wild(rng, 81).reshape(9, 9) * 1e-6
    matrix = tuple(float(v) for v in (root @ root.T)[np.triu_indices(9)])
    vector = tuple(float(v) for v in wild(rng, 9))
    positive = [abs(float(v)) for v in wild(rng, 12)]
    relative = PackedRelative(
        subject=str(rng.choice(["robot/r1", "robot/r2", "object/ball"])),
        range=positive[0],
        bearing=float(wild(rng)),
        range_variance=positive[1],
        bearing_variance=positive[2],
        age=positive[3],
        biases=[(positive[4], positive[5] + 1e-9)],
    )
    motion = {name: abs(float(wild(rng))) for name in ("time", "moving", "along", "across", "heading")}
    return PackedEvidence.model_validate(
        {
            "epoch": int(rng.integers(3)),
            "travelled": {"distance": float(wild(rng)), "turn": float(wild(rng)), **motion},
            "nuisance": {
                "forward": float(wild(rng)),
                "turn": float(wild(rng)),
                "sigmas": tuple(positive[:6]),
                "walks": tuple(positive[6:9]),
                "memory": tuple(positive[9:12]),
            },
            "state": {"mean": vector, "covariance": matrix} if rng.random() < 0.7 else None,
            "increment": {"reference": vector, "information": matrix, "vector": vector} if rng.random() < 0.7 else None,
            "relatives": [relative],
            "profile": [(0.0, positive[0]), (5.0, positive[1])] if rng.random() < 0.3 else [],
        }
    )


@pytest.mark.parametrize("seed", range(20))
def test_whatever_evidence_arrives_the_desk_goes_on(seed: int) -> None:
    rng, it = np.random.default_rng(seed), desk()
    for tick in range(15):
        for robot in ("r1", "r2"):
            with suppress(Refused):
                it.take(robot, tick, 0.2 * tick, absurd(rng), own=True)
        for consensus in it.settle(0.2 * tick, MAKE):
            assert unpack(consensus.belief, GRID).p.sum() == pytest.approx(1.0)
    assert it.counters["failed"] == 0, "what a robot says is no fault of ours"
    it.take("honest", 99, 20.0, at(20, 20), own=True)
    it.take("honest", 100, 20.2, at(20, 20), own=True)
    it.settle(20.0, MAKE)
    it.take("honest", 101, 20.4, at(20, 20), own=True)
    assert "robot/honest" in means(it.settle(20.4, MAKE))
