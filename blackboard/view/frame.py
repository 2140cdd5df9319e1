"""A frame of the live page: one settled tick as bytes, a JSON header and a byte for each cell that is drawn. Pure.

    4 bytes   length of the header, little-endian
    header    JSON, UTF-8
    rest      the levels of all beliefs, one box after the other, C order; `blackboard.state.received.Drawn` says what a level means

The beliefs stand in the header in the order of their bytes; each takes box[0] * box[1] of them.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from blackboard.opinion.gaussian.priors import found_in
from blackboard.opinion.gaussian.vehicle import AXES, HEADING
from blackboard.opinion.grid import Grid
from blackboard.state.moments import About, Moment
from blackboard.state.received import REGION, STEP, Drawn, Received
from blackboard.state.team import Event, TeamFold
from blackboard.view.summary import alarms, processes
from blackboard.wire.gaussians import pose_of, velocity_of
from blackboard.wire.messages import Consensus, Report

MAX_EVENTS = 30  # and alarms
MAX_BELIEFS = 2000  # in one frame
DIGITS = 5  # significant ones; a screen has fewer

Table = dict[str, Any]


def frame(
    team: TeamFold,
    moment: Moment | None,
    number: int,
    now: float,
    chosen: str | None = None,
    shown: Sequence[Table] | None = None,
    mode: str | None = None,
) -> bytes:
    """A moment, or only the processes where nothing was settled yet; `number` counts the frames, `now` is Unix time in seconds.

    With `chosen` only that subject has all its beliefs, and every other one the belief that stands for it. `shown` are the
    processes and `mode` the pace of a moment that is over [default: as they are now].
    """
    cells: list[bytes] = []
    subjects = {}
    if moment is not None:
        for name, about in moment.subjects.items():
            subjects[name] = _subject(about, moment, cells, chosen in (None, name))
    header = {
        "frame": number,
        "team": team.name,
        "run": "" if moment is None else moment.run,
        "mode": mode or team.mode,
        "tick": None if moment is None else moment.tick,
        "time": None if moment is None else _short(moment.time),
        "at": round(now, 3),
        "grid": None if team.grid is None else _grid(team.grid),
        "step": STEP,
        "chosen": chosen,
        "subjects": subjects,
        "sightings": () if moment is None else moment.sightings,
        "processes": slim(team, now) if shown is None else shown,
        "alarms": alarms(team, now)[:MAX_EVENTS],
        "events": [
            {**vars(event), "at": round(event.at, 3), "severity": event.severity} for event in _last(team.events, now)
        ],
    }
    head = json.dumps(header, separators=(",", ":")).encode()
    return b"".join([len(head).to_bytes(4, "little"), head, *cells])


def line(moment: Moment) -> Table:
    """What charts and trails need of a moment: of each subject where it is, its truth, entropies and scores."""
    subjects = {}
    for name, about in moment.subjects.items():
        drawn = None if about.best is None else about.best.drawn
        mean = None if drawn is None else [_short(x) for x in drawn.mean]
        subjects[name] = {"mean": mean, **_numbers(about)}
    return {"run": moment.run, "tick": moment.tick, "time": _short(moment.time), "subjects": subjects}


def slim(team: TeamFold, now: float) -> list[Table]:
    """What the page shows of each process at `now`, Unix time in seconds."""
    names = ("name", "kind", "sub_teams", "state", "tick", "refused", "dropped", "late")
    return [
        {
            **{name: process[name] for name in names},
            "age": None if process["age"] is None else _short(process["age"]),
            "away": None if process["away"] is None else _short(process["away"]),
            "rate": _short(process["rate"]),
        }
        for process in processes(team, now)
    ]


def _grid(grid: Grid) -> Table:
    """A grid as the page has it: without frame and anchor where it has none."""
    known = {"shape": grid.shape, "cell": grid.cell, "origin": grid.origin, "unit": grid.unit}
    frame = {"frame": grid.frame} if grid.frame else {}
    return {**known, **frame, **({"anchor": asdict(grid.anchor)} if grid.anchor else {})}


def _last(events: Iterable[Event], now: float) -> list[Event]:
    """The last events that have happened at `now`."""
    return [event for event in events if event.at <= now][-MAX_EVENTS:]


def _numbers(about: About) -> Table:
    """The truth, the published entropy of each level, and the scores."""
    entropies = {f"consensus/{name}": _short(told.message.entropy) for name, told in about.consensus.items()}
    if about.agreed and about.best is not None:
        entropies["agreed"] = _short(about.best.message.entropy)
    return {
        "truth": None if about.truth is None else [_short(x) for x in about.truth],
        "entropy": entropies,
        "scores": {
            name: {"error": _short(score.error), "inside": score.denser < REGION, "held": _short(score.held)}
            for name, score in sorted(about.scores.items())
        },
    }


def _subject(about: About, moment: Moment, cells: list[bytes], whole: bool) -> Table:
    """A subject with all its beliefs where it is to be `whole`, else with the one that stands for it."""
    best = about.best
    beliefs: list[Table] = []
    if about.agreed and best is not None:
        beliefs.append(_belief("agreed", "", best, best.drawn, moment, cells))
    for name, told in about.consensus.items():
        if whole or (told is best and not about.agreed):
            beliefs.append(_belief("consensus", name, told, told.drawn, moment, cells))
    for name, report in about.reports.items() if whole else ():
        beliefs.append(_belief("firsthand", name, report, report.drawn, moment, cells))
        if report.message.informed is not None:
            beliefs.append(_belief("informed", name, report, report.informed, moment, cells))
    return {
        **_numbers(about),
        **_motion(best),
        "share": _short(about.share),
        "existence": None if best is None or best.message.existence is None else _short(best.message.existence),
        "unnamed": []
        if best is None
        else [
            [f"robot/{sighting.source}", _short(sighting.probability), sighting.taken]
            for sighting in best.message.unnamed
        ],
        "conflict": best is not None and best.message.conflict,
        "rule": None if best is None else best.message.rule,
        "sensors": {}
        if best is None
        else {name: _short(value) for name, value in found_in(best.message.parameters).items()},
        "left_out": [] if best is None else [[out.source, out.reason] for out in best.message.left_out],
        "dissent": []
        if best is None
        else [[named.source, named.sigmas, named.weight] for named in best.message.dissent],
        "camps": [] if best is None else [list(camp.sources) for camp in best.message.camps],
        "beliefs": [belief for belief in beliefs if belief],
    }


def _motion(best: Received[Consensus] | None) -> Table:
    """Where it heads (radians) and the sigma of that, and how fast it moves (unit / s), as far as that is known."""
    pose = None if best is None else pose_of(best.message.state)
    velocity = None if best is None else velocity_of(best.message.velocity)
    motion: Table = {}
    if pose is not None:
        motion["heading"] = [_short(float(pose.mean[HEADING])), _short(float(pose.covariance[HEADING, HEADING]) ** 0.5)]
    if velocity is not None:
        motion["velocity"] = [_short(float(speed)) for speed in velocity.mean[AXES]]
    return motion


def _belief(
    kind: str,
    who: str,
    told: Received[Report] | Received[Consensus],
    drawn: Drawn | None,
    moment: Moment,
    cells: list[bytes],
) -> Table:
    if drawn is None or len(cells) >= MAX_BELIEFS:
        return {}
    cells.append(drawn.levels)
    return {
        "kind": kind,
        "who": who,
        "tick": told.message.tick,
        "age": _short(moment.time - told.message.time),
        "mean": [_short(x) for x in drawn.mean],
        "sigma": _short(drawn.sigma),
        "entropy": _short(drawn.entropy),
        "area": _short(drawn.area),
        "peak": _short(drawn.peak),
        "edge": _short(drawn.edge),
        "lo": drawn.lo,
        "box": drawn.box,
    }


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) and abs(value) < 1e6 else value
