"""The referee: exact numbers on hand-made beliefs, the same samples for every level, and a hash without order."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import encode
from blackboard.wire.messages import Consensus, PackedBelief, PackedGrid, Solo, Status, Truth
from sim_world.referee import Instant, Referee
from sim_world.scenario import CheckSection

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


def instant(
    positions: Mapping[str, tuple[float, float]], tick: int = 1, teams: Mapping[str, Sequence[str]] = TEAMS
) -> Instant:
    truth = Truth(run="x", tick=tick, time=tick / 5, positions=dict(positions))
    return Instant(truth, {sub_team: list(robots) for sub_team, robots in teams.items()})


def solo(it: Instant, robot: str, beliefs: Mapping[str, PackedBelief]) -> None:
    it.hear("", Solo(robot=robot, tick=it.truth.tick, time=0.0, beliefs=dict(beliefs)), b"")


def consensus(it: Instant, sub_team: str, level: str, subject: str, belief: PackedBelief) -> bytes:
    said = Consensus(
        board=sub_team,
        sub_team=sub_team,
        level=level,  # type: ignore[arg-type]
        subject=subject,
        tick=it.truth.tick,
        time=0.0,
        belief=belief,
        ancestors={},
        used=[],
        entropy=0.0,
        conflict=False,
        rule="cooperative",
    )
    payload = encode(said)
    it.hear(sub_team, said, payload)
    return payload


def both(it: Instant, sub_team: str, subject: str, consensus_: PackedBelief, agreed: PackedBelief) -> None:
    consensus(it, sub_team, "consensus", subject, consensus_)
    consensus(it, sub_team, "agreed", subject, agreed)


def referee(**check: object) -> Referee:
    return Referee(GRID, CheckSection.model_validate(check), ("r1", "r2"))


def test_errors_entropies_log_scores_and_coverage_are_exact() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    quarter = cells({(2, 2): 0.25, (2, 4): 0.75})  # mean 1.5 cells away; the true cell is the lesser one
    solo(it, "r1", {"robot/r1": at(5, 6)})  # 3-4-5
    solo(it, "r2", {"robot/r2": at(5, 5)})
    both(it, "a", "robot/r1", quarter, at(2, 2))
    both(it, "b", "robot/r2", at(5, 8), at(5, 5))
    judge.hear(it, judged=True)
    robots = judge.scores()["robots"]
    assert robots["solo"]["n"] == robots["consensus"]["n"] == robots["agreed"]["n"] == 2
    assert robots["solo"]["rmse"] == pytest.approx(math.sqrt((5**2 + 0) / 2))
    assert robots["solo"]["max"] == pytest.approx(5)
    assert robots["consensus"]["rmse"] == pytest.approx(math.sqrt((1.5**2 + 3**2) / 2))
    assert robots["agreed"]["rmse"] == pytest.approx(0)
    assert robots["agreed"]["coverage"] == {"50": 1.0, "90": 1.0, "95": 1.0}
    mine = robots["by_name"]["r1"]["consensus"]
    assert mine["entropy"] == pytest.approx(-0.25 * math.log(0.25) - 0.75 * math.log(0.75))
    assert mine["log_score"] == pytest.approx(math.log(0.25))
    assert mine["coverage"] == {"50": 0.0, "90": 1.0, "95": 1.0}  # 0.75 is denser
    assert judge.scores()["objects"]["solo"]["n"] == 0


def test_an_object_is_judged_for_each_robot_that_believes_something_about_it() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5), "object/ball": (7.5, 7.5), "object/can": (1.5, 1.5)})
    solo(it, "r1", {"object/ball": at(7, 3)})
    solo(it, "r2", {"object/ball": at(7, 5)})
    both(it, "a", "object/ball", at(7, 4), at(7, 6))
    both(it, "b", "object/ball", at(7, 5), at(7, 6))
    judge.hear(it, judged=True)
    objects = judge.scores()["objects"]
    assert [objects[level]["n"] for level in ("solo", "consensus", "agreed")] == [2, 2, 2]
    assert objects["solo"]["rmse"] == pytest.approx(math.sqrt((4**2 + 2**2) / 2))
    assert objects["consensus"]["rmse"] == pytest.approx(math.sqrt((3**2 + 2**2) / 2))
    assert objects["agreed"]["rmse"] == pytest.approx(1)
    assert list(objects["by_name"]) == ["ball"]
    assert judge.missing()["object/can"] == {"agreed": 2, "consensus": 2, "solo": 2}


def test_levels_are_judged_on_the_same_samples() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    solo(it, "r1", {"robot/r1": at(2, 2)})
    both(it, "a", "robot/r1", at(2, 2), at(2, 2))
    solo(it, "r2", {"robot/r2": at(5, 5)})
    consensus(it, "b", "consensus", "robot/r2", at(5, 5))  # and nothing was agreed
    judge.hear(it, judged=True)
    assert list(judge.scores()["robots"]["by_name"]) == ["r1"]
    assert judge.missing() == {"robot/r2": {"agreed": 1}}


def test_who_is_not_there_or_without_truth_is_not_judged() -> None:
    judge = referee()
    it = instant({"robot/r2": (5.5, 5.5)}, teams={"a": ["r1"], "b": []})
    solo(it, "r1", {"robot/r1": at(2, 2)})
    both(it, "a", "robot/r1", at(2, 2), at(2, 2))
    judge.hear(it, judged=True)  # no truth about r1: a gap in the ground truth
    assert judge.scores()["robots"]["by_name"] == {}
    assert judge.missing() == {"robot/r2": {"solo": 1}}


def test_a_robot_in_two_sub_teams_is_judged_in_both() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"], "b": ["r1"]})
    solo(it, "r1", {"robot/r1": at(2, 4)})
    both(it, "a", "robot/r1", at(2, 3), at(2, 2))
    both(it, "b", "robot/r1", at(2, 5), at(2, 2))
    judge.hear(it, judged=True)
    robots = judge.scores()["robots"]
    assert robots["consensus"]["rmse"] == pytest.approx(math.sqrt((1 + 9) / 2))
    assert robots["solo"]["rmse"] == pytest.approx(2)


def test_ticks_that_are_not_judged_count_for_the_hash_only() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(it, "r1", {"robot/r1": at(2, 2)})
    both(it, "a", "robot/r1", at(2, 2), at(2, 2))
    empty = judge.hash
    judge.hear(it, judged=False)
    assert judge.scores()["robots"]["solo"]["n"] == 0
    assert judge.hash != empty


def test_a_belief_that_cannot_be_read_is_counted_and_missing() -> None:
    judge = referee()
    it = instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(it, "r1", {"robot/r1": at(2, 2)})
    both(it, "a", "robot/r1", pack(gaussian(Grid((8, 8)), (2, 2), 1)), at(2, 2))
    judge.hear(it, judged=True)
    assert judge.refused == {"grid": 1}
    assert judge.missing()["robot/r1"] == {"consensus": 1}


def test_beliefs_are_scored_as_they_are_on_the_wire() -> None:
    judge = Referee(GRID, CheckSection(), ("r1",))
    belief = gaussian(GRID, (3.3, 4.4), 1.7)
    it = instant({"robot/r1": (3.5, 4.5)}, teams={"a": ["r1"]})
    solo(it, "r1", {"robot/r1": pack(belief)})
    both(it, "a", "robot/r1", pack(belief), pack(belief))
    judge.hear(it, judged=True)
    read: Belief = unpack(pack(belief), GRID)
    found = judge.scores()["robots"]["agreed"]
    assert found["entropy"] == pytest.approx(entropy(read.p))
    assert found["rmse"] == pytest.approx(math.dist(read.mean(), (3.5, 4.5)))


def test_the_hash_knows_no_order_of_arrival() -> None:
    said = [
        (sub_team, level, subject)
        for sub_team in ("b", "a")
        for level in ("consensus", "agreed")
        for subject in ("robot/r1",)
    ]
    hashes = set()
    payloads: dict[tuple[str, str, str], bytes] = {}
    for order in itertools.permutations(said):
        judge = referee()
        it = instant({})
        for sub_team, level, subject in order:
            payloads[sub_team, level, subject] = consensus(
                it, sub_team, level, subject, at(len(sub_team + level) % 9, 3)
            )
        judge.hear(it, judged=True)
        hashes.add(judge.hash)
    expected = hashlib.sha256(b"".join(payloads[name] for name in sorted(payloads))).hexdigest()
    assert hashes == {expected}


def test_the_hash_is_sorted_by_tick_first() -> None:
    judge = referee()
    payloads = []
    for tick in (1, 2):
        it = instant({}, tick)
        payloads.append(consensus(it, "ba"[tick - 1], "agreed", "robot/r1", at(tick, tick)))
        judge.hear(it, judged=True)
    assert judge.hash == hashlib.sha256(b"".join(payloads)).hexdigest()


def test_a_tick_is_settled_once_everything_listed_is_in() -> None:
    it = instant({})
    for phase in ("agreed", "consensus"):
        assert not it.settled("a")
        it.hear("a", Status(process="a", kind="board", tick=1, time=0, phase=phase, subjects=["robot/r1"]), b"")
    assert not it.settled("a")
    consensus(it, "a", "agreed", "robot/r1", at(1, 1))
    assert not it.settled("a")
    consensus(it, "a", "consensus", "robot/r1", at(1, 1))
    assert it.settled("a")
    assert not it.settled("b")


def test_only_who_takes_part_is_listened_to() -> None:
    it = instant({})
    solo(it, "stranger", {"robot/r1": at(1, 1)})
    consensus(it, "c", "agreed", "robot/r1", at(1, 1))
    it.hear("c", Status(process="c", kind="board", tick=1, time=0, phase="agreed"), b"")
    assert (it.solos, it.consensuses, it.statuses) == ({}, {}, {})


# --- the verdict -----------------------------------------------------------------------------------------------------


def verdict(solo_: PackedBelief, agreed: PackedBelief, **check: object) -> tuple[bool, list[str]]:
    judge = Referee(GRID, CheckSection.model_validate(check), ("r1",))
    it = instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(it, "r1", {"robot/r1": solo_})
    both(it, "a", "robot/r1", solo_, agreed)
    judge.hear(it, judged=True)
    return judge.verdict(judge.scores())


WIDE = cells({(2, 2): 0.2, (2, 4): 0.8})  # 1.6 cells off, 0.5 nats
NEAR = cells({(2, 2): 0.9, (2, 3): 0.1})  # 0.1 cells off, 0.33 nats


def test_better_and_honest_is_a_pass() -> None:
    passed, reasons = verdict(WIDE, NEAR)
    assert passed
    assert reasons == [
        "robots: agreed rmse 0.100 cell, solo 1.600, asked 0.9 of it",
        "robots: agreed entropy 0.325 nats, solo 0.500, asked 1 of it",
        "robots: agreed 95 % regions hold the truth in 100.0 %, asked 80 %",
    ]


@pytest.mark.parametrize(
    ("solo_", "agreed", "check", "reason"),
    [
        (NEAR, WIDE, {"entropy": 9}, "robots: agreed rmse 1.600 cell, solo 0.100"),
        (WIDE, NEAR, {"robots": 0.05}, "robots: agreed rmse 0.100 cell, solo 1.600, asked 0.05 of it"),
        (NEAR, WIDE, {"robots": 99}, "robots: agreed entropy 0.500 nats, solo 0.325"),
        (WIDE, at(2, 3), {}, "robots: agreed 95 % regions hold the truth in 0.0 %, asked 80 %"),
    ],
)
def test_a_failed_check_is_the_reason(
    solo_: PackedBelief, agreed: PackedBelief, check: dict[str, Any], reason: str
) -> None:
    passed, reasons = verdict(solo_, agreed, **check)
    assert not passed
    assert len(reasons) == 1
    assert reasons[0].startswith(reason)


def test_a_robot_that_was_never_judged_is_a_reason() -> None:
    judge = referee()
    passed, reasons = judge.verdict(judge.scores())
    assert not passed
    assert reasons == ["r1 was never judged", "r2 was never judged"]


def test_objects_that_were_never_judged_are_a_reason() -> None:
    judge = Referee(GRID, CheckSection(), ("r1",))
    it = instant({"robot/r1": (2.5, 2.5), "object/ball": (4.5, 4.5)}, teams={"a": ["r1"]})
    solo(it, "r1", {"robot/r1": WIDE})
    both(it, "a", "robot/r1", WIDE, NEAR)
    judge.hear(it, judged=True)
    assert judge.verdict(judge.scores()) == (False, ["no object was ever judged"])
