"""Streams: the same sources fused again and again, so that a board can learn how far each may be believed. Pure.

Each stream is a situation: how sources err, how they claim to err, and who repeats whom. The rules see the opinions alone. The
oracle knows the true correlations and errors of the sources, and so bounds what any learner can reach.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np

from blackboard.board.fusion import as_advised
from blackboard.board.learning import Learner
from blackboard.lab.cases import GRID, MARGIN, SIGMA, TRIALS, Case
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.believed import SPACING
from blackboard.opinion.bell import width
from blackboard.opinion.cooperative import CAUTIOUS, Coalition
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import fuse
from blackboard.opinion.provenance import Opinion
from blackboard.opinion.scores import Score
from blackboard.process.columns import cell, columns

FUSIONS = 240  # of one stream


@dataclass(frozen=True)
class Sources:
    """How sources err at one instant: `correlation` (N, N) of their errors, which are `factor` (N,) times what they claim.

    bias: (N,) in cells, along a direction of each run that all share: a liar's. memory: correlation of the errors of one fusion
    with those of the fusion before. moving: cells by which the truth moves from one fusion to the next.
    """

    correlation: Array
    factor: Array
    bias: Array
    echoes: Mapping[int, int] = field(default_factory=dict)  # source -> the one that it repeats
    memory: float = 0.0
    rings: tuple[int, ...] = ()  # sources that know a distance only

    @property
    def n(self) -> int:
        return len(self.factor)


#: What the sources are at a share of the stream, 0 at its beginning and 1 at its end.
Stream = Callable[[float], Sources]


def sources(n: int, correlation: float = 0.0, factor: float = 1.0, **own: Any) -> Sources:
    """`n` equal sources, honest where nothing else is said."""
    matrix = np.full((n, n), correlation)
    np.fill_diagonal(matrix, 1.0)
    return Sources(matrix, np.full(n, factor), np.zeros(n), **own)


def _biased(n: int, biases: Mapping[int, float]) -> Sources:
    return replace(sources(n), bias=np.array([biases.get(i, 0.0) for i in range(n)]))


def _pairs(n: int, correlation: float) -> Sources:
    matrix = np.eye(n)
    for i in range(0, n, 2):
        matrix[i, i + 1] = matrix[i + 1, i] = correlation
    return replace(sources(n), correlation=matrix)


def _steady(sources: Sources) -> Stream:
    return lambda share: sources


#: The twelve streams on which the rule was chosen.
STREAMS: dict[str, Stream] = {
    "independent, 5": _steady(sources(5)),
    "independent, 8": _steady(sources(8)),
    "correlated .3, 5": _steady(sources(5, 0.3)),
    "correlated .8, 8": _steady(sources(8, 0.8)),
    "4 of 5 echo one": _steady(sources(5, echoes={1: 0, 2: 0, 3: 0})),
    "7 of 8 echo one": _steady(sources(8, echoes=dict.fromkeys(range(1, 7), 0))),
    "one liar of 5": _steady(_biased(5, {0: 12.0})),
    "two of 5 collude": _steady(_biased(5, {0: 12.0, 1: 12.0})),
    "one drifts": lambda share: _biased(5, {0: 12.0 * share}),
    "all claim half": _steady(sources(5, factor=2.0)),
    "all claim double": _steady(sources(5, factor=0.5)),
    "independent, then correlated .8": lambda share: sources(5, 0.0 if share < 0.5 else 0.8),
}
#: Others that were looked at, with other seeds, while the rule was made.
OTHERS: dict[str, Stream] = {
    "independent, 3": _steady(sources(3)),
    "correlated .5, 12": _steady(sources(12, 0.5)),
    "errors that last": _steady(sources(5, memory=0.9)),
    "two claim half": _steady(replace(sources(5), factor=np.array([2.0, 2.0, 1.0, 1.0, 1.0]))),
    "rings, 5": _steady(sources(5, rings=(0, 1, 2))),
    "one of 3 lies late": lambda share: _biased(3, {0: 0.0 if share < 0.5 else 12.0}),
}
#: Streams that were written after the rule was made, and decided nothing.
UNSEEN: dict[str, Stream] = {
    "independent, 12": _steady(sources(12)),
    "independent, 2": _steady(sources(2)),
    "correlated .6, 4": _steady(sources(4, 0.6)),
    "three pairs correlated .9": _steady(_pairs(6, 0.9)),
    "one of 6 claims a third": _steady(replace(sources(6), factor=np.array([3.0, 1.0, 1.0, 1.0, 1.0, 1.0]))),
    "two of 7 lie, one each way": _steady(_biased(7, {0: 12.0, 1: -12.0})),
    "errors that last, correlated .5": _steady(sources(5, 0.5, memory=0.8)),
}


@dataclass(frozen=True, eq=False)
class StreamInstant:
    """One fusion of a stream: the case, and the belief of an oracle that knows every source's errors; None without one."""

    case: Case
    oracle: Belief | None


def generate(stream: Stream, fusions: int, rng: np.random.Generator) -> Iterator[StreamInstant]:
    """The instants of a stream, a second apart; the truth is drawn anew each time, the sources' sigmas too."""
    angle = rng.uniform(0, 2 * math.pi)
    away = np.array([math.cos(angle), math.sin(angle)])
    errors: Array | None = None
    for number in range(fusions):
        sources = stream(number / max(1, fusions - 1))
        truth = np.array([rng.uniform(MARGIN, n - MARGIN) for n in GRID.shape])
        sigmas = rng.uniform(*SIGMA, sources.n)
        fresh = _root(sources.correlation) @ rng.standard_normal((sources.n, 2))  # errors in sigmas
        if errors is not None and len(errors) == sources.n:
            fresh = sources.memory * errors + math.sqrt(1 - sources.memory**2) * fresh
        errors = fresh
        means = truth + (sigmas * sources.factor)[:, None] * errors + sources.bias[:, None] * away
        for source, origin in sources.echoes.items():
            means[source], sigmas[source] = means[origin], sigmas[origin]
        means = np.clip(means, 0.0, GRID.shape)
        ps = np.stack([_opinion(sources, i, means[i], float(sigmas[i]), truth) for i in range(sources.n)])
        names = tuple(f"s{i + 1}" for i in range(sources.n))
        case = Case(GRID, "object/target", number * SPACING, names, ps, (*truth.tolist(),))
        yield StreamInstant(case, _oracle(sources, ps, means, sigmas))


def trial_stream(name: str, fusions: int, rng: np.random.Generator) -> Iterator[StreamInstant]:
    """One of the five trials, again and again; without an oracle."""
    for number in range(fusions):
        yield StreamInstant(replace(TRIALS[name](rng), time=number * SPACING), None)


def _opinion(sources: Sources, source: int, mean: Array, sigma: float, truth: Array) -> Array:
    """A Gaussian about the mean; of a ring, what a distance to a station says, as far off as the Gaussian is along that line."""
    if source not in sources.rings:
        return gaussian(GRID, mean.tolist(), sigma).p
    station = _station(source)
    line = (truth - station) / np.linalg.norm(truth - station)
    distance = float(np.linalg.norm(truth - station) + (mean - truth) @ line)
    x, y = GRID.mesh()
    p = np.exp(-0.5 * ((np.hypot(x - station[0], y - station[1]) - distance) / sigma) ** 2)
    return np.asarray(p / p.sum())


def _station(source: int) -> Array:
    angle = 2.1 * source
    return np.array(GRID.shape) / 2 + 24.0 * np.array([math.cos(angle), math.sin(angle)])


def _oracle(sources: Sources, ps: Array, means: Array, sigmas: Array) -> Belief:
    """The best linear combination of the honest sources' means by their true covariance; the product where there are rings."""
    honest = [i for i in range(sources.n) if sources.bias[i] == 0 and i not in sources.echoes]
    if sources.rings:
        logs = np.log(np.maximum(ps[honest], 1e-300)).sum(axis=0)
        p = np.exp(logs - logs.max())
        return Belief(GRID, np.asarray(p / p.sum()))
    scale = (sigmas * sources.factor)[honest]
    covariance = sources.correlation[np.ix_(honest, honest)] * np.outer(scale, scale)
    information = np.linalg.solve(covariance, np.ones(len(honest)))
    mean = np.clip(information @ means[honest] / information.sum(), 0.0, GRID.shape)
    return gaussian(GRID, mean.tolist(), 1.0 / math.sqrt(information.sum()))


def _root(correlation: Array) -> Array:
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


# --- judging -------------------------------------------------------------------------------------------------------------

RULES = {"independence 0.2": Coalition(independence=CAUTIOUS), "independence 1": Coalition(independence=1.0)}
LEARNED, ORACLE = "learned", "oracle"
NAMES = (*STREAMS, *OTHERS, *UNSEEN, *(f"trial {name}" for name in TRIALS))


def instants(name: str, fusions: int, rng: np.random.Generator) -> Iterator[StreamInstant]:
    if name.startswith("trial "):
        return trial_stream(name.removeprefix("trial "), fusions, rng)
    return generate({**STREAMS, **OTHERS, **UNSEEN}[name], fusions, rng)


def judge(name: str, fusions: int, rng: np.random.Generator) -> dict[str, Score]:
    """The scores of each rule over one run of a stream, that of `learned` by a board that learns from it; empty without an oracle."""
    scores = {rule: Score() for rule in (*RULES, LEARNED, ORACLE)}
    learner, rule = Learner("consensus"), Coalition(independence="learn")
    for instant in instants(name, fusions, rng):
        case = instant.case
        for label, fixed in RULES.items():
            scores[label].add(Belief(case.grid, fuse(fixed, case.opinions, case.grid).p), case.truth)
        opinions = [
            Opinion(source, Belief(case.grid, p), {source: case.time})
            for source, p in zip(case.sources, case.opinions, strict=True)
        ]
        learner.compare_opinions(case.subject, case.time, opinions)
        advice = learner.advice(case.sources, [width(opinion.belief) for opinion in opinions])
        pooled = fuse(*as_advised(rule, case.opinions, advice), case.grid)
        scores[LEARNED].add(Belief(case.grid, pooled.p), case.truth)
        if instant.oracle is not None:
            scores[ORACLE].add(instant.oracle, case.truth)
    return scores


def jobs(runs: int, rng: np.random.Generator) -> list[tuple[str, int, np.random.Generator]]:
    """The jobs for `judge`: each stream a number of times, every run with random numbers of its own."""
    own = rng.spawn(runs * len(NAMES))
    return [(name, FUSIONS, own[i * runs + run]) for i, name in enumerate(NAMES) for run in range(runs)]


def report(names: Sequence[str], parts: Sequence[dict[str, Score]]) -> dict[str, Any]:
    """Stream -> rule -> log score in nats, coverage, and its gap to the oracle in nats; and the mean gap of each rule.

    `names` has the stream of each part.
    """
    table: dict[str, Any] = {}
    for name in dict.fromkeys(names):
        runs = [part for other, part in zip(names, parts, strict=True) if other == name]
        rows = {}
        for rule in runs[0]:
            merged = reduce(Score.merge, (run[rule] for run in runs))
            if merged.errors:
                summary = merged.summary()
                rows[rule] = {"log_score": summary["log_score"], "coverage": summary["coverage"]}
        if ORACLE in rows:
            for row in rows.values():
                row["gap"] = rows[ORACLE]["log_score"] - row["log_score"]
        table[name] = {"runs": len(runs), "rules": rows}
    told = [stream["rules"] for stream in table.values() if ORACLE in stream["rules"]]
    gaps = {rule: float(np.mean([rows[rule]["gap"] for rows in told])) for rule in (*RULES, LEARNED)} if told else {}
    return {"fusions": FUSIONS, "streams": table, "mean_gap": gaps}


def text(report: Mapping[str, Any]) -> str:
    """The report as text, one line for each stream: log score / 95 % coverage / 50 % coverage of each rule."""
    rules = (*RULES, LEARNED, ORACLE)
    rows = [(name, *(_cell(case["rules"].get(rule)) for rule in rules)) for name, case in report["streams"].items()]
    gaps = (cell(report["mean_gap"].get(rule), "{:.3f}") for rule in rules)
    table = [("", *rules), *rows, ("mean gap to the oracle, nats", *gaps)]
    under = f"log score / 95 % / 50 % coverage, {report['fusions']} fusions a run"
    return "\n".join([*columns(table, numbers=range(1, 1 + len(rules))), under])


def _cell(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return "-"
    return f"{row['log_score']:.2f} / {row['coverage']['95']:.2f} / {row['coverage']['50']:.2f}"
