"""The referee: exact numbers on hand-made beliefs, the same samples for every level, and a hash without order."""

import hashlib
import itertools
import math

import pytest

from blackboard.config.world import CheckSection
from blackboard.judge.referee import Referee
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from tests.judge.instants import GRID, at, both, cells, consensus, new_instant, referee, solo


def test_errors_entropies_log_scores_and_coverage_are_exact() -> None:
    judge = referee()
    instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    quarter = cells({(2, 2): 0.25, (2, 4): 0.75})  # mean 1.5 cells away; the true cell is the lesser one
    solo(instant, "r1", {"robot/r1": at(5, 6)})  # 3-4-5
    solo(instant, "r2", {"robot/r2": at(5, 5)})
    both(instant, "a", "robot/r1", quarter, at(2, 2))
    both(instant, "b", "robot/r2", at(5, 8), at(5, 5))
    judge.judge_instant(instant, judged=True)
    robots = judge.scores()["robots"]
    assert robots["solo"]["n"] == robots["consensus"]["n"] == robots["agreed"]["n"] == 2
    assert robots["solo"]["rmse"] == pytest.approx(math.sqrt((5**2 + 0) / 2))
    assert robots["solo"]["max"] == pytest.approx(5)
    assert robots["consensus"]["rmse"] == pytest.approx(math.sqrt((1.5**2 + 3**2) / 2))
    assert robots["agreed"]["rmse"] == pytest.approx(0)
    assert robots["agreed"]["coverage"] == {"50": 0.5, "90": 0.9, "95": 0.95}  # what one cell claims of its one cell
    mine = robots["by_name"]["r1"]["consensus"]
    assert mine["entropy"] == pytest.approx(-0.25 * math.log(0.25) - 0.75 * math.log(0.75))
    assert mine["log_score"] == pytest.approx(math.log(0.25))
    # 0.15 and 0.2 of the 0.25
    assert mine["coverage"] == {"50": 0.0, "90": pytest.approx(0.6), "95": pytest.approx(0.8)}
    assert judge.scores()["objects"]["solo"]["n"] == 0


def test_an_object_is_judged_for_each_robot_that_believes_something_about_it() -> None:
    judge = referee()
    instant = new_instant(
        {"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5), "object/ball": (7.5, 7.5), "object/can": (1.5, 1.5)}
    )
    solo(instant, "r1", {"object/ball": at(7, 3)})
    solo(instant, "r2", {"object/ball": at(7, 5)})
    both(instant, "a", "object/ball", at(7, 4), at(7, 6))
    both(instant, "b", "object/ball", at(7, 5), at(7, 6))
    judge.judge_instant(instant, judged=True)
    objects = judge.scores()["objects"]
    assert [objects[level]["n"] for level in ("solo", "consensus", "agreed")] == [2, 2, 2]
    assert objects["solo"]["rmse"] == pytest.approx(math.sqrt((4**2 + 2**2) / 2))
    assert objects["consensus"]["rmse"] == pytest.approx(math.sqrt((3**2 + 2**2) / 2))
    assert objects["agreed"]["rmse"] == pytest.approx(1)
    assert list(objects["by_name"]) == ["ball"]
    assert judge.missing()["object/can"] == {"agreed": 2, "consensus": 2, "solo": 2}


def test_levels_are_judged_on_the_same_samples() -> None:
    judge = referee()
    instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    solo(instant, "r1", {"robot/r1": at(2, 2)})
    both(instant, "a", "robot/r1", at(2, 2), at(2, 2))
    solo(instant, "r2", {"robot/r2": at(5, 5)})
    consensus(instant, "b", "consensus", "robot/r2", at(5, 5))  # and nothing was agreed
    judge.judge_instant(instant, judged=True)
    assert list(judge.scores()["robots"]["by_name"]) == ["r1"]
    assert judge.missing() == {"robot/r2": {"agreed": 1}}


def test_who_is_not_there_or_without_truth_is_not_judged() -> None:
    judge = referee()
    instant = new_instant({"robot/r2": (5.5, 5.5)}, teams={"a": ["r1"], "b": []})
    solo(instant, "r1", {"robot/r1": at(2, 2)})
    both(instant, "a", "robot/r1", at(2, 2), at(2, 2))
    judge.judge_instant(instant, judged=True)  # no truth about r1: a gap in the ground truth
    assert judge.scores()["robots"]["by_name"] == {}
    assert judge.missing() == {"robot/r2": {"solo": 1}}


def test_a_robot_in_two_sub_teams_is_judged_once_in_the_first_by_name() -> None:
    judge = referee()
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"b": ["r1"], "a": ["r1"]})
    solo(instant, "r1", {"robot/r1": at(2, 4)})
    both(instant, "a", "robot/r1", at(2, 3), at(2, 2))
    both(instant, "b", "robot/r1", at(2, 5), at(2, 2))
    judge.judge_instant(instant, judged=True)
    robots = judge.scores()["robots"]
    assert robots["consensus"]["n"] == 1
    assert robots["consensus"]["rmse"] == pytest.approx(1)
    assert robots["solo"]["rmse"] == pytest.approx(2)


def test_ticks_that_are_not_judged_count_for_the_hash_only() -> None:
    judge = referee()
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": at(2, 2)})
    both(instant, "a", "robot/r1", at(2, 2), at(2, 2))
    empty = judge.hash
    judge.judge_instant(instant, judged=False)
    assert judge.scores()["robots"]["solo"]["n"] == 0
    assert judge.hash != empty


def test_a_belief_that_cannot_be_read_is_counted_and_missing() -> None:
    judge, unreadable = referee(), [pack(gaussian(Grid((8, 8)), (2, 2), sigma)) for sigma in (1, 2)]
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": unreadable[0]})
    both(instant, "a", "robot/r1", unreadable[1], at(2, 2))
    judge.judge_instant(instant, judged=True)
    assert judge.judgement().refused == {"grid": 2}
    assert judge.judgement().missing["robot/r1"] == {"consensus": 1, "solo": 1}


def test_beliefs_are_scored_as_they_are_on_the_wire() -> None:
    judge = Referee(GRID, CheckSection(), ("r1",))
    belief = gaussian(GRID, (3.3, 4.4), 1.7)
    instant = new_instant({"robot/r1": (3.5, 4.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": pack(belief)})
    both(instant, "a", "robot/r1", pack(belief), pack(belief))
    judge.judge_instant(instant, judged=True)
    read: Belief = unpack(pack(belief), GRID)
    score = judge.scores()["robots"]["agreed"]
    assert score["entropy"] == pytest.approx(entropy(read.p))
    assert score["rmse"] == pytest.approx(math.dist(read.mean(), (3.5, 4.5)))


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
        instant = new_instant({})
        for sub_team, level, subject in order:
            payloads[sub_team, level, subject] = consensus(
                instant, sub_team, level, subject, at(len(sub_team + level) % 9, 3)
            )
        judge.judge_instant(instant, judged=True)
        hashes.add(judge.hash)
    expected = hashlib.sha256(b"".join(payloads[name] for name in sorted(payloads))).hexdigest()
    assert hashes == {expected}


def test_the_hash_is_sorted_by_tick_first() -> None:
    judge = referee()
    payloads = []
    for tick in (1, 2):
        instant = new_instant({}, tick)
        payloads.append(consensus(instant, "ba"[tick - 1], "agreed", "robot/r1", at(tick, tick)))
        judge.judge_instant(instant, judged=True)
    assert judge.hash == hashlib.sha256(b"".join(payloads)).hexdigest()


def test_the_judgement_is_all_of_it() -> None:
    judge = referee(coverage=0.0)
    instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    for robot, sub_team, place in (("r1", "a", (2, 2)), ("r2", "b", (5, 5))):
        solo(instant, robot, {f"robot/{robot}": at(place[0] + 2, place[1])})
        both(instant, sub_team, f"robot/{robot}", at(*place), at(*place))
    judge.judge_instant(instant, judged=True)
    judgement = judge.judgement()
    assert (judgement.passed, judgement.reasons) == judge.verdict()
    assert judgement.passed
    assert (judgement.scores, judgement.missing, judgement.hash) == (judge.scores(), judge.missing(), judge.hash)
    assert (judgement.unit, judgement.refused) == ("cell", {})


def test_a_robot_of_the_scenario_that_is_absent_is_missing_in_every_judged_tick() -> None:
    judge = referee()
    for tick in (1, 2):
        judge.judge_instant(new_instant({"robot/r1": (2.5, 2.5)}, tick, teams={"a": ["r1"]}), judged=True)
    judge.judge_instant(new_instant({}, 3, teams={"a": ["r1"]}), judged=False)
    assert judge.missing()["robot/r2"] == {"solo": 2}


def test_scores_of_several_ticks_and_robots_are_one_sample_each() -> None:
    judge = referee()
    for tick, off in ((1, 1), (2, 3)):
        instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (2.5, 5.5)}, tick)
        for robot, sub_team, y in (("r1", "a", 2), ("r2", "b", 5)):
            solo(instant, robot, {f"robot/{robot}": at(2, y)})
            both(instant, sub_team, f"robot/{robot}", at(2 + off, y), at(2, y))
        judge.judge_instant(instant, judged=True)
    robots = judge.scores()["robots"]
    assert robots["consensus"]["n"] == 4
    assert robots["consensus"]["rmse"] == pytest.approx(math.sqrt(5))
    assert robots["by_name"]["r2"]["consensus"]["n"] == 2
    assert robots["by_name"]["r2"]["consensus"]["mean"] == pytest.approx(2)
