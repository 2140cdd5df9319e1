"""The joint behind a board: each piece of evidence once, whoever passes it on, and a story for what it says."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import numpy as np
import pytest

from blackboard.board.joint.desk import MAX_ROBOTS, MAX_WAITING, JointDesk
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, entering
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import Forward, PackedEvidence, PackedRelative, pack_evidence
from blackboard.wire.messages import Consensus
from robot_agent.config import RobotSection
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import sensors_of
from tests.robot_agent.test_agent import readings

GRID = Grid((30, 30))
MAKE = partial(Consensus, board="board-a", sub_team="a", level="agreed", tick=0, time=0.0)


def desk(**settings: object) -> JointDesk:
    return JointDesk(GRID, BoardSection.model_validate({"fusion": "joint", **settings}))


def at(x: float, y: float, *, travelled: float = 0.0, sees: PackedRelative | None = None) -> PackedEvidence:
    """A robot that stands at a place, known to one cell, with its heading known to 0.05 rad."""
    state = entering(Moments(np.array([x, y, 0.0]), np.diag([1.0, 1.0, 0.0025])), Nuisance())
    evidence = pack_evidence(0, Motion(distance=travelled, along=0.01), Nuisance(), state, None, [])
    return evidence if sees is None else evidence.model_copy(update={"relatives": [sees]})


def sighting(subject: str, distance: float) -> PackedRelative:
    return PackedRelative(subject=subject, range=distance, bearing=0.0, range_variance=0.04, bearing_variance=0.0004)


def means(found: list[Consensus]) -> dict[str, tuple[float, float]]:
    return {c.subject: tuple(np.round(unpack(c.belief).mean(), 1)) for c in found}


def test_robots_enter_by_their_states_and_objects_by_their_sightings() -> None:
    it = desk()
    it.take("r1", 0, 0.0, at(10, 10, sees=sighting("object/ball", 5.0)), own=True)
    it.take("r2", 0, 0.0, at(20, 10), own=True)
    found = it.settle(0.0, MAKE)
    assert means(found) == {"object/ball": (15.0, 10.0), "robot/r1": (10.0, 10.0), "robot/r2": (20.0, 10.0)}
    ball, r1, _ = found
    assert [used.source for used in ball.used] == ["r1"]
    assert (ball.rule, ball.state, ball.conflict) == ("joint", None, False)
    assert r1.state is not None
    assert set(r1.ancestors) == {"r1", "r2"}


def test_the_same_evidence_counts_once_whoever_passes_it_on() -> None:
    plain, echoed = desk(), desk()
    for tick in range(4):
        evidence = at(10, 10, travelled=float(tick), sees=sighting("object/ball", 5.0))
        plain.take("r1", tick, 0.2 * tick, evidence, own=True)
        for _ in range(3):
            echoed.take("r1", tick, 0.2 * tick, evidence, own=True)
        forward = Forward(board="b", sub_team="b", tick=tick, time=0.2 * tick, evidence=plain.forward())
        echoed.hear(forward)
        assert echoed.has_heard(("b", "b"), tick)
        assert plain.settle(0.2 * tick, MAKE) == echoed.settle(0.2 * tick, MAKE)
    echoed.take("r1", 1, 0.8, at(3, 3), own=False)
    assert means(plain.settle(0.8, MAKE)) == means(echoed.settle(0.8, MAKE))


def test_what_arrives_late_is_settled_in_the_order_of_its_ticks() -> None:
    prompt, late = desk(), desk()
    for tick in range(3):
        evidence = at(10, 10, travelled=float(tick))
        prompt.take("r1", tick, 0.2 * tick, evidence, own=True)
        prompt.settle(0.2 * tick, MAKE)
        late.take("r1", tick, 0.2 * tick, evidence, own=True)
    assert means(late.settle(0.4, MAKE)) == means(prompt.settle(0.4, MAKE)) == {"robot/r1": (12.0, 10.0)}


def test_evidence_is_forwarded_once_and_only_that_of_the_own_robots() -> None:
    it = desk()
    it.take("r2", 0, 0.0, at(10, 10), own=True)
    it.take("r1", 0, 0.0, at(10, 10), own=True)
    it.take("r3", 0, 0.0, at(10, 10), own=False)
    assert [(one.robot, one.tick) for one in it.forward()] == [("r1", 0), ("r2", 0)]
    assert it.forward() == []


def test_a_silent_robot_is_believed_less_and_then_not_published() -> None:
    it = desk(max_age=3.0, drift=1.0)
    it.take("r1", 0, 0.0, at(10, 10), own=True)
    widths = [float(np.trace(unpack(it.settle(time, MAKE)[0].belief).covariance())) for time in (0.0, 1.0, 3.0)]
    assert np.diff(widths) == pytest.approx([2.0, 4.0], rel=0.05)
    assert it.settle(3.1, MAKE) == []
    it.take("r1", 9, 3.2, at(10, 10, travelled=1.0), own=True)
    assert means(it.settle(3.2, MAKE)) == {"robot/r1": (11.0, 10.0)}


def test_who_contradicts_the_joint_is_named_with_the_reason() -> None:
    it = desk()
    it.take("r1", 0, 0.0, at(10, 10, sees=sighting("robot/r2", 5.0)), own=True)
    it.take("r2", 0, 0.0, at(15, 10), own=True)
    it.settle(0.0, MAKE)
    it.take("r1", 1, 0.2, at(10, 10, sees=sighting("robot/r2", 15.0)), own=True)
    it.take("r2", 1, 0.2, at(15, 10), own=True)
    (consensus,) = (c for c in it.settle(0.2, MAKE) if c.subject == "robot/r2")
    assert consensus.conflict
    assert [(one.source, one.reason.split(":")[0]) for one in consensus.left_out] == [
        ("r1", "its relative contradicts the joint")
    ]


def test_what_is_kept_is_bounded() -> None:
    it = desk()
    for i in range(MAX_ROBOTS):
        it.take(f"r{i}", 0, 0.0, at(10, 10), own=False)
    with pytest.raises(Refused, match="too-many"):
        it.take("another", 0, 0.0, at(10, 10), own=False)
    for tick in range(1, MAX_WAITING + 5):
        it.take("r1", tick, 0.0, at(10, 10), own=True)
    assert it.dropped == 5
    assert len(it.forward()) == MAX_WAITING


def test_what_one_robot_may_put_into_the_joint_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    it = desk()
    monkeypatch.setattr("blackboard.board.joint.desk.MAX_OBJECTS", 6)
    for tick in range(16):
        it.take("r1", tick, 0.2 * tick, at(10, 10, sees=sighting(f"object/o{tick}", 5.0)), own=True)
        found = it.settle(0.2 * tick, MAKE)
    assert len([c for c in found if c.subject.startswith("object/")]) == 6
    assert (it.dropped, it.restarts) == (10, 0)
    monkeypatch.setattr("blackboard.board.joint.desk.MAX_STATES", 15)
    it.take("r1", 999, 20.0, at(10, 10), own=True)
    assert it.settle(20.0, MAKE) == []
    assert it.restarts == 1
    it.take("r1", 1000, 20.2, at(10, 10), own=True)
    assert means(it.settle(20.2, MAKE)) == {"robot/r1": (10.0, 10.0)}


def test_numbers_that_break_the_joint_make_it_begin_anew() -> None:
    it = desk()
    it.take("r1", 0, 0.0, at(10, 10), own=True)
    it.settle(0.0, MAKE)
    wild = at(10, 10, travelled=1e12)
    moved = wild.travelled.model_copy(update={"turn": 1e12, "along": 1e12, "across": 1e12, "heading": 1e12})
    it.take("r1", 1, 0.2, wild.model_copy(update={"travelled": moved, "state": None}), own=True)
    it.settle(0.2, MAKE)
    it.take("r1", 2, 0.4, wild, own=True)
    it.take("r2", 2, 0.4, at(20, 20), own=True)
    assert "robot/r2" in means(it.settle(0.4, MAKE))


def test_a_robot_with_one_joint_of_its_own_agrees_with_its_filter() -> None:
    """With one robot, what the increments make of the joint is what its own filter believes (but for linearisation)."""
    own, it = FirstHand("robot/r1", sensors_of(RobotSection())), desk()
    for tick in range(12):
        told = own.step(readings(tick, fix=(10, 10 + 0.1 * tick) if tick % 4 == 0 else None))
        nuisance = own.sensors.wheels.nuisance
        packed = pack_evidence(told.epoch, told.travelled, nuisance, told.belief, told.increment, told.relatives)
        it.take("r1", tick, 0.5 * tick, packed, own=True)
        it.settle(0.5 * tick, MAKE)
        assert own.belief is not None
        assert it.team.pose("robot/r1").mean == pytest.approx(own.belief.mean, abs=1e-3)
        assert it.team.pose("robot/r1").covariance == pytest.approx(own.belief.covariance, abs=2e-3)


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
    it.take("honest", 99, 20.0, at(20, 20), own=True)
    it.take("honest", 100, 20.2, at(20, 20), own=True)
    it.settle(20.0, MAKE)
    it.take("honest", 101, 20.4, at(20, 20), own=True)
    assert "robot/honest" in means(it.settle(20.4, MAKE))
