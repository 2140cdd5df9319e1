"""Why a team believes what it believes about a subject: what each source gave, and what would be without it. Pure.

The consensus of a moment is fused again from the reports of that moment, once as it was and once without each source, both with
the parameters and the powers that the board published; how far the first is from what was published (`recomputed`, nats) says
how far the rest may be trusted. A belief of the joint is a marginal of one Gaussian of the whole team. There no source has a
weight, so only who was used and who was not is shown.
"""

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from blackboard.board.fusion import fuse_opinions
from blackboard.board.learning import LEAST_POWER
from blackboard.config import BoardSection
from blackboard.errors import OpinionError, Refused, UserError
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion
from blackboard.state.moments import About, Moment, Point, scored
from blackboard.state.received import REGION, Received, read
from blackboard.state.team import TeamFold
from blackboard.wire.gaussians import pose_of, velocity_of
from blackboard.wire.messages import Consensus, PackedBelief, Report, Used
from blackboard.wire.opinions import reported, settled

JOINT = "joint"
AS_TOLD = ("level", "sub_team", "board", "tick", "rule", "parameters", "outcome", "entropy")  # of a consensus

Table = dict[str, Any]


def explain(team: TeamFold, moment: Moment, subject: str, drift: float = 1.0) -> Table:
    """All that can be said about the beliefs about a subject at a moment, as one JSON object.

    `blackboard.view.words` says it in sentences. drift: the boards' `[board] drift`, unit per square root of a second, by which old
    reports spread. UserError: no board has a belief about the subject.
    """
    about, absent = moment.subjects.get(subject), _absent(team, moment, subject)
    if about is None or about.best is None:
        if absent is not None:
            raise UserError(f"{subject}: no board has a belief about it in tick {moment.tick}; {_since(absent)}")
        known = sorted(name for name, about in moment.subjects.items() if about.best is not None)
        near = get_close_matches(subject, known, 1) or [name for name in known if name.split("/")[1] == subject]
        meant = f"; did you mean {near[0]}?" if near else ""
        raise UserError(
            f"{subject}: no board has a belief about it in tick {moment.tick}; "
            f"known are {', '.join(known) or 'none'}{meant}"
        )
    best = about.best.message
    here = {name: received.message for name, received in about.agreed.items() if received.message.tick == best.tick}
    chosen = [about.best, *(about.consensus[name] for name in sorted(about.consensus) if about.agreed)]
    return {
        "team": team.name,
        "run": moment.run,
        "tick": moment.tick,
        "time": moment.time,
        "subject": subject,
        "unit": best.belief.grid.unit,
        "absent": absent,
        "truth": None if about.truth is None else list(about.truth),
        "agreed_by": sorted(here),
        "agreed_before": {
            name: received.message.tick for name, received in sorted(about.agreed.items()) if name not in here
        },
        "same": len({consensus.belief.data for consensus in here.values()}) <= 1,
        "levels": [_level(told, about, moment, _feedback(team, told.message.board), drift) for told in chosen],
    }


def _absent(team: TeamFold, moment: Moment, subject: str) -> Table | None:
    """Of a robot that was silent, gone or never heard at a moment: for how long, and when it was believed last."""
    kind, _, name = subject.partition("/")
    process = team.processes.get((kind, name)) if kind == "robot" else None
    if process is None:
        return None
    state, seconds = process.state(moment.at)
    if state == "alive" or (seconds is not None and seconds <= 0):
        return None
    believed = process.believed if process.believed is not None and process.believed[0] <= moment.tick else None
    return {"name": name, "state": state, "for": seconds, "believed": believed}


def away(absent: Table) -> str:
    """Who is absent, and for how long, in words."""
    if absent["for"] is None:
        return f"{absent['name']} was never heard"
    return f"{absent['name']} is {absent['state']}, for {absent['for']:.0f} s"


def _since(absent: Table) -> str:
    """Why nothing is believed about who is absent: for how long it is, and when that was believed last."""
    if absent["believed"] is None:
        return away(absent)
    tick, time = absent["believed"]
    return f"{away(absent)}, and was believed last in tick {tick} ({time:.1f} s)"


def _feedback(team: TeamFold, board: str) -> str:
    process = team.processes.get(("board", board))
    status = None if process is None else process.status
    return "guarded" if status is None else str(status.settings.get("feedback", "guarded"))


def _level(told: Received[Consensus], about: About, moment: Moment, feedback: str, drift: float) -> Table:
    """One consensus: its belief, its sources, and what it would be without each."""
    consensus = told.message
    drawn, pose, velocity = told.drawn, pose_of(consensus.state), velocity_of(consensus.velocity)
    level: Table = {
        **{name: getattr(consensus, name) for name in AS_TOLD},
        "mean": None if drawn is None else list(drawn.mean),
        "sigma": None if drawn is None else drawn.sigma,
        "area": None if drawn is None else drawn.area,
        "heading": None if pose is None else float(pose.mean[HEADING]),
        "heading_sigma": None if pose is None else float(pose.covariance[HEADING, HEADING]) ** 0.5,
        "lost": consensus.lost,
        "velocity": None if velocity is None else velocity.mean.tolist(),
        "velocity_sigma": None if velocity is None else np.sqrt(np.diag(velocity.covariance)).tolist(),
        "conflict": consensus.conflict,
        "components": list(consensus.components),
        "ancestors": {name: consensus.time - until for name, until in consensus.ancestors.items()},  # seconds old
        "sources": [_source(used, _message(consensus, used.source, about)) for used in consensus.used],
        "left_out": [{"source": out.source, "reason": out.reason} for out in consensus.left_out],
        "learned": [one.model_dump(exclude={"level"}) for one in consensus.learned],
        "dissent": [
            {**one.model_dump(exclude={"level"}), "for": max(0.0, consensus.time - one.since)}
            for one in consensus.dissent
        ],
        "unnamed": [one.model_dump() for one in consensus.unnamed],
        "existence": consensus.existence,
        "camps": [{"sources": list(camp.sources), "weight": camp.weight} for camp in consensus.camps],
        "truth": None if about.truth is None else _truth(consensus.belief, about.truth),
        "recomputed": None,
        "without": {},
    }
    if consensus.rule != JOINT:
        level["recomputed"], level["without"] = _without(consensus, about, moment, feedback, drift)
    return level


def _truth(belief: PackedBelief, truth: Point) -> Table | None:
    """How far a belief is from the truth; None where it is no belief on two axes."""
    score = scored(belief, truth)
    if score is None:
        return None
    kept = {name: getattr(score, name) for name in ("error", "log_score", "denser")}
    return {**kept, "inside": score.denser < REGION}


def _message(consensus: Consensus, source: str, about: About) -> Report | Consensus | None:
    """What a source gave to a consensus: of a robot its report, of a sub-team its consensus; None where that was not seen here."""
    told = about.consensus.get(source) if consensus.level == "agreed" else about.reports.get(source)
    return None if told is None else told.message


def _source(used: Used, message: Report | Consensus | None) -> Table:
    """A source: its part in the fusion, and whose information came with it."""
    inner = message.informed if isinstance(message, Report) else message
    contains = sorted(inner.ancestors) if inner is not None and used.how == "overlapping" else []
    return {
        **{name: getattr(used, name) for name in ("source", "how", "weight", "power", "age", "entropy")},
        "contains": contains,
    }


# --- what would be without a source ----------------------------------------------------------------------------------------


def _without(
    consensus: Consensus, about: About, moment: Moment, feedback: str, drift: float
) -> tuple[float | None, dict[str, Table]]:
    """How far the recomputed consensus is from the published one (nats), and for each source what is without it.

    None where it cannot be computed again: a report was not seen, the rule is not installed, or something else was published.
    """
    ages = {used.source: used.age for used in consensus.used}
    powers = {(used.source, str(used.how)): min(max(used.power, LEAST_POWER), 1.0) for used in consensus.used}
    given = {name: _message(consensus, name, about) for name in sorted(ages)}
    published = read(consensus.belief)
    if published is None or not given:
        return None, {}
    ageing = Ageing(drift, published.grid)
    for robot, speed in moment.speeds.items():
        ageing.learn_speed(robot, speed)

    def fused(opinions: Iterable[Sequence[Opinion]]) -> Belief:
        chosen = [one for of_source in opinions for one in of_source]
        return fuse_opinions(chosen, published.grid, settings, consensus.subject, powers=powers).belief

    try:
        settings = BoardSection.model_validate({"rule": consensus.rule, **consensus.parameters, "feedback": feedback})
        opinions = {}
        for name, message in given.items():
            if message is None:
                return None, {}
            admitted = _admitted(message, published.grid, feedback, alone=len(given) == 1)
            opinions[name] = ageing.aged(admitted, consensus.subject, ages[name])
        full, without = fused(opinions.values()), {}
        for name in opinions:
            others = [its for other, its in opinions.items() if other != name]
            without[name] = _change(full, fused(others)) if others else {}
        distance = kullback_leibler(published.p, full.p)
        return (distance, without) if math.isfinite(distance) else (None, {})
    except (OpinionError, Refused, UserError, ValueError):  # a rule that is not installed here, or other grids
        return None, {}


def _admitted(message: Report | Consensus, grid: Grid, feedback: str, *, alone: bool) -> Sequence[Opinion]:
    """The opinions of a source as a board takes them: of the only sub-team in an exchange the whole. Refused: "grid", "mass"."""
    if isinstance(message, Report):
        return reported(message, grid, feedback)
    return settled(message, grid)[-1:] if alone else settled(message, grid)


def _change(full: Belief, without: Belief) -> Table:
    """The Kullback-Leibler distance from the consensus to what it would be (nats), and how far the mean would move (unit)."""
    distance = kullback_leibler(full.p, without.p)
    return {
        "nats": distance if math.isfinite(distance) else None,  # None: what is believed now would be impossible
        "shift": float(np.linalg.norm(full.mean() - without.mean())),
    }
