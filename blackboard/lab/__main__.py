"""The door of the laboratory: `blackboard lab | tune | figures`."""

from __future__ import annotations

import json
import sys
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from blackboard.config import Scenario, load
from blackboard.errors import Mistake
from blackboard.lab import contest, paper, summary, tuning, work
from blackboard.lab.tuning import Trials
from blackboard.progress import progress

Json = Annotated[bool, Parameter(name="--json", negative="")]


def lab(
    scenario: str | None = None,
    *,
    runs: int = 300,
    variants: int = 5,
    seconds: float | None = None,
    every: float = 1.0,
    seed: int = 1,
    mrclam: str | None = None,
    start: float | None = None,
    protocol: str | None = None,
    picture: Path | None = None,
    as_json: Json = False,
) -> int:
    """Put all rules to the same opinions and show how each did: five trials, and any simulated or recorded team.

    Parameters
    ----------
    scenario
        A scenario whose team is rehearsed too: a TOML file, or the name of one that comes with the package.
    runs
        Runs of each of the five trials; 0 leaves them out.
    variants
        Seeds of the scenario, or stretches of the recording that follow each other.
    seconds
        Length of each of these, in seconds of team time.
    every
        Seconds of team time from one fusion to the next.
    seed
        Seed of the trials and of the intervals.
    mrclam
        The recorded team in this folder (MRCLAM format) is rehearsed too.
    start
        Where the recording's first stretch begins, Unix time.
    protocol
        Which of its landmark sightings may be used, as A_all or C_blind12.
    picture
        Also draw the table into this file (.svg or .png); needs the extra `plot`.
    as_json
        Print one JSON object instead of the table.
    """
    drawing = _drawing() if picture is not None else None
    _at_least(runs=(runs, 0), variants=(variants, 1), every=(every, 0), seed=(seed, 0))
    trials_chance, intervals_chance = np.random.default_rng(seed).spawn(2)
    teams = _teams(scenario, seconds, mrclam, start, protocol)
    trials = {}
    with progress("lab") as tell:
        if runs:
            jobs = work.trial_jobs(runs, trials_chance)
            parts = work.spread(work.trial, jobs, tell)
            for name in dict.fromkeys(job[0] for job in jobs):
                trials[name] = contest.merged([p for job, p in zip(jobs, parts, strict=True) if job[0] == name])
        for one in teams:
            parts = work.spread(work.team, [(one, number, every) for number in range(variants)], tell)
            trials[f"team {one.name}"] = contest.merged(parts)
            if not trials[f"team {one.name}"][contest.THE_DEFAULT].runs:
                raise Mistake(f"{one.source}: nobody ever had a second opinion; give more robots or a longer run")
    if not trials:
        raise Mistake("--runs 0: nothing is left to judge; name a scenario or a recording too")
    found = contest.report(trials, intervals_chance)
    if drawing is not None and picture is not None:
        drawing.save(drawing.contest(found), picture)
    sys.stdout.write((json.dumps(found) if as_json else contest.text(found)) + "\n")
    return 0


def tune(
    scenario: str | None = None,
    *,
    rule: Literal["calibrated", "coalition"] | None = None,
    variants: int = 8,
    held_out: int = 8,
    seconds: float | None = None,
    every: float = 2.0,
    coverage: float = 0.9,
    gain: float = 0.05,
    seed: int = 1,
    mrclam: str | None = None,
    start: float | None = None,
    protocol: str | None = None,
    as_json: Json = False,
) -> int:
    """Choose the rule and the parameters of a board from runs, and hold them against the paper's on other runs.

    The exit status is 0 if the choice has the higher log score there, as far as its interval can tell.

    Parameters
    ----------
    scenario
        The scenario whose team is rehearsed: a TOML file, or the name of one that comes with the package [default: demo].
    rule
        Choose among the settings of this rule only.
    variants
        Seeds of the scenario, or stretches of the recording, from which is chosen.
    held_out
        The ones after these, on which the choice is judged.
    seconds
        Length of each, in seconds of team time.
    every
        Seconds of team time from one fusion to the next.
    coverage
        The share of 95 % regions that must hold the truth.
    gain
        Nats of log score that one more robot must gain to be worth it.
    seed
        Seed of the intervals.
    mrclam
        Take the recorded team in this folder (MRCLAM format) instead.
    start
        Where the recording's first stretch begins, Unix time.
    protocol
        Which of its landmark sightings may be used, as A_all or C_blind12.
    as_json
        Print one JSON object instead of the text.
    """
    _at_least(variants=(variants, 1), held_out=(held_out, 1), every=(every, 0), seed=(seed, 0), coverage=(coverage, 0))
    if coverage > 1:
        raise Mistake(f"--coverage {coverage:g}: give a share of at most 1")
    if scenario and mrclam:
        raise Mistake(f"{scenario} and --mrclam: give one of the two")
    (team,) = _teams(scenario or (None if mrclam else "demo"), seconds, mrclam, start, protocol)
    chance = np.random.default_rng(seed)
    rules = [rule] if rule else list(tuning.SPACES)
    with progress("tune") as tell:
        parts = work.spread(work.tried, [(rules, team, n, every) for n in range(variants)], tell)
        choices = {
            name: tuning.choose(reduce(Trials.merge, (p[name] for p in parts)), coverage, team.grid.cell, chance)
            for name in rules
        }
        best = max(choices.values(), key=lambda c: (c["honest"], c["log_score"]))
        judged = {"tuned": best["setting"], "default": contest.DEFAULT, "paper": contest.PAPER}
        numbers = range(variants, variants + held_out)
        checks = work.spread(work.held_out, [(judged, team, n, every) for n in numbers], tell)
    found = summary.tuned(choices, best, judged, checks, coverage=coverage, gain=gain, chance=chance)
    sys.stdout.write((json.dumps(found) if as_json else summary.text(found)) + "\n")
    return 0 if found["gain_over_paper"]["low"] > 0 else 1


def figures(
    *,
    out: Path = Path("figures"),
    seeds: int = 20,
    robots: int = 10,
    grids: list[int] | None = None,
    seconds: float = 60.0,
    every: float = 5.0,
) -> int:
    """Draw the paper's figures into a folder (SVG and PNG) and print the numbers behind them as JSON.

    Figs. 1 to 5 are 1-D; Figs. 6 and 7 come from the simulated world with the paper's sensors. Needs the extra `plot`.

    Parameters
    ----------
    out
        The folder; it is made where it is missing.
    seeds
        Runs of the simulated world for each grid.
    robots
        Robots in the world, and so the largest team in Fig. 7.
    grids
        Cells along each edge of the arena of 50 x 50 units [default: 50 100 200].
    seconds
        Length of a run, in seconds of team time.
    every
        Seconds of team time from one judged instant to the next.
    """
    drawing = _drawing()
    sizes = grids or [50, 100, 200]
    _at_least(seeds=(seeds, 1), robots=(robots, 2), grids=(min(sizes), 20), every=(every, 0), seconds=(seconds, every))
    with progress("figures") as tell:
        worlds = {n: paper.world(load("paper"), n, robots, seconds) for n in sizes}
        jobs = [(paper.RULES, worlds[n], number, every) for n in sorted(sizes, reverse=True) for number in range(seeds)]
        parts = work.spread(work.grown, jobs, tell)
        runs = {n: [p for job, p in zip(jobs, parts, strict=True) if job[1] is worlds[n]] for n in sizes}
    found = paper.numbers(runs, np.random.default_rng(1))
    for name, figure in drawing.paper(found).items():
        for ending in (".svg", ".png"):
            drawing.save(figure, out / f"{name}{ending}")
    sys.stdout.write(json.dumps(found) + "\n")
    return 0


def _teams(
    scenario: str | None, seconds: float | None, mrclam: str | None, start: float | None, protocol: str | None
) -> list[Scenario]:
    """The scenarios that are to be rehearsed."""
    teams = [load(scenario)] if scenario else []
    if mrclam is not None:
        teams.append(load("mrclam").changed("world", dir=mrclam, start=start, protocol=protocol))
    elif start is not None or protocol is not None:
        raise Mistake("--start and --protocol are about a recording: name its folder with --mrclam")
    return [team.changed("time", seconds=seconds) for team in teams]


def _at_least(**numbers: tuple[float, float]) -> None:
    for name, (value, least) in numbers.items():
        if not value >= least:
            raise Mistake(f"--{name.replace('_', '-')} {value:g}: give at least {least:g}")


def _drawing() -> Any:
    """The drawing room, for which matplotlib must be there."""
    try:
        from blackboard.lab import drawing
    except ModuleNotFoundError as error:
        raise Mistake(f"{error.name} is missing: install the extra, as pip install 'cop-blackboard[plot]'") from error
    return drawing
