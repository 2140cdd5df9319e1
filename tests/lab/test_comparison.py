"""The comparison of rules: what it counts, what it marks, and what the default must show."""

from dataclasses import replace

import numpy as np
import pytest

from blackboard.config import BoardSection
from blackboard.lab import comparison
from blackboard.lab.cases import GRID, LIE, TRIALS, Case
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.pools import POOLS, fuse
from blackboard.opinion.rules import read_rule
from blackboard.opinion.scores import Score
from tests.lab.trials import drawn, judged


def test_every_rule_takes_part() -> None:
    contenders = comparison.contenders(GRID)
    assert {rule.in_force()["rule"] for rule in contenders.values()} == set(POOLS) <= set(contenders)
    assert contenders[comparison.DEFAULT_NAME] == comparison.DEFAULT == BoardSection().of("object/ball")
    assert contenders["cooperative"] == comparison.PAPER


def test_a_scenario_s_own_board_takes_part_with_its_rule_for_each_subject() -> None:
    board = BoardSection.model_validate({"rule": "linear", "subjects": {"robot/*": {"rule": "median-log"}}})
    contenders = comparison.contenders(GRID, board)
    assert list(contenders)[-1] == comparison.OWN_BOARD
    (case,) = drawn("one liar", 1)
    for subject, rule in (("object/target", "linear"), ("robot/r1", "median-log")):
        of_subject = replace(case, subject=subject)
        assert np.array_equal(comparison.fused(of_subject, board).p, comparison.fused(of_subject, contenders[rule]).p)
    results = comparison.judge([(0, [case])], contenders, lambda: 0.0)
    report = comparison.report(
        {"team x": results, "one liar": judged("one liar", 1, ["coalition"])}, np.random.default_rng(1)
    )
    assert report["rules"]["[board]"] == {"rule": "linear", "k": 2.0, "robot/*.rule": "median-log"}
    assert "[board]" in comparison.text(report)


def test_a_rule_is_judged_as_the_pool_itself() -> None:
    (case,) = drawn("one liar", 1)
    for name, own in (("cooperative", {"k": 2.0, "gamma": 0.5}), ("coalition", {"gate": 4.0, "independence": 0.2})):
        p = fuse(read_rule({"rule": name, **own}), case.opinions, GRID).p
        score = Score()
        score.add(Belief(case.grid, p), case.truth)
        by_rule = comparison.judge([(0, [case])], {name: comparison.contenders(GRID)[name]}, lambda: 0.0)[name].score
        assert by_rule == score


def test_known_common_information_is_divided_out() -> None:
    (case,) = drawn("echoes", 1)
    pooled = comparison.fused(case, comparison.contenders(GRID)["channel-filter"])
    assert pooled.outcome == "pooled"
    assert pooled.p == pytest.approx(POOLS["logarithmic"](case.opinions[[0, 4]]), abs=1e-9)


def test_a_veto_that_leaves_no_cell_is_counted_and_scored() -> None:
    p = np.zeros((2, *GRID.shape))
    p[0, 3, 3] = p[1, 40, 40] = 1.0
    case = Case(GRID, "object/x", 0.0, ("a", "b"), p, (3.5, 3.5))
    results = comparison.judge([(0, [case])], comparison.contenders(GRID), lambda: 0.0)
    assert results["logarithmic"].failed == 1
    assert results["linear"].failed == results["coalition"].failed == 0
    assert len(results["logarithmic"].runs) == 1


def test_reference_cells_are_given_in_cells() -> None:
    fine = comparison.contenders(type(GRID)((20, 20), 0.25))
    assert fine["cooperative v_ref=.5"].in_force()["reference_cell"] == 0.125
    assert "reference_cell" not in fine["cooperative"].in_force()


def test_the_default_is_honest_where_the_papers_is_not() -> None:
    """50 runs a trial: the default covers at least 88 % in four of five and bears one liar; COP as printed in none."""
    covered, best = {}, {}
    for trial in TRIALS:
        results = judged(trial, 50, ["coalition", "cooperative", "median-log"], seed=7)
        shares = {name: t.score.summary()["coverage"]["95"] for name, t in results.items()}
        covered[trial] = shares["coalition"] >= 0.88, shares["cooperative"] >= 0.88
        best[trial] = max(shares.values())
        if trial == "one liar":
            assert np.median(results["coalition"].score.errors) <= 2.0
    ours, papers = zip(*covered.values(), strict=True)
    assert sum(ours) >= 4
    assert not any(papers)
    assert min(best.values()) >= 0.9


def test_the_report_marks_the_best_and_shows_every_failure() -> None:
    streams = {trial: judged(trial, 12, list(comparison.contenders(GRID))) for trial in ("independent", "one liar")}
    report = comparison.report(streams, np.random.default_rng(1))
    liar = report["trials"]["one liar"]
    assert (liar["runs"], liar["cases"]) == (12, 12)
    assert set(liar["rules"]) == set(comparison.contenders(GRID)) == set(report["rules"])
    rows = liar["rules"]
    assert rows["chernoff"]["median"]["value"] == pytest.approx(LIE, abs=0.5)  # believes the sharpest liar
    assert not any("chernoff" in names for column, names in liar["best"].items() if column != "ms")
    (best, *_) = liar["best"]["log_score"]
    assert rows[best]["log_score"]["value"] == pytest.approx(
        max(r["log_score"]["value"] for r in rows.values()), abs=1e-3
    )
    sharp = liar["best"]["entropy"]
    assert all(rows[name]["coverage_95"]["value"] >= comparison.HONEST for name in sharp)
    table = comparison.text(report)
    assert "> coalition" in table
    assert all(name in table for name in comparison.contenders(GRID))


def test_the_entropy_of_the_dishonest_is_never_the_best() -> None:
    report = comparison.report(
        {"two collude": judged("two collude", 20, ["cooperative", "coalition"])}, np.random.default_rng(1)
    )
    trial = report["trials"]["two collude"]
    assert trial["rules"]["cooperative"]["entropy"]["value"] < trial["rules"]["coalition"]["entropy"]["value"]
    assert trial["best"]["entropy"] == ["coalition"]


def test_a_gaussian_that_is_alone_stays_as_it_is() -> None:
    case = Case(GRID, "object/x", 0.0, ("a",), gaussian(GRID, (20, 20), 2.0).p[np.newaxis], (20, 20))
    for name, rule in comparison.contenders(GRID).items():
        assert comparison.fused(case, rule).p == pytest.approx(case.opinions[0], abs=1e-12), name
