"""Tuning: every candidate against the pool itself, and the choice against its own rules."""

import numpy as np
import pytest

from blackboard.judge.intervals import Estimate
from blackboard.lab.cases import Case
from blackboard.lab.comparison import DEFAULT, PAPER
from blackboard.lab.estimates import RuleScores
from blackboard.lab.team_size import TeamSizeScores
from blackboard.lab.tuning import SPACES, CandidateScores, board_table, candidates, choose, enough, recommended, try_all
from blackboard.lab.tuning_report import text, tuned
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import fuse
from blackboard.opinion.rules import Rule
from blackboard.opinion.scores import Score, border_mass, hdr_level, held, log_score
from tests.opinion.stacks import make

GRID = Grid((6, 5), 0.5)


def case(seed: int, n: int, truth: tuple[float, float] = (1.2, 0.7)) -> Case:
    opinions = make("random", n, GRID.shape, np.random.default_rng(seed))
    return Case(GRID, "object/x", 0.0, tuple(f"r{i}" for i in range(n)), opinions, truth)


@pytest.mark.parametrize("rule", SPACES)
def test_every_candidate_scores_as_the_pool_itself(rule: str) -> None:
    run = [case(1, 1), case(2, 3), case(3, 4, truth=(99.0, 0.0))]
    tried = try_all(rule, [run, run[:1]])
    assert tried.cases.tolist() == [3.0, 1.0]
    index = GRID.index(run[0].truth)
    assert index is not None
    settings = candidates(rule, GRID.cell)
    assert tried.log_scores.shape == tried.covered.shape == (2, len(settings))
    for i in range(0, len(settings), 7):
        fused = [fuse(settings[i], c.opinions, GRID).p for c in run[:2]]
        scores = [log_score(p, index) for p in fused]
        covered = [float(held(hdr_level(p, index), border_mass(p, index), 0.95)) for p in fused]
        assert tried.log_scores[0, i] == pytest.approx(sum(scores) + np.log(1e-12), abs=1e-8), settings[i]
        assert tried.log_scores[1, i] == pytest.approx(scores[0], abs=1e-8)
        assert tried.covered[:, i] == pytest.approx([sum(covered), covered[0]], abs=1e-6), settings[i]


def candidate(log_scores: list[float], shares: list[float], runs: int = 6) -> CandidateScores:
    """The first candidates of "coalition" as given, all others bad; each run alike."""
    n = len(candidates("coalition"))
    scores, covered = np.full(n, -9.0), np.zeros(n)
    scores[: len(log_scores)], covered[: len(shares)] = log_scores, shares
    return CandidateScores(
        "coalition", np.tile(scores * 10, (runs, 1)), np.tile(covered * 10, (runs, 1)), np.full(runs, 10.0)
    )


def test_the_best_of_the_honest_is_chosen() -> None:
    choice = choose(candidate([-1.0, -3.0, -2.0], [0.5, 0.95, 0.92]), 0.9, 1.0, np.random.default_rng(1))
    assert choice["setting"] == candidates("coalition")[2]
    assert choice["honest"]
    assert (choice["log_score"], choice["coverage_95"]) == pytest.approx((-2.0, 0.92))
    for name, interval in choice["parameters"].items():
        assert interval["low"] == interval["value"] == interval["high"] == getattr(choice["setting"], name)


def test_where_nobody_is_honest_the_one_that_covers_most_is_chosen_and_that_is_said() -> None:
    choice = choose(candidate([-1.0, -3.0], [0.5, 0.6]), 0.9, 1.0, np.random.default_rng(1))
    assert choice["setting"] == candidates("coalition")[1]
    assert not choice["honest"]


def test_intervals_show_when_the_runs_do_not_agree() -> None:
    """Half of the runs are for the first candidate, half for the last: the interval spans what lies between."""
    scores = candidate([-1.0], [1.0], runs=10)
    scores.log_scores[::2, 0], scores.log_scores[::2, -1] = -40.0, -10.0
    scores.covered[:, -1] = 10
    choice = choose(scores, 0.9, 1.0, np.random.default_rng(1))
    spans = {name: (e["low"], e["high"]) for name, e in choice["parameters"].items()}
    assert spans["gate"] == (min(SPACES["coalition"]["gate"]), max(SPACES["coalition"]["gate"]))


def test_few_runs_give_no_spread() -> None:
    choice = choose(candidate([-1.0], [1.0], runs=3), 0.9, 1.0, np.random.default_rng(1))
    assert all(e["low"] is None and e["high"] is None for e in choice["parameters"].values())


@pytest.mark.parametrize(
    ("gain", "honest", "which", "why"),
    [
        (Estimate(0.1, 0.02, 0.18), True, "tuned", "beats the default"),
        (Estimate(0.1, -0.02, 0.22), True, "default", "does not beat it"),
        (Estimate(0.0, 0.0, 0.0), True, "default", "does not beat it"),  # the choice is the default
        (Estimate(-0.1, -0.2, -0.05), True, "default", "does not beat it"),
        (Estimate(0.5, None, None), True, "default", "fewer than 4"),
        (Estimate(0.1, 0.02, 0.18), False, "default", "covers what is asked"),
    ],
)
def test_the_default_is_kept_where_the_choice_does_not_beat_it(
    gain: Estimate, honest: bool, which: str, why: str
) -> None:
    answer, reason = recommended(gain, honest)
    assert answer == which
    assert why in reason


@pytest.mark.parametrize(("better", "which"), [(0.3, "tuned"), (-0.3, "default")])
def test_the_report_recommends_by_the_held_out_runs_alone(better: float, which: str) -> None:
    """Six held-out runs in which the choice is so many nats better than the default, give or take 0.1."""
    setting, rng = Coalition(gate=5.0), np.random.default_rng(3)
    judged = {"tuned": setting, "default": DEFAULT, "paper": PAPER}
    choice = {"setting": setting, "parameters": {}, "log_score": -2.0, "coverage_95": 0.95, "honest": True}

    def scores(run: int, log: float, rule: Rule) -> RuleScores:
        return RuleScores(Score([1.0], [1.0], [log], [0.5], [0.01]), [run], [0.001], in_force=rule.in_force())

    sizes = TeamSizeScores([0], [1.0], ["robot/r1"], [3.0], [[3.0, 2.0]], [[-3.0, -2.0]], [[0.5, 0.5]])
    checks = []
    for run in range(6):
        logs = {"tuned": -2.0 + better + 0.1 * rng.standard_normal(), "default": -2.0, "paper": -3.0}
        own = TeamSizeScores(**{**sizes.__dict__, "run": [run]})
        checks.append(({name: scores(run, log, judged[name]) for name, log in logs.items()}, {"tuned": own}))
    report = tuned({"coalition": choice}, choice, judged, checks, coverage=0.9, gain=0.05, rng=np.random.default_rng(1))
    assert report["recommended"]["which"] == which
    assert report["board"] == board_table(judged[which])
    assert report["chosen"]["gate"] == 5.0
    assert ("take the choice" if which == "tuned" else "keep the default") in text(report)
    assert report["gain_over_default"]["value"] == pytest.approx(better, abs=0.15)


def test_the_team_is_large_enough_when_one_more_gains_less() -> None:
    assert enough([0.5, 0.2, 0.04, 0.01], 0.05) == 3
    assert enough([0.01, 0.5, 0.02], 0.05) == 3  # the second mate did not help, the third did
    assert enough([0.01], 0.05) == 1
    assert enough([0.5, 0.2], 0.05) == 3


def test_the_board_table_is_what_a_board_reads() -> None:
    import tomllib

    from blackboard.config import BoardSection

    for rule in SPACES:
        setting = candidates(rule, 0.5)[11]
        read = BoardSection.model_validate(tomllib.loads(board_table(setting))["board"])
        p = make("random", 3, GRID.shape, np.random.default_rng(1))
        assert np.array_equal(fuse(read.of("object/x"), p, GRID).p, fuse(setting, p, GRID).p)
