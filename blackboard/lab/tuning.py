"""Choosing a rule's parameters: the highest log score of those settings whose 95 % regions hold the truth often enough. Pure.

Every candidate of a rule is tried on every case. The components of COP are made once for each weight exponent k and
reference cell; all other parameters only weigh and power them (`tests/lab` holds this against the pools themselves). Rules of
plug-ins, which may do anything, simply pool once for each candidate.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blackboard.errors import UserError
from blackboard.judge.intervals import FEWEST, Estimate, resamples
from blackboard.lab.cases import Case, Run
from blackboard.opinion.components import alphas, log_components, relative_to_peak, triangular_alphas
from blackboard.opinion.cooperative import Calibrated, Coalition
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import POOLS, fuse_belief
from blackboard.opinion.rules import Rule, find, read_rule
from blackboard.opinion.scores import LEAST_PROBABILITY, held
from blackboard.opinion.weights import entropy_weights

K = (0.0, 1.0, 2.0)
REFERENCE = (0.25, 0.5, 1.0, 2.0)  # edge of the reference cell, in cells

Space = dict[str, tuple[float, ...]]


def _tried(rule: type[Rule]) -> Space:
    """The values that a rule's parameters say are worth trying (`rules.parameter`)."""
    fields = dataclasses.fields(rule)  # type: ignore[arg-type]  # every rule is a dataclass
    return {field.name: field.metadata["tried"] for field in fields if field.metadata.get("tried")}


#: What is tuned of the rules that come with the package, in the order of `_beliefs`: k and reference_cell come first.
SPACES: dict[str, Space] = {
    rule.name: {"k": K, "reference_cell": REFERENCE, **_tried(rule)} for rule in (Calibrated, Coalition)
}


def spaces() -> dict[str, Space]:
    """What is tuned of each rule of the package, and of plug-ins whose parameters have values to try."""
    others = {name: _tried(find(name)) for name in POOLS if name not in SPACES}
    return {**SPACES, **{name: space for name, space in others.items() if space}}


def space(rule: str) -> Space:
    """What is tuned of a rule; UserError where nothing is."""
    known = spaces()
    if rule not in known:
        raise UserError(f"--rule {rule}: nothing to tune; rules with parameters that are tried are {', '.join(known)}")
    return known[rule]


@dataclass(frozen=True)
class CandidateScores:
    """What all candidates of a rule scored: sums over the cases of each run, (runs, candidates), and the cases (runs,)."""

    rule: str
    log_scores: Array
    covered: Array
    cases: Array

    def merge(self, other: CandidateScores) -> CandidateScores:
        pairs = ((self.log_scores, other.log_scores), (self.covered, other.covered), (self.cases, other.cases))
        return CandidateScores(self.rule, *(np.concatenate(pair) for pair in pairs))


def candidates(rule: str, cell: float = 1.0) -> list[Rule]:
    """All settings of a rule that are tried, on a grid whose cells have this edge."""
    known = space(rule)
    if "reference_cell" in known:
        known = {**known, "reference_cell": tuple(edge * cell for edge in known["reference_cell"])}
    settings = (dict(zip(known, values, strict=True)) for values in itertools.product(*known.values()))
    return [read_rule({"rule": rule, **setting}) for setting in settings]


def try_all(rule: str, runs: Sequence[Run]) -> CandidateScores:
    """Score every candidate on every case of some runs, at least one case each."""
    log_scores, covered = [], []
    for run in runs:
        scores = np.array([_scores(rule, case) for case in run])  # (cases, candidates, 2)
        log_scores.append(scores[..., 0].sum(axis=0))
        covered.append(scores[..., 1].sum(axis=0))
    return CandidateScores(rule, np.array(log_scores), np.array(covered), np.array([float(len(run)) for run in runs]))


def choose(scores: CandidateScores, coverage: float, cell: float, rng: np.random.Generator) -> dict[str, Any]:
    """The candidate with the highest log score of those whose 95 % regions hold the truth in at least a share of `coverage`.

    With its parameters' spreads: where 95 % of the choices lie when the runs are drawn anew; None of fewer than FEWEST runs. It
    is no confidence interval: with few runs it is too narrow. `honest` is False where no candidate covers so much; then the one
    that covers most is chosen.
    """
    every = np.ones((1, len(scores.cases)))
    settings = candidates(scores.rule, cell)
    chosen = settings[_chosen(scores, every, coverage)[0]]
    drawn = [settings[i] for i in _chosen(scores, resamples(len(scores.cases), rng), coverage)]
    intervals = {}
    for name in space(scores.rule):
        values = np.array([getattr(setting, name) for setting in drawn])
        low, high = (float(v) for v in np.quantile(values, (0.025, 0.975), method="nearest"))
        few = len(scores.cases) < FEWEST
        intervals[name] = {"value": getattr(chosen, name), "low": None if few else low, "high": None if few else high}
    i = settings.index(chosen)
    share = float(scores.covered[:, i].sum() / scores.cases.sum())
    return {
        "setting": chosen,
        "parameters": intervals,
        "log_score": float(scores.log_scores[:, i].sum() / scores.cases.sum()),
        "coverage_95": share,
        "honest": share >= coverage,
    }


def recommended(gain: Estimate, honest: bool) -> tuple[str, str]:
    """What to recommend, "tuned" or "default", and why: the choice must beat the default on runs that it was not chosen from.

    `gain` is how much higher the log score of the choice is there; `honest` whether it covered what was asked where it was chosen.
    """
    if not honest:
        return "default", "no setting covers what is asked"
    if gain.low is None:
        return "default", f"fewer than {FEWEST} held-out runs cannot tell whether the choice is better"
    if not gain.is_above(0.0):
        return "default", "the choice does not beat it on the held-out runs"
    return "tuned", "the choice beats the default on the held-out runs"


def board_table(rule: Rule) -> str:
    """A setting as a [board] table."""
    values = rule.in_force().items()
    return "\n".join(["[board]", *(f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v:g}" for k, v in values)])


def enough(gains: Sequence[float], least: float) -> int:
    """The size of a team after which no further robot gains `least`; gains[0] is what the second one gains."""
    return 1 + max((n for n, gain in enumerate(gains, start=1) if gain >= least), default=0)


def _chosen(scores: CandidateScores, counts: Array, coverage: float) -> Array:
    """The best candidate for each row of counts (resamples, runs)."""
    cases = (counts @ scores.cases)[:, None]
    log_scores, shares = counts @ scores.log_scores / cases, counts @ scores.covered / cases
    honest = np.where(shares >= coverage, log_scores, -np.inf)
    some = np.isfinite(honest.max(axis=1))
    return np.asarray(np.where(some, honest.argmax(axis=1), shares.argmax(axis=1)))


# --- every candidate of a rule on one case -----------------------------------------------------------------------------


def _scores(rule: str, case: Case) -> Array:
    """The log score, and how far the 95 % region holds the truth, for each candidate, shape (candidates, 2)."""
    index = case.grid.index(case.truth)
    scores = []
    for beliefs in _beliefs(rule, case):  # (some candidates, cells), each with sum 1
        if index is None:
            scores += [(np.log(LEAST_PROBABILITY), 0.0)] * len(beliefs)
            continue
        true = beliefs[:, np.ravel_multi_index(index, case.grid.shape)]
        levels = np.where(beliefs > true[:, None], beliefs, 0.0).sum(axis=1)
        borders = np.where(beliefs == true[:, None], beliefs, 0.0).sum(axis=1)
        scores += list(zip(np.log(np.maximum(true, LEAST_PROBABILITY)), held(levels, borders, 0.95), strict=True))
    return np.array(scores)


def _beliefs(rule: str, case: Case) -> Iterator[Array]:
    """The fused beliefs of all candidates in their order, those that differ in the last parameter together."""
    if rule not in SPACES:
        for candidate in candidates(rule, case.grid.cell):
            yield fuse_belief(candidate, case.opinions, case.grid).reshape(1, -1)
        return
    n = len(case.opinions)
    for k, edge in itertools.product(K, REFERENCE):
        ratio = edge**case.grid.ndim
        weights = entropy_weights(case.opinions, k, cell_ratio=ratio)
        if rule == "calibrated":
            logs = log_components(case.opinions, weights, ratio)
            for gamma in SPACES[rule]["gamma"]:
                cop = np.logaddexp.reduce(logs / alphas(n, gamma)[:, None], axis=0)
                yield _normalised(np.multiply.outer(SPACES[rule]["power"], cop))
        else:
            for gate in SPACES[rule]["gate"]:
                logs = log_components(relative_to_peak(case.opinions, gate), weights)
                yield _coalitions(logs, logs / triangular_alphas(n)[:, None], SPACES[rule]["independence"])


def _coalitions(logs: Array, terms: Array, independence: Sequence[float]) -> Array:
    """The coalition mix for each value of independence, from ln C_q and ln C_q^(1/alpha_q), both (N, cells)."""
    mass = np.exp(terms - terms.max()).sum(axis=1)
    mass /= mass.sum()
    mixed = np.zeros((len(independence), terms.shape[1]))
    for q in np.flatnonzero(mass > 1e-9):
        mixed += mass[q] * _normalised(np.multiply.outer((q + 1.0) ** (np.array(independence) - 1.0), logs[q]))
    return np.asarray(mixed / mixed.sum(axis=1, keepdims=True))


def _normalised(logs: Array) -> Array:
    """Exp of each row, with sum 1."""
    p = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(p / p.sum(axis=1, keepdims=True))
