"""The numbers behind the paper's figures: golden ones, and its claims with what became of them."""

import json
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.config import load
from blackboard.lab import paper
from blackboard.lab.team_cases import agreed_beliefs, first_hand_cases
from blackboard.lab.team_joint import joint_sizes
from blackboard.lab.team_size import TeamSizeScores
from blackboard.opinion.weights import entropy
from tests.files import page
from tests.lab.figures import numbers, score_figures
from tests.lab.sized import METRICS, SEEDS, SIZES, recorded

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parent.parent / "golden" / "paper.json").read_text(encoding="utf-8")
)


def merged(part: str, rule: str) -> TeamSizeScores:
    runs: list[dict[str, TeamSizeScores]] = [getattr(score_figures(seed), part) for seed in range(4)]
    return reduce(TeamSizeScores.merge, (run[rule] for run in runs))


@pytest.mark.parametrize(
    ("golden", "figure", "case"),
    [
        ("Fig. 2", "fig2", "as printed"),
        ("Fig. 4, text", "fig4", "as its text tells"),
        ("Fig. 4, caption", "fig4", "as its caption prints"),
        ("Fig. 5", "fig5", "as printed"),
    ],
)
def test_figures_2_4_and_5_have_the_golden_numbers(golden: str, figure: str, case: str) -> None:
    expected, case_numbers = GOLDEN["figures"][golden], numbers()[figure]["cases"][case]
    assert f"{min(case_numbers['entropies']):.4f}" == expected["best"]
    for rule in ("linear", "logarithmic", "cooperative"):
        assert [f"{case_numbers['fused'][rule]['entropy']:.4f}", case_numbers["fused"][rule]["peak"]] == expected[rule]
    assert f"{case_numbers['fused']['cooperative']['mass below 40']:.4f}" == expected["below 40"]


def test_the_answer_depends_on_the_grid_but_for_the_reference_cell() -> None:
    resolutions = numbers()["fig5"]["resolution"]
    for per_unit, mass in GOLDEN["reference cell"]["mass below 40 by cells per unit, v_ref = 1 unit"].items():
        assert resolutions[per_unit]["reference cell"]["mass below 40"] == pytest.approx(mass, abs=1e-5)
    for per_unit, peak in GOLDEN["without reference cell"]["peak by cells per unit"].items():
        assert resolutions[per_unit]["as printed"]["peak"] == peak


def test_figure_1_agreement_lowers_the_entropy_and_disagreement_does_not() -> None:
    agree, disagree = numbers()["fig1"]["cases"].values()
    assert agree["fused"]["logarithmic"]["entropy"] < min(agree["entropies"])
    assert disagree["fused"]["logarithmic"]["entropy"] > max(disagree["entropies"])
    # the claim needs sensors that may be wrong
    assert disagree["entropy of pure Gaussians"] < min(disagree["entropies"])


def test_figure_3_says_what_the_paper_says() -> None:
    fig3 = numbers()["fig3"]
    assert all(len(ratios) == paper.PLACES for ratios in fig3["ratios"].values())
    assert fig3["share below 1"] == {"linear": 0.0, "logarithmic": 1.0, "cooperative": 1.0}


def test_figures_6_and_7_are_means_over_what_was_scored() -> None:
    told6, told7 = numbers()["fig6"], numbers()["fig7"]
    # every tick, or a saw-tooth of 6 s shows as another
    assert told6["time"] == [float(second) for second in range(1, 13)]
    assert told7["robots"] == [1, 2, 3]
    assert told7["seeds"] == 4
    over_time, growth = merged("over_time", "cooperative"), merged("over_size", "cooperative")
    at = np.equal(over_time.time, 8.0)
    six = told6["grids"]["25"]
    assert six["cooperative"]["entropy"][7] == pytest.approx(np.array(over_time.entropies)[at, -1].mean())
    assert six["alone"]["entropy"][7] == pytest.approx(np.array(over_time.original)[at].mean())
    assert told6["means"]["25"]["alone"]["entropy"] == pytest.approx(np.mean(six["alone"]["entropy"]))
    at_8 = over_time.means(np.where(at[:, None], over_time.entropies, 0.0)) / over_time.means(at[:, None] * 1.0)
    low, high = (six["cooperative"][f"entropy_{end}"][7] for end in ("low", "high"))
    assert high - low == pytest.approx(2 * 3.182 * at_8[:, -1].std(ddof=1) / 2, rel=0.1)  # Student's t of four runs
    for metric in ("log_score", "coverage_50", "coverage_95"):
        ends = (six["coalition"][metric + end] for end in ("_low", "", "_high"))
        assert all(low <= value <= high for low, value, high in zip(*ends, strict=True))
    assert all(high <= 1.0 for high in six["coalition"]["coverage_95_high"])
    assert set(growth.time) == {4.0, 8.0, 12.0}
    seven = told7["grids"]["25"]["cooperative"]
    ratios = growth.means(np.array(growth.entropies) / np.array(growth.original)[:, None])
    assert seven["ratio"] == pytest.approx(ratios.mean(axis=0))
    assert seven["ratio"][0] == 1.0
    assert seven["ratio"][2] < 1.0
    for metric in ("log_score", "coverage_50", "coverage_95"):
        assert all(lo <= v <= hi for lo, v, hi in zip(seven[f"{metric}_low"], seven[metric], seven[f"{metric}_high"], strict=True))  # fmt: skip
    assert all(high <= 1.0 for level in (50, 95) for high in seven[f"coverage_{level}_high"])
    assert set(seven["by_kind"]) == {"robot", "object"}


def test_the_joint_is_shown_on_the_same_rows_as_the_rules() -> None:
    for seed in range(4):
        for part in (score_figures(seed).over_time, score_figures(seed).over_size):
            rows = {name: (of_rule.time, of_rule.subject, of_rule.original) for name, of_rule in part.items()}
            assert set(rows) == {*paper.RULES, paper.JOINT}
            assert all(row == rows["cooperative"] for row in rows.values())
    joint, rules = merged("over_size", paper.JOINT), merged("over_size", "coalition")
    assert np.mean(np.array(joint.log_scores)[:, -1]) > np.mean(np.array(rules.log_scores)[:, -1])


def test_the_joint_of_a_team_is_that_of_its_boards() -> None:
    """All robots of a run: `Team` with fusion "joint", whose robots are told where to linearise, agrees on nearly the same."""
    scenario = paper.world(load("paper"), 25, 3, 6.0).changed("board", fusion="joint")
    run = first_hand_cases(scenario, 1.0)
    agreed = agreed_beliefs(scenario, [case.asked for case in run])
    (sizes,) = joint_sizes(scenario, [(run, (3,))], 0)
    own = {
        (round(time, 3), subject): row[0]
        for time, subject, row in zip(sizes.time, sizes.subject, sizes.entropies, strict=True)
    }
    apart = [entropy(agreed[name].p) - value for name, value in own.items()]
    assert len(apart) >= 18
    assert np.median(np.abs(apart)) < 0.05


def test_the_arena_is_the_same_on_every_grid() -> None:
    for cells in (50, 200):
        world = paper.world(load("paper"), cells, 10, 5.0)
        assert world.grid.shape == (cells, cells)
        assert world.grid.cell * cells == 50.0
        assert len(world.team.robots) == 10


def test_the_pages_have_the_numbers_of_fig_7() -> None:
    """docs/paper.md over all runs, its note over the first four."""
    pages = "".join(" ".join(page(name).replace("**", "").split()) for name in ("paper.md", "notes/paper.md"))
    runs = recorded()

    def mean(rule: str, metric: str, seeds: int = SEEDS) -> list[float]:
        return [float(value) for value in np.mean([runs[rule, metric, seed] for seed in range(seeds)], axis=0)]

    def share(value: float) -> str:
        return f"{value:.2f}".removeprefix("0")

    for rule, called in (("cooperative", "COP as printed"), ("coalition, independent", "coalition, independence 1")):
        logs, covered = mean(rule, "log_score"), mean(rule, "coverage_95")
        assert f"| {called}: log score | {' | '.join(f'{value:.2f}' for value in logs)} |" in pages
        assert f"| {called}: 95 % coverage | {' | '.join(map(share, covered))} |" in pages
    cop = mean("cooperative", "log_score"), mean("cooperative", "coverage_95")
    assert all(sorted(values, reverse=True) == values for values in cop)  # "fall with every robot added"
    assert f"falls to {mean('cooperative', 'ratio')[-1]:.2f} with ten robots on 50 x 50 cells" in pages
    for rule, called in (("cooperative", "COP as printed"), ("coalition", "coalition, the default")):
        shown = [SIZES.index(size) for size in (1, 2, 4, 10)]
        ratio, logs, half, most = ([mean(rule, m, 4)[i] for i in shown] for m in METRICS)
        assert f"| {called}: entropy ratio | 1 | {' | '.join(f'{value:.2f}' for value in ratio[1:])} [" in pages
        assert f"| log score | {' | '.join(f'{value:.2f}' for value in logs)} [" in pages
        both = (f"{share(a)} / {share(b)}" for a, b in zip(half, most, strict=True))
        assert f"| 50 / 95 % coverage | {' | '.join(both)} |" in pages


def test_the_page_has_the_numbers_of_the_figures_on_a_line() -> None:
    """docs/paper.md, "What holds" and "What does not hold as printed": Figs. 2, 3 and 5."""
    text, computed = " ".join(page("paper.md").split()), numbers()
    two, three = computed["fig2"]["cases"]["as printed"], computed["fig3"]["ratios"]
    fused = {rule: case["entropy"] for rule, case in two["fused"].items()}
    best = min(two["entropies"])
    assert f"{fused['cooperative']:.3f} against {fused['logarithmic']:.3f} of LGP and {best:.3f} of the best" in text
    ratios = [f"{np.mean(three[rule]):.2f}" for rule in ("cooperative", "logarithmic", "linear")]
    assert "its entropy is {} of the best sensor's, against {} of LGP and {} of LOP".format(*ratios) in text
    peaks = {per_unit: round(case["as printed"]["peak"]) for per_unit, case in computed["fig5"]["resolution"].items()}
    assert {peaks["1"]} == {26}
    assert {peaks[n] for n in ("2", "4", "10")} == {42}
    assert "Fig. 5's answer is 26 with one cell per unit, and 42 with two, four or ten." in text
