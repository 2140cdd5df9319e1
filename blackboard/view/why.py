"""Why a team believes what it believes about a subject: what each source gave, and what would be without it. Pure.

The consensus of a moment is fused again from the reports of that moment, once as it was and once without each source, both with the
parameters and the powers that the board published; how far the first is from what was published (`recomputed`, nats) says how far
the rest may be trusted. A belief of the joint is a marginal of one
Gaussian of the whole team: there nobody has a weight of his own, and it is said who was used and who was not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from blackboard.board.fusion import Powers, fuse_opinions
from blackboard.board.learning import LEAST_POWER
from blackboard.board.provenance import Opinion
from blackboard.config import BoardSection
from blackboard.errors import OpinionError, UserError
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Grid
from blackboard.state.fold import TeamFold
from blackboard.state.moments import About, Moment, scored
from blackboard.state.told import REGION, Told, read
from blackboard.wire.arrays import unpacked_grid
from blackboard.wire.messages import Consensus, PackedBelief, Used

JOINT = "joint"

Table = dict[str, Any]


def explain(team: TeamFold, moment: Moment, subject: str, drift: float = 1.0) -> Table:
    """All that can be said about the beliefs about a subject at a moment, as one JSON object.

    `blackboard.view.words` says it in sentences. drift: the boards' `[board] drift`, unit per square root of a second, by which old
    reports spread. UserError: no board has a belief about the subject.
    """
    about = moment.subjects.get(subject)
    if about is None or about.best is None:
        known = ", ".join(sorted(name for name, it in moment.subjects.items() if it.best is not None))
        raise UserError(f"{subject}: no board has a belief about it in tick {moment.tick}; known are {known or 'none'}")
    feedback = {
        board.status.process: str(board.status.settings.get("feedback", "guarded"))
        for board in team.processes.values()
        if board.status is not None and board.kind == "board"
    }
    grid = about.best.message.belief.grid
    levels = [_level(about.best, about, bool(about.agreed), feedback, drift)]
    if about.agreed:
        levels += [_level(about.consensus[name], about, False, feedback, drift) for name in sorted(about.consensus)]
    return {
        "team": team.name,
        "run": moment.run,
        "tick": moment.tick,
        "time": moment.time,
        "subject": subject,
        "unit": grid.unit,
        "truth": None if about.truth is None else list(about.truth),
        "agreed_by": sorted(about.agreed),
        "same": len({it.message.belief.data for it in about.agreed.values()}) <= 1,
        "levels": levels,
    }


def _level(told: Told[Consensus], about: About, agreed: bool, feedback: dict[str, str], drift: float) -> Table:
    """One consensus: its belief, its sources, and what it would be without each."""
    it = told.message
    drawn = told.drawn
    score = None if about.truth is None else scored(it.belief, about.truth)
    found: Table = {
        "level": it.level,
        "sub_team": it.sub_team,
        "board": it.board,
        "tick": it.tick,
        "rule": it.rule,
        "parameters": it.parameters,
        "outcome": it.outcome,
        "entropy": it.entropy,
        "mean": None if drawn is None else list(drawn.mean),
        "sigma": None if drawn is None else drawn.sigma,
        "area": None if drawn is None else drawn.area,
        "conflict": it.conflict,
        "components": list(it.components),
        "ancestors": {name: it.time - until for name, until in it.ancestors.items()},  # seconds old
        "sources": [_source(used, about, agreed) for used in it.used],
        "left_out": [{"source": out.source, "reason": out.reason} for out in it.left_out],
        "learned": [one.model_dump(exclude={"level"}) for one in it.learned],
        "dissent": [{**one.model_dump(exclude={"level"}), "for": max(0.0, it.time - one.since)} for one in it.dissent],
        "camps": [{"sources": list(camp.sources), "weight": camp.weight} for camp in it.camps],
        "truth": None
        if score is None
        else {
            "error": score.error,
            "log_score": score.log_score,
            "denser": score.denser,
            "inside": score.denser < REGION,
        },
        "recomputed": None,
        "without": {},
    }
    if it.rule != JOINT:
        found["recomputed"], found["without"] = _without(it, about, agreed, feedback.get(it.board, "guarded"), drift)
    return found


def _source(used: Used, about: About, agreed: bool) -> Table:
    """A source: its part in the fusion, and whose information came with it."""
    told = about.consensus.get(used.source) if agreed else about.reports.get(used.source)
    own: Table = {"source": used.source, "how": used.how, "weight": used.weight, "power": used.power, "age": used.age}
    contains: Sequence[str] = ()
    if told is not None:
        message = told.message
        if used.how == "overlapping":
            inner = message.ancestors if isinstance(message, Consensus) else {}
            informed = None if isinstance(message, Consensus) else message.informed
            contains = sorted(informed.ancestors if informed is not None else inner)
    return {**own, "entropy": used.entropy, "contains": list(contains)}


# --- what would be without a source ----------------------------------------------------------------------------------------


def _without(
    it: Consensus, about: About, agreed: bool, feedback: str, drift: float
) -> tuple[float | None, dict[str, Table]]:
    """How far the recomputed consensus is from the published one (nats), and for each source what is without it.

    None where it cannot be computed again: a report was not seen here, or the rule is not installed here.
    """
    published = read(it.belief)
    ages = {used.source: used.age for used in it.used}
    powers = {(used.source, str(used.how)): min(max(used.power, LEAST_POWER), 1.0) for used in it.used}
    opinions = {name: _opinions(name, ages[name], it, about, agreed, feedback, drift) for name in sorted(ages)}
    if published is None or not opinions or not all(opinions.values()):
        return None, {}
    try:
        settings = BoardSection.model_validate({"rule": it.rule, **it.parameters, "feedback": feedback})
        fused = partial(
            _fused, opinions=opinions, grid=published.grid, settings=settings, subject=it.subject, powers=powers
        )
        full = fused(list(opinions))
        found = {}
        for name in opinions:
            others = [other for other in opinions if other != name]
            found[name] = _change(full, fused(others)) if others else {}
        return kullback_leibler(published.p, full.p), found
    except (OpinionError, UserError, ValueError):  # a rule that is not installed here, or opinions on different grids
        return None, {}


def _opinions(
    name: str, age: float, it: Consensus, about: About, agreed: bool, feedback: str, drift: float
) -> list[Opinion]:
    """The opinions of a source as its board had them (`Board.hear`, `hear_consensus`, `_admitted`); none where they were not seen."""
    packed: list[tuple[PackedBelief, dict[str, float]]] = []
    whole = False
    if agreed:
        consensus = about.consensus.get(name)
        if consensus is not None:
            message = consensus.message
            packed = [(message.belief, message.ancestors)]
            part = message.firsthand
            whole = part is not None  # as in `Board.hear_consensus`
            if part is not None and part.ancestors and len({used.source for used in it.used}) > 1:
                packed.insert(0, (part.belief, part.ancestors))
    elif name in about.reports:
        report = about.reports[name].message
        packed = [(report.belief, report.ancestors or {name: report.time})]
        if report.informed is not None:
            packed.append((report.informed.belief, report.informed.ancestors))
        packed = {"paper": packed[-1:], "off": packed[:1]}.get(feedback, packed)
    grid = it.belief.grid
    beliefs = [(read(one, unpacked_grid(grid)), ancestors) for one, ancestors in packed]
    sigma = drift * math.sqrt(max(0.0, age)) / grid.cell
    return [
        Opinion(name, Belief(belief.grid, blur(belief.p, sigma)), ancestors, age, whole and number == len(beliefs) - 1)
        for number, (belief, ancestors) in enumerate(beliefs)
        if belief is not None
    ]


def _fused(
    names: Sequence[str],
    opinions: dict[str, list[Opinion]],
    grid: Grid,
    settings: BoardSection,
    subject: str,
    powers: Powers,
) -> Belief:
    """The opinions of these sources, pooled with the parameters and to the powers that the board published."""
    found = fuse_opinions([one for name in names for one in opinions[name]], grid, settings, subject, powers=powers)
    return found.belief


def _change(full: Belief, without: Belief) -> Table:
    """The Kullback-Leibler distance from the consensus to what it would be (nats), and how far the mean would move (unit)."""
    distance = kullback_leibler(full.p, without.p)
    return {
        "nats": distance if math.isfinite(distance) else None,  # None: what is believed now would be impossible
        "shift": float(np.linalg.norm(full.mean() - without.mean())),
    }
