"""The joint behind a board, and evidence for it: of robots that stand, and with numbers of all magnitudes."""

from collections import Counter
from collections.abc import Iterable
from functools import partial

import numpy as np

from blackboard.board.joint.desk import JointDesk
from blackboard.config import BoardSection
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, entering
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedEvidence, PackedRelative
from blackboard.wire.gaussians import pack_evidence
from blackboard.wire.messages import Consensus

GRID = Grid((30, 30))
MAKE = partial(Consensus, board="board-a", sub_team="a", level="agreed", tick=0, time=0.0)


def new_desk(**settings: object) -> JointDesk:
    chosen = BoardSection.model_validate({"fusion": "joint", **settings})
    return JointDesk(GRID, chosen, Counter(), Ageing(chosen.drift, GRID))


def at(x: float, y: float, *, travelled: float = 0.0, sees: PackedRelative | None = None) -> PackedEvidence:
    """A robot that stands at a place, known to one cell, with its heading known to 0.05 rad."""
    state = entering(Moments(np.array([x, y, 0.0]), np.diag([1.0, 1.0, 0.0025])), Nuisance())
    evidence = pack_evidence(Evidence("robot/r1", 0, 0, Motion(distance=travelled, along=0.01), Nuisance(), state))
    return evidence if sees is None else evidence.model_copy(update={"relatives": [sees]})


def sighting(subject: str, distance: float) -> PackedRelative:
    return PackedRelative(subject=subject, range=distance, bearing=0.0, range_variance=0.04, bearing_variance=0.0004)


def settled(desk: JointDesk, tick: int, **told: PackedEvidence) -> dict[str, Consensus]:
    """Give the desk the evidence of its robots for one tick (each is 0.2 s long) and settle it: the consensuses, by subject."""
    for robot, evidence in told.items():
        desk.take_evidence(robot, tick, 0.2 * tick, evidence, own=True)
    return {consensus.subject: consensus for consensus in desk.settle(0.2 * tick, MAKE)}


def means(consensuses: Iterable[Consensus]) -> dict[str, tuple[float, float]]:
    return {c.subject: tuple(np.round(unpack(c.belief).mean(), 1)) for c in consensuses}


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
        subject=str(rng.choice(["robot/r1", "robot/r2", "object/ball", "robot/?", "person/?"])),
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
