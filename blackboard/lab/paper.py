"""The numbers behind the paper's Figs. 1 to 7 (Pahliani & Lima, IROS 2007), with what it leaves out: log score and coverage. Pure.

Figs. 1 to 5 are opinions on a line of 100 units, cell i centred at i; k = 2 and gamma = 1/2 as in the captions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from blackboard.config import Scenario
from blackboard.judge.intervals import FEWEST, Estimate, means, over_runs, resamples
from blackboard.lab.comparison import DEFAULT, PAPER
from blackboard.lab.team_size import TeamSizeScores
from blackboard.opinion.averages import linear_pool, logarithmic_pool
from blackboard.opinion.belief import gaussian
from blackboard.opinion.cooperative import cooperative_pool
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.rules import Rule
from blackboard.opinion.scores import held
from blackboard.opinion.weights import entropy, entropy_weights

Sensors = Sequence[tuple[float, float]]  # mean and sigma, units

#: As printed in the captions; Fig. 4's text describes four sensors that are close and one that is not.
FIG2: Sensors = ((25, 5), (27, 4), (24, 5), (28, 4), (31, 3))
FIG4_CAPTION: Sensors = ((25, 5), (27, 4), (26, 5), (57, 1.5), (59, 2))
FIG4_TEXT: Sensors = ((25, 5), (27, 4), (26, 5), (27, 4), (57, 1.5))
FIG5: Sensors = ((25, 5), (27, 4), (24, 5), (44, 4), (47, 1.5))
#: Fig. 1 is printed without parameters: two that agree and one that does not, here.
FIG1: Sensors = ((40, 4), (44, 5), (72, 4))
OUTLIER = 0.1  # share of Fig. 1's sensors that may be wrong: without it no two Gaussians ever fuse to a higher entropy

FAR = 40.0  # units: the sensors that agree are below, the odd ones above
PARAMETERS = "k = 2, gamma = 1/2"
PLACES = 40  # of the robot in Fig. 3
ARENA = 50.0  # units along each edge, in Figs. 6 and 7

#: What Figs. 6 and 7 show: the paper's rule, the same without its dependence on the grid, and a board's default.
RULES: dict[str, Rule] = {
    "cooperative": PAPER,
    "cooperative, reference cell": replace(PAPER, reference_cell=1.0),
    "coalition": DEFAULT,
    "coalition, independent": replace(DEFAULT, independence=1.0),
}


#: The name of the team's joint Gaussian (`[board] fusion = "joint"`) beside the rules.
JOINT = "joint"


@dataclass(frozen=True)
class FigureScores:
    """What Figs. 6 and 7 show of one run, for each of RULES and JOINT."""

    over_time: dict[str, TeamSizeScores]  # in every tick, of one robot and of all
    over_size: dict[str, TeamSizeScores]  # every few seconds, of 1, 2, ... robots

    def beside(self, other: FigureScores) -> FigureScores:
        """With what another one shows of the same run."""
        return FigureScores(self.over_time | other.over_time, self.over_size | other.over_size)


def line(per_unit: int = 1) -> Grid:
    """100 units of a line; cell i is centred at i / per_unit."""
    return Grid((100 * per_unit,), 1 / per_unit, (-0.5 / per_unit,))


def world(paper: Scenario, cells: int, robots: int, seconds: float) -> Scenario:
    """The paper's world with the arena of 50 x 50 units divided into cells x cells, and so many robots in one team."""
    chosen = paper.changed("grid", shape=[cells, cells], cell=ARENA / cells)
    chosen = chosen.changed("team", sub_teams={"a": [f"r{i + 1}" for i in range(robots)]})
    # the object stands still; [robot.objects] of the scenario says so too
    chosen = chosen.changed("board", objects_drift=0.0)
    return chosen.changed("time", seconds=seconds)


def on_a_line(rng: np.random.Generator) -> dict[str, Any]:
    """The numbers of Figs. 1 to 5 as JSON."""
    return {
        "fig1": fig1(),
        "fig2": _figure("Fig. 2: five sensors that agree", {"as printed": FIG2}),
        "fig3": fig3(rng),
        "fig4": _figure("Fig. 4: one sensor is wrong", {"as its text tells": FIG4_TEXT, "as its caption prints": FIG4_CAPTION}),
        "fig5": {**_figure("Fig. 5: two are wrong, and disagree", {"as printed": FIG5}), "resolution": resolution()},
    }  # fmt: skip


def in_the_world(runs: Mapping[int, Sequence[FigureScores]], rng: np.random.Generator) -> dict[str, Any]:
    """The numbers of Figs. 6 and 7 as JSON; `runs` holds the scores of each run of `world` for each grid size."""
    shown = {
        what: {
            n: {
                name: reduce(TeamSizeScores.merge, (getattr(run, what)[name] for run in some))
                for name in (*RULES, JOINT)
            }
            for n, some in runs.items()
        }
        for what in ("over_time", "over_size")
    }
    seven = fig7(shown["over_size"], rng)
    return {"fig6": fig6(shown["over_time"], rng), "fig7": seven}


def fig1() -> dict[str, Any]:
    """What agreement does to the entropy of the LGP: P1 and P2 agree, P1 and P3 do not."""
    grid = line()
    gaussians = np.stack([gaussian(grid, (mean,), sigma).p for mean, sigma in FIG1])
    cases = {}
    for name, pair in (("P1 and P2 agree", [0, 1]), ("P1 and P3 do not", [0, 2])):
        opinions = (1 - OUTLIER) * gaussians[pair] + OUTLIER / grid.size
        cases[name] = _case(grid, opinions, {"logarithmic": logarithmic_pool(opinions)}, [f"P{i + 1}" for i in pair])
        cases[name]["entropy of pure Gaussians"] = entropy(logarithmic_pool(gaussians[pair]))
    return {"title": "Fig. 1: agreement and the entropy of the LGP (w = 1)", "cases": cases}


def fig3(rng: np.random.Generator) -> dict[str, Any]:
    """Three sensors of a robot that agree, at one place after the other: entropy of what each rule makes of them / the best."""
    ratios: dict[str, list[float]] = {"linear": [], "logarithmic": [], "cooperative": []}
    grid = line()
    places = np.linspace(20, 80, PLACES)
    for place in places:
        sigmas = rng.uniform(2.0, 5.0, 3) * (0.6 + place / 100)  # the farther, the worse
        means = place + 0.5 * sigmas * rng.standard_normal(3)  # in agreement: half of what sigma allows
        opinions = np.stack([gaussian(grid, (m,), float(s)).p for m, s in zip(means, sigmas, strict=True)])
        best = min(entropy(p) for p in opinions)
        for rule, p in _fused(opinions).items():
            ratios[rule].append(entropy(p) / best)
    return {
        "title": f"Fig. 3: three sensors that agree, at 40 places ({PARAMETERS})",
        "places": places.tolist(),  # units
        "ratios": ratios,
        "share below 1": {rule: float(np.mean(np.less(values, 1.0))) for rule, values in ratios.items()},
    }


def resolution() -> dict[str, Any]:
    """Fig. 5's answer on finer grids: its peak, and the mass below 40, as printed and with a reference cell of one unit."""
    table: dict[str, Any] = {}
    for per_unit in (1, 2, 4, 10):
        grid = line(per_unit)
        opinions = np.stack([gaussian(grid, (mean,), sigma).p for mean, sigma in FIG5])
        near = grid.centres(0) < FAR - 1e-9
        of_grid = {}
        for name, ratio in (("as printed", 1.0), ("reference cell", float(per_unit))):
            p = cooperative_pool(opinions, entropy_weights(opinions, 2.0, cell_ratio=ratio), cell_ratio=ratio)
            of_grid[name] = {"peak": float(grid.centres(0)[p.argmax()]), "mass below 40": float(p[near].sum())}
        table[str(per_unit)] = of_grid
    return table


def _figure(title: str, cases: Mapping[str, Sensors]) -> dict[str, Any]:
    grid, fused_cases = line(), {}
    for name, sensors in cases.items():
        opinions = np.stack([gaussian(grid, (mean,), sigma).p for mean, sigma in sensors])
        fused_cases[name] = _case(grid, opinions, _fused(opinions))
    return {"title": f"{title} ({PARAMETERS})", "cases": fused_cases}


def _fused(opinions: Array) -> dict[str, Array]:
    weights = entropy_weights(opinions, 2.0)
    return {
        "linear": linear_pool(opinions, weights),
        "logarithmic": logarithmic_pool(opinions),  # w = 1
        "cooperative": cooperative_pool(opinions, weights, gamma=0.5),
    }


def _case(
    grid: Grid, opinions: Array, fused: Mapping[str, Array], names: Sequence[str] | None = None
) -> dict[str, Any]:
    x = grid.centres(0)
    return {
        "names": list(names or (f"P{i + 1}" for i in range(len(opinions)))),
        "x": x.tolist(),
        "opinions": opinions.tolist(),
        "entropies": [entropy(p) for p in opinions],
        "fused": {
            rule: {
                "entropy": entropy(p),
                "peak": float(x[p.argmax()]),
                "mass below 40": float(p[x < FAR - 1e-9].sum()),
                "p": p.tolist(),
            }
            for rule, p in fused.items()
        },
    }


# --- in the simulated world -----------------------------------------------------------------------------------------------


def fig6(grids: Mapping[int, Mapping[str, TeamSizeScores]], rng: np.random.Generator) -> dict[str, Any]:
    """Over time: what a robot believes alone and what the whole team does, mean over robots, subjects and runs.

    All robots get their fix at the same instants, so the beliefs are a saw-tooth, which only every tick shows as it is.
    `means` are those over time. low and high as in Fig. 7.
    """
    first = next(iter(grids[min(grids)].values()))
    time = sorted(set(first.time))
    by_grid: dict[str, Any] = {}
    over_time: dict[str, Any] = {}
    for size, by_rule in grids.items():
        shown = [("alone", next(iter(by_rule.values())), 0), *((rule, scores, -1) for rule, scores in by_rule.items())]
        estimates = {name: _at_times(scores, time, column, rng) for name, scores, column in shown}
        by_grid[str(size)] = {name: {key: row[:-1] for key, row in e.items()} for name, e in estimates.items()}
        over_time[str(size)] = {name: {key: row[-1] for key, row in e.items()} for name, e in estimates.items()}
    title = f"Fig. 6: one robot's belief and that of all, {_runs(first)} ({PARAMETERS})"
    return {"title": title, "time": time, "grids": by_grid, "means": over_time}


def _at_times(
    scores: TeamSizeScores, time: Sequence[float], size: int, rng: np.random.Generator
) -> dict[str, list[float | None]]:
    """The mean at each instant, then that over time, with intervals.

    size is an index: 0 the robot alone (a pool of one is that opinion), -1 the whole team.
    """
    runs, of_run = np.unique(scores.run, return_inverse=True)
    rows = (of_run, np.searchsorted(time, scores.time))
    picks, counts = resamples(len(runs), rng), np.zeros((len(runs), len(time)))
    np.add.at(counts, rows, 1.0)
    told: dict[str, list[float | None]] = {}
    for metric, values in _metrics(scores).items():
        sums = np.zeros_like(counts)
        np.add.at(sums, rows, values[:, size])
        means, drawn = sums.sum(axis=0) / counts.sum(axis=0), (picks @ sums) / (picks @ counts)
        both = (np.append(means, means.mean()), np.column_stack([drawn, drawn.mean(axis=1)]))
        told |= _named(metric, over_runs(*both, len(runs)))
    return told


def fig7(grids: Mapping[int, Mapping[str, TeamSizeScores]], rng: np.random.Generator) -> dict[str, Any]:
    """Over the size of the team: the average ratio of the cooperative entropy to the original one, and what it is worth.

    low and high: the 95 % interval over the runs, None of fewer than four. `by_kind` has robots and objects apart.
    """
    by_grid = {str(n): {rule: _of_kinds(scores, rng) for rule, scores in of.items()} for n, of in grids.items()}
    any_scores = next(iter(next(iter(grids.values())).values()))
    robots = list(range(1, len(any_scores.entropies[0]) + 1))
    title = f"Fig. 7: cooperating robots, {_runs(any_scores)} ({PARAMETERS})"
    return {"title": title, "robots": robots, "seeds": len(set(any_scores.run)), "grids": by_grid}


def _of_kinds(scores: TeamSizeScores, rng: np.random.Generator) -> dict[str, Any]:
    together = _by_size(scores, rng)
    kinds = {kind: some for kind in ("robot", "object") if (some := _only(scores, kind)).run}
    return {**together, "by_kind": {kind: _by_size(some, rng) for kind, some in kinds.items()}}


def _runs(scores: TeamSizeScores) -> str:
    runs = len(set(scores.run))
    return f"{runs} runs, 95 % intervals" if runs >= FEWEST else f"{runs} run{'s' * (runs > 1)}"


def _by_size(scores: TeamSizeScores, rng: np.random.Generator) -> dict[str, list[float | None]]:
    by_size: dict[str, list[float | None]] = {}
    ratio = np.array(scores.entropies) / np.array(scores.original)[:, None]
    for metric, values in {"ratio": ratio, **_metrics(scores)}.items():
        by_size |= _named(metric, means(scores.means(values), rng))
    return by_size


def _named(metric: str, estimates: Sequence[Estimate]) -> dict[str, list[float | None]]:
    """Values by the name of their metric, and the ends of their intervals; a share ends at 0 and 1."""
    least, most = (0.0, 1.0) if metric.startswith("coverage") else (-np.inf, np.inf)
    within = [estimate.within(least, most) for estimate in estimates]
    return {
        metric: [e.value for e in within],
        f"{metric}_low": [e.low for e in within],
        f"{metric}_high": [e.high for e in within],
    }


def _metrics(scores: TeamSizeScores) -> dict[str, Array]:
    """Entropy, log score and coverages, each (rows, sizes)."""
    return {
        "entropy": np.array(scores.entropies),
        "log_score": np.array(scores.log_scores),
        "coverage_50": held(scores.levels, scores.borders, 0.5),
        "coverage_95": held(scores.levels, scores.borders, 0.95),
    }


def _only(scores: TeamSizeScores, kind: str) -> TeamSizeScores:
    """The rows about robots, or about objects."""
    kept = [i for i, subject in enumerate(scores.subject) if subject.startswith(f"{kind}/")]
    return replace(scores, **{name: [getattr(scores, name)[i] for i in kept] for name in scores.__dataclass_fields__})
