"""What a PASS means: few samples missing, robots that know how far they err, and regions that hold the truth as often as they claim."""

import numpy as np
import pytest

from blackboard.config.world import CheckSection
from blackboard.judge.calibration import BLOCK, CONSISTENT, FEWEST, Calibration, claimed_error, kind
from blackboard.judge.instant import Instant
from blackboard.judge.intervals import Estimate
from blackboard.judge.referee import Referee
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score
from blackboard.wire.arrays import pack
from tests.holdings import holdings
from tests.judge.instants import at, both, cells, new_instant, solo
from tests.present import present

GRID = Grid((40, 40))
CALM = {"robots": 9.0, "entropy": 9.0, "coverage": 0.0}  # the other checks


# --- missing samples --------------------------------------------------------------------------------------------------


def reported(instant: Instant, robot: str, sub_team: str) -> None:
    solo(instant, robot, {f"robot/{robot}": cells({(2, 2): 0.5, (2, 4): 0.5})})
    both(instant, sub_team, f"robot/{robot}", at(2, 2), at(2, 2))


def played(board_dies: int, *, back: int = 999, faulty: tuple[str, ...] = ()) -> tuple[bool, list[str]]:
    """r1 and its board are there all the time; the board of r2 dies at a tick, and the world leaves out its sub-team."""
    judge = Referee(
        Grid((10, 10)), CheckSection.model_validate(CALM | {"calibration": 1.0}), ("r1", "r2"), faulty=faulty
    )
    for tick in range(1, 151):
        there = tick < board_dies or tick >= back
        teams = {"a": ["r1"], **({"b": ["r2"]} if there else {})}
        instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (2.5, 2.5)}, tick, teams)
        reported(instant, "r1", "a")
        if there:
            reported(instant, "r2", "b")
        judge.judge_instant(instant, judged=True)
    return judge.verdict()


@pytest.mark.parametrize(
    ("tick", "reasons"),
    [
        (
            41,
            [
                "robot/r2: 73.3 % of its samples are missing (solo 110), at most 20 %",
                "robot/r2: missing from 8.2 s to the end at 30 s",
            ],
        ),
        (121, ["robot/r2: missing from 24.2 s to the end at 30 s"]),
    ],
)
def test_a_board_that_dies_and_never_comes_back_is_a_fail(tick: int, reasons: list[str]) -> None:
    assert played(tick) == (False, reasons)


def test_a_board_that_comes_back_or_is_away_at_the_very_end_or_under_a_fault_is_a_pass() -> None:
    assert played(41, back=65)[0]
    assert played(130)[0]
    assert played(41, faulty=("r2",))[0]


def test_a_guest_that_has_left_owes_nothing_any_more() -> None:
    """Robot r3 is in no scenario; as it leaves, the last belief about it is missing."""
    judge = Referee(Grid((10, 10)), CheckSection.model_validate(CALM | {"calibration": 1.0}), ("r1",))
    for tick in range(1, 150):
        instant = new_instant(
            {"robot/r1": (2.5, 2.5), "robot/r3": (2.5, 2.5)}, tick, {"a": ["r1", "r3"] if tick <= 80 else ["r1"]}
        )
        reported(instant, "r1", "a")
        if tick < 80:
            reported(instant, "r3", "a")
        judge.judge_instant(instant, judged=True)
    assert judge.verdict()[0]


def test_an_object_that_robots_see_and_the_team_does_not_know_is_missing_and_one_that_nobody_sees_is_not() -> None:
    judge = Referee(Grid((10, 10)), CheckSection.model_validate(CALM), ("r1",))
    for tick in range(1, 11):
        instant = new_instant(
            {"robot/r1": (2.5, 2.5), "object/ball": (4.5, 4.5), "object/can": (1.5, 1.5)}, tick, {"a": ["r1"]}
        )
        reported(instant, "r1", "a")
        if tick > 1:
            solo(instant, "r1", {"robot/r1": at(2, 2), "object/ball": at(4, 4)})
        if tick < 7:
            both(instant, "a", "object/ball", at(4, 4), at(4, 4))
        judge.judge_instant(instant, judged=True)
    passed, reasons = judge.verdict()
    assert not passed
    assert reasons == ["object/ball: 44.4 % of its samples are missing (agreed 4, consensus 4, solo 1), at most 20 %"]


# --- what beliefs claim -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.5, 1.0, 3.0])
def test_a_gaussian_claims_its_own_sigma_also_above_a_floor(sigma: float) -> None:
    belief = gaussian(GRID, (20.3, 19.8), sigma)
    floored = Belief(GRID, 0.99 * belief.p + 0.01 / GRID.size)
    expected = 2 * sigma**2 + 2 / 12
    assert claimed_error(belief) == pytest.approx(expected, rel=0.15)
    assert claimed_error(floored) == pytest.approx(expected, rel=0.15)


def judged(error: float, claimed: float, blocks: int, *, seed: int = 1, correlated: bool = False) -> Calibration:
    """Samples of robots that err with a sigma and claim another, five a second; correlated: one error in each block."""
    rng, calibration = np.random.default_rng(seed), Calibration()
    for block in range(blocks):
        off = rng.normal(0, error, 2)
        for second in range(int(BLOCK)):
            off = off if correlated else rng.normal(0, error, 2)
            truth = rng.uniform(19.0, 21.0, 2)
            belief = gaussian(GRID, (truth + off).tolist(), claimed)
            score = Score()
            score.add(belief, truth.tolist())
            calibration.add(block * BLOCK + second + 1, score, claimed_error(belief))
    return calibration


def width(share: Estimate) -> float:
    return present(share.high) - present(share.low)


def test_who_errs_far_more_than_it_claims_is_found_out_and_who_claims_right_is_not() -> None:
    assert judged(3.0, 1.0, 10).is_far_above_its_claim(2.0)
    assert not judged(1.0, 1.0, 10).is_far_above_its_claim(2.0)
    assert not judged(1.0, 3.0, 10).is_far_above_its_claim(2.0)


def test_of_few_blocks_nothing_is_concluded() -> None:
    few = judged(4.0, 1.0, FEWEST - 1)
    assert not few.is_far_above_its_claim(2.0)
    assert few.coverage() == {}


@pytest.mark.parametrize(("error", "claimed", "off"), [(2.0, 2.0, False), (2.0, 1.2, True), (2.0, 4.0, True)])
def test_coverage_is_judged_to_both_sides(error: float, claimed: float, off: bool) -> None:
    coverage = judged(error, claimed, 20).coverage()
    assert (
        any(at.is_above(level / 100 + 0.05) or at.is_below(level / 100 - 0.05) for level, at in coverage.items()) == off
    )


def test_sharp_beliefs_that_are_right_hold_the_truth_as_often_as_the_level_says() -> None:
    half = judged(0.7, 0.7, 30).coverage()[50]
    assert half.value == pytest.approx(0.5, abs=0.06)
    assert kind(50, half) == CONSISTENT


def test_samples_that_share_their_errors_make_a_wide_interval() -> None:
    alone, together = judged(2.0, 2.0, 60).coverage()[50], judged(2.0, 2.0, 60, correlated=True).coverage()[50]
    assert width(together) > 2 * width(alone)


# --- the verdict ------------------------------------------------------------------------------------------------------


def run(solo_sigma: float, agreed_sigma: float, error: float = 2.0, **check: float) -> list[str]:
    judge = Referee(GRID, CheckSection.model_validate(CALM | check), ("r1",))
    rng = np.random.default_rng(3)
    for tick in range(5, 301, 5):
        instant = new_instant({"robot/r1": (20.5, 20.5)}, tick, {"a": ["r1"]})
        x, y = (float(c) for c in 20.5 + rng.normal(0, error, 2))
        solo(instant, "r1", {"robot/r1": pack(gaussian(GRID, (x, y), solo_sigma))})
        agreed = pack(gaussian(GRID, (x, y), agreed_sigma))
        both(instant, "a", "robot/r1", agreed, agreed)
        judge.judge_instant(instant, judged=True)
    passed, reasons = judge.verdict()
    return [] if passed else reasons


def test_the_verdict_says_who_errs_more_than_it_claims() -> None:
    assert run(2.0, 2.0) == []
    reasons = run(0.6, 2.0)
    assert [reason.split(" rmse")[0] for reason in reasons] == ["robots: solo", "robot/r1: solo"]
    assert all("asked 2 of it" in reason for reason in reasons)


def test_the_verdict_says_which_regions_do_not_hold_what_they_claim() -> None:
    wide = run(2.0, 5.0)
    assert len(wide) == 1
    assert wide[0].startswith("robots: agreed 50 % regions hold the truth in")
    assert wide[0].endswith("misses the 30 to 70 asked")
    narrow = run(2.0, 0.8)
    assert {reason.split(" ")[2] for reason in narrow} == {"50", "90", "95"}
    assert run(2.0, 5.0, calibration=0.5) == []


def test_robots_that_lost_themselves_are_a_fail_though_they_say_so() -> None:
    assert run(4.0, 4.0, error=4.0, solo=4.0)[0].startswith("robots: solo rmse 6")
    assert run(2.0, 2.0, solo=4.0) == []


def test_of_a_run_of_hours_neighbouring_blocks_become_one_and_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    long = judged(1.0, 1.0, 12)
    monkeypatch.setattr("blackboard.judge.calibration.MOST", 5)
    bounded = judged(1.0, 1.0, 12)
    assert holdings(bounded, "it").total() == holdings(long, "it").total() / 4
    assert bounded.rmse() == pytest.approx(long.rmse(), rel=1e-12)
    shares, of_all = ([at.value for at in some.coverage().values()] for some in (bounded, long))
    assert shares == pytest.approx(of_all, rel=1e-12)
    together = Calibration.merged([long, bounded])
    assert holdings(together, "it") == holdings(bounded, "it")
    assert together.rmse() == pytest.approx(long.rmse(), rel=1e-12)
