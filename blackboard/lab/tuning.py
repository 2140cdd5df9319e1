"""Parameters chosen, not guessed: the setting with the highest log score of those that are honest. Pure; chance is an argument.

Every candidate of a rule is tried on every case. The components of COP are made once for each weight exponent k and
reference cell; all other parameters only weigh and power them (`tests/lab` holds this against the pools themselves).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blackboard.config import RuleSection
from blackboard.fusion import in_force
from blackboard.lab.cases import Case, Run
from blackboard.lab.tally import resamples
from blackboard.opinion.cooperative import alphas, gated_components, log_components
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEAST_PROBABILITY
from blackboard.opinion.weights import entropy_weights

K = (0.0, 1.0, 2.0)
REFERENCE = (0.25, 0.5, 1.0, 2.0)  # edge of the reference cell, in cells
GAMMA = (0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9)
POWER = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)
GATE = (1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 15.0)  # nats
INDEPENDENCE = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)

#: What is tuned of each rule, in the order in which `_tried` returns it; k and reference_cell come first.
SPACES: dict[str, dict[str, tuple[float, ...]]] = {
    "calibrated": {"k": K, "reference_cell": REFERENCE, "gamma": GAMMA, "power": POWER},
    "coalition": {"k": K, "reference_cell": REFERENCE, "gate": GATE, "independence": INDEPENDENCE},
}


@dataclass(frozen=True)
class Trials:
    """What all candidates of a rule scored: sums over the cases of each run, (runs, candidates), and the cases (runs,)."""

    rule: str
    log_scores: Array
    covered: Array
    cases: Array

    def merge(self, other: Trials) -> Trials:
        pairs = ((self.log_scores, other.log_scores), (self.covered, other.covered), (self.cases, other.cases))
        return Trials(self.rule, *(np.concatenate(pair) for pair in pairs))


def candidates(rule: str, cell: float = 1.0) -> list[RuleSection]:
    """All settings of a rule that are tried, on a grid whose cells have this edge."""
    names = SPACES[rule]
    settings = (dict(zip(names, values, strict=True)) for values in itertools.product(*names.values()))
    return [RuleSection(**{**s, "rule": rule, "reference_cell": s["reference_cell"] * cell}) for s in settings]  # type: ignore[arg-type]


def try_all(rule: str, runs: Sequence[Run]) -> Trials:
    """Score every candidate on every case of some runs, at least one case each."""
    log_scores, covered = [], []
    for run in runs:
        found = np.array([_scores(rule, case) for case in run])  # (cases, candidates, 2)
        log_scores.append(found[..., 0].sum(axis=0))
        covered.append((found[..., 1] < 0.95).sum(axis=0))
    return Trials(rule, np.array(log_scores), np.array(covered), np.array([float(len(run)) for run in runs]))


def choose(trials: Trials, coverage: float, cell: float, chance: np.random.Generator) -> dict[str, Any]:
    """The candidate with the highest log score of those whose 95 % regions hold the truth in at least a share of `coverage`.

    With its parameters' 95 % intervals: the spread of the choice when the runs are drawn anew. `honest` is False where no
    candidate is; then the one that covers most is chosen.
    """
    every = np.ones((1, len(trials.cases)))
    settings = candidates(trials.rule, cell)
    chosen = settings[_chosen(trials, every, coverage)[0]]
    drawn = [settings[i] for i in _chosen(trials, resamples(len(trials.cases), chance), coverage)]
    intervals = {}
    for name in SPACES[trials.rule]:
        values = np.array([getattr(setting, name) for setting in drawn])
        low, high = np.quantile(values, (0.025, 0.975), method="nearest")
        intervals[name] = {"value": getattr(chosen, name), "low": float(low), "high": float(high)}
    i = settings.index(chosen)
    share = float(trials.covered[:, i].sum() / trials.cases.sum())
    return {
        "setting": chosen,
        "parameters": intervals,
        "log_score": float(trials.log_scores[:, i].sum() / trials.cases.sum()),
        "coverage_95": share,
        "honest": share >= coverage,
    }


def board_table(rule: RuleSection) -> str:
    """A setting as a [board] table."""
    told = {"rule": rule.rule, **in_force(rule)}
    return "\n".join(["[board]", *(f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v:g}" for k, v in told.items())])


def enough(gains: Sequence[float], least: float) -> int:
    """The size of a team after which no further robot gains `least`; gains[0] is what the second one gains."""
    return 1 + max((n for n, gain in enumerate(gains, start=1) if gain >= least), default=0)


def _chosen(trials: Trials, counts: Array, coverage: float) -> Array:
    """The best candidate for each row of counts (resamples, runs)."""
    cases = (counts @ trials.cases)[:, None]
    log_scores, shares = counts @ trials.log_scores / cases, counts @ trials.covered / cases
    honest = np.where(shares >= coverage, log_scores, -np.inf)
    some = np.isfinite(honest.max(axis=1))
    return np.asarray(np.where(some, honest.argmax(axis=1), shares.argmax(axis=1)))


# --- every candidate of a rule on one case -----------------------------------------------------------------------------


def _scores(rule: str, case: Case) -> Array:
    """The log score and the level of the truth for each candidate, shape (candidates, 2)."""
    index = case.grid.index(case.truth)
    found = []
    for beliefs in _beliefs(rule, case):  # (some candidates, cells), each with sum 1
        if index is None:
            found += [(np.log(LEAST_PROBABILITY), 1.0)] * len(beliefs)
            continue
        true = beliefs[:, np.ravel_multi_index(index, case.grid.shape)]
        levels = np.where(beliefs > true[:, None], beliefs, 0.0).sum(axis=1)
        found += list(zip(np.log(np.maximum(true, LEAST_PROBABILITY)), levels, strict=True))
    return np.array(found)


def _beliefs(rule: str, case: Case) -> Iterator[Array]:
    """The fused beliefs of all candidates in their order, those that differ in the last parameter together."""
    n = len(case.opinions)
    space = list(SPACES[rule].values())
    for k, edge in itertools.product(*space[:2]):
        ratio = edge**case.grid.ndim
        weights = entropy_weights(case.opinions, k, cell_ratio=ratio)
        if rule == "calibrated":
            logs = log_components(case.opinions, weights, ratio)
            for gamma in GAMMA:
                cop = np.logaddexp.reduce(logs / alphas(n, gamma)[:, None], axis=0)
                yield _normalised(np.multiply.outer(POWER, cop))
        else:
            for gate in GATE:
                logs, alpha = gated_components(case.opinions, weights, gate)
                yield _coalitions(logs, logs / alpha[:, None])


def _coalitions(logs: Array, terms: Array) -> Array:
    """The coalition mix for each INDEPENDENCE, from ln C_q and ln C_q^(1/alpha_q), both (N, cells)."""
    mass = np.exp(terms - terms.max()).sum(axis=1)
    mass /= mass.sum()
    mixed = np.zeros((len(INDEPENDENCE), terms.shape[1]))
    for q in np.flatnonzero(mass > 1e-9):
        mixed += mass[q] * _normalised(np.multiply.outer((q + 1.0) ** (np.array(INDEPENDENCE) - 1.0), logs[q]))
    return np.asarray(mixed / mixed.sum(axis=1, keepdims=True))


def _normalised(logs: Array) -> Array:
    """Exp of each row, with sum 1."""
    p = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(p / p.sum(axis=1, keepdims=True))
