"""The contest of rules: what it counts, what it marks, and what the default must show."""

from __future__ import annotations

import math

import numpy as np
import pytest

from blackboard.lab import contest
from blackboard.lab.cases import GRID, LIAR_SIGMA, LIE, TRIALS, Case
from blackboard.lab.tally import COLUMNS, Tally, difference, estimates, means, wilson
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import POOLS, fuse
from blackboard.opinion.scores import Score


def drawn(trial: str, runs: int, seed: int = 1) -> list[Case]:
    return [TRIALS[trial](stream) for stream in np.random.default_rng(seed).spawn(runs)]


def judged(trial: str, runs: int, names: list[str], seed: int = 1) -> dict[str, Tally]:
    rules = {name: contest.CONTENDERS[name] for name in names}
    return contest.judge([(i, [case]) for i, case in enumerate(drawn(trial, runs, seed))], rules, lambda: 0.0)


# --- the trials ------------------------------------------------------------------------------------------------------


def off(case: Case, source: int) -> float:
    return math.dist(Belief(case.grid, case.opinions[source]).mean(), case.truth)


@pytest.mark.parametrize("trial", TRIALS)
def test_a_trial_is_five_opinions_and_the_truth(trial: str) -> None:
    one, again = drawn(trial, 2), drawn(trial, 2)
    assert all(np.array_equal(a.opinions, b.opinions) and a.truth == b.truth for a, b in zip(one, again, strict=True))
    assert one[0].opinions.shape == (5, *GRID.shape)
    assert one[0].opinions.sum(axis=(1, 2)) == pytest.approx(1.0)
    assert GRID.index(one[0].truth) is not None
    assert not np.array_equal(one[0].opinions, one[1].opinions)


@pytest.mark.parametrize("trial", ["independent", "correlated"])
def test_honest_sources_are_each_as_good_as_they_say(trial: str) -> None:
    score = Score()
    for case in drawn(trial, 200, seed=3):
        for p in case.opinions:
            score.add(Belief(case.grid, p), case.truth)
    assert score.summary()["coverage"]["90"] == pytest.approx(0.9, abs=0.04)
    assert score.summary()["coverage"]["50"] == pytest.approx(0.5, abs=0.08)


def test_correlated_sources_err_together() -> None:
    def agreement(trial: str) -> float:
        errors = [[Belief(c.grid, p).mean()[0] - c.truth[0] for p in c.opinions[:2]] for c in drawn(trial, 200)]
        return float(np.corrcoef(np.array(errors).T)[0, 1])

    assert abs(agreement("independent")) < 0.25
    assert agreement("correlated") > 0.55


def test_liars_and_echoes_are_what_they_are_called() -> None:
    echoed = drawn("echoes", 1)[0]
    assert all(np.array_equal(echoed.opinions[0], p) for p in echoed.opinions[1:4])
    assert not np.array_equal(echoed.opinions[0], echoed.opinions[4])
    assert echoed.common is not None
    assert len(echoed.common) == 3
    for trial, liars in (("one liar", 1), ("two collude", 2)):
        case = drawn(trial, 1)[0]
        assert [off(case, i) for i in range(liars)] == pytest.approx([LIE] * liars, abs=0.3)
        sharp = Belief(GRID, case.opinions[0]).covariance()[0, 0]
        assert sharp == pytest.approx(LIAR_SIGMA**2, rel=0.1)
    assert np.array_equal(case.opinions[0], case.opinions[1])


def test_a_case_of_some_sources() -> None:
    case = drawn("independent", 1)[0]
    part = case.of(["s4", "s2", "nobody"])
    assert part.sources == ("s2", "s4")
    assert np.array_equal(part.opinions, case.opinions[[1, 3]])


# --- the tally -------------------------------------------------------------------------------------------------------


def test_wilsons_interval_is_right_at_its_ends() -> None:
    """10 of 10: 0.7225 to 1; 5 of 10: 0.2366 to 0.7634 (Wilson 1927, as R's prop.test without correction prints them)."""
    assert (wilson(1.0, 10).low, wilson(1.0, 10).high) == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert (wilson(0.5, 10).low, wilson(0.5, 10).high) == pytest.approx((0.2366, 0.7634), abs=1e-4)


def tally(errors: Array, runs: list[int]) -> Tally:
    n = len(errors)
    score = Score(errors.tolist(), [1.0] * n, (-errors).tolist(), [0.97 if i % 4 == 0 else 0.3 for i in range(n)])
    return Tally(score, runs, [0.001] * n)


def test_estimates_are_the_scores_of_all_cases() -> None:
    errors = np.random.default_rng(1).exponential(2.0, 41)
    found = estimates(tally(errors, [i // 2 for i in range(41)]), np.random.default_rng(2))
    assert set(found) == set(COLUMNS)
    assert found["rmse"].value == pytest.approx(math.sqrt((errors**2).mean()))
    assert found["median"].value == np.median(errors)
    assert found["log_score"].value == pytest.approx(-errors.mean())
    assert found["coverage_95"].value == pytest.approx(1 - 11 / 41)
    assert found["ms"].value == pytest.approx(1.0)
    assert all(e.low <= e.value <= e.high for e in found.values())


def test_intervals_are_over_runs_and_not_over_cases() -> None:
    """Forty copies of each of ten cases know no more than the ten."""
    errors = np.random.default_rng(1).exponential(2.0, 10)
    once = estimates(tally(errors, list(range(10))), np.random.default_rng(2))["rmse"]
    copied = estimates(tally(np.repeat(errors, 40), [i // 40 for i in range(400)]), np.random.default_rng(2))["rmse"]
    assert (copied.low, copied.high) == pytest.approx((once.low, once.high), rel=1e-9)


def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    chance = np.random.default_rng(5)
    held = 0
    for _ in range(200):
        (interval,) = means(chance.standard_normal((40, 1)), chance)
        held += interval.low <= 0.0 <= interval.high
    assert 0.88 <= held / 200 <= 0.99


def test_the_difference_of_two_tallies_is_paired() -> None:
    errors = np.random.default_rng(1).exponential(5.0, 30)
    gained = difference(tally(errors, list(range(30))), tally(errors + 0.1, list(range(30))), np.random.default_rng(1))
    assert (gained.value, gained.low, gained.high) == pytest.approx((0.1, 0.1, 0.1))


# --- the contest -----------------------------------------------------------------------------------------------------


def test_every_rule_takes_part() -> None:
    assert {rule.rule for rule in contest.CONTENDERS.values()} == set(POOLS)
    assert contest.CONTENDERS[contest.THE_DEFAULT] == contest.DEFAULT


def test_a_rule_is_judged_as_the_pool_itself() -> None:
    (case,) = drawn("one liar", 1)
    for name, own in (("cooperative", {"k": 2.0, "gamma": 0.5}), ("coalition", {"gate": 4.0, "independence": 0.2})):
        p = fuse(name, case.opinions, **own)
        score = Score()
        score.add(Belief(case.grid, p), case.truth)
        found = contest.judge([(0, [case])], {name: contest.CONTENDERS[name]}, lambda: 0.0)[name].score
        assert found == score


def test_known_common_information_is_divided_out() -> None:
    (case,) = drawn("echoes", 1)
    p, failed = contest.fused(case, contest.CONTENDERS["channel-filter"])
    assert not failed
    assert p == pytest.approx(fuse("logarithmic", case.opinions[[0, 4]]), abs=1e-9)


def test_a_veto_that_leaves_no_cell_is_counted_and_scored() -> None:
    p = np.zeros((2, *GRID.shape))
    p[0, 3, 3] = p[1, 40, 40] = 1.0
    case = Case(GRID, "object/x", 0.0, ("a", "b"), p, (3.5, 3.5))
    found = contest.judge([(0, [case])], contest.contenders(GRID), lambda: 0.0)
    assert found["logarithmic"].failed == 1
    assert found["linear"].failed == found["coalition"].failed == 0
    assert len(found["logarithmic"].runs) == 1


def test_reference_cells_are_given_in_cells() -> None:
    fine = contest.contenders(type(GRID)((20, 20), 0.25))
    assert fine["cooperative v_ref=.5"].reference_cell == 0.125
    assert fine["cooperative"].reference_cell is None


def test_the_default_is_honest_where_the_papers_is_not() -> None:
    """100 runs a trial: the default covers at least 88 % in four of five and bears one liar; COP as printed in none."""
    covered, best = {}, {}
    for trial in TRIALS:
        found = judged(trial, 100, ["coalition", "cooperative", "median-log"], seed=7)
        shares = {name: t.score.summary()["coverage"]["95"] for name, t in found.items()}
        covered[trial] = shares["coalition"] >= 0.88, shares["cooperative"] >= 0.88
        best[trial] = max(shares.values())
        if trial == "one liar":
            assert np.median(found["coalition"].score.errors) <= 2.0
    ours, papers = zip(*covered.values(), strict=True)
    assert sum(ours) >= 4
    assert not any(papers)
    assert min(best.values()) >= 0.9


def test_the_report_marks_the_best_and_shows_every_failure() -> None:
    streams = {trial: judged(trial, 12, list(contest.CONTENDERS)) for trial in ("independent", "one liar")}
    found = contest.report(streams, np.random.default_rng(1))
    liar = found["trials"]["one liar"]
    assert (liar["runs"], liar["cases"]) == (12, 12)
    assert set(liar["rules"]) == set(contest.CONTENDERS) == set(found["rules"])
    rows = liar["rules"]
    assert rows["chernoff"]["median"]["value"] == pytest.approx(LIE, abs=0.5)  # believes the sharpest liar
    assert not any("chernoff" in names for column, names in liar["best"].items() if column != "ms")
    (best, *_) = liar["best"]["log_score"]
    assert rows[best]["log_score"]["value"] == pytest.approx(
        max(r["log_score"]["value"] for r in rows.values()), abs=1e-3
    )
    sharp = liar["best"]["entropy"]
    assert all(rows[name]["coverage_95"]["value"] >= contest.HONEST for name in sharp)
    told = contest.text(found)
    assert "> coalition" in told
    assert all(name in told for name in contest.CONTENDERS)


def test_the_entropy_of_the_dishonest_is_never_the_best() -> None:
    found = contest.report(
        {"two collude": judged("two collude", 20, ["cooperative", "coalition"])}, np.random.default_rng(1)
    )
    trial = found["trials"]["two collude"]
    assert trial["rules"]["cooperative"]["entropy"]["value"] < trial["rules"]["coalition"]["entropy"]["value"]
    assert trial["best"]["entropy"] == ["coalition"]


def test_a_gaussian_that_is_alone_stays_as_it_is() -> None:
    case = Case(GRID, "object/x", 0.0, ("a",), gaussian(GRID, (20, 20), 2.0).p[np.newaxis], (20, 20))
    for name, rule in contest.CONTENDERS.items():
        assert contest.fused(case, rule)[0] == pytest.approx(case.opinions[0], abs=1e-12), name
