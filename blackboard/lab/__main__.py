"""The door of the laboratory: `blackboard lab | tune | figures | sweep`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import reduce
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from blackboard.config import Scenario, load
from blackboard.errors import UserError, extra
from blackboard.judge.files import check_folder, check_table, table_file
from blackboard.lab import comparison, paper, parallel, sweep_report, tuning, tuning_report
from blackboard.lab import lost as lost_robots
from blackboard.lab import streams as streams_of_fusions
from blackboard.lab.estimates import RuleScores
from blackboard.lab.sweep import kept_runs, run_all
from blackboard.lab.sweep_plan import parse_seeds, plan
from blackboard.lab.team import InProcessTeam
from blackboard.lab.tuning import CandidateScores
from blackboard.opinion.rules import Rule
from blackboard.run.flags import LengthFlags, OutputFlags, RecordingFlags, TeamFlags
from blackboard.run.progress import progress

SEED = 1  # of the trials and of the bootstrap, where --seed does not give another


def lab(
    scenario: str | None = None,
    *,
    runs: int = 300,
    variants: int = 5,
    every: float = 1.0,
    streams: int = 0,
    ideal: bool = False,
    agreed: bool = False,
    lost: bool = False,
    length: LengthFlags = LengthFlags(),
    recording: RecordingFlags = RecordingFlags(),
    picture: Path | None = None,
    output: OutputFlags = OutputFlags(),
) -> int:
    """Fuse the same opinions with every rule and score the results: five trials, and any simulated or recorded team.

    Parameters
    ----------
    scenario
        A scenario whose team is judged too: a TOML file, or the name of one that comes with the package.
    runs
        Runs of each of the five trials; 0 leaves them out.
    variants
        Seeds of the scenario, or stretches of the recording that follow each other.
    every
        Seconds of team time from one fusion to the next.
    streams
        Instead of all this, runs of each stream of fusions of the same sources, where a board can learn (independence "learn").
    ideal
        Also judge one filter that has all robots' readings and, in simulation, is told the world's own noise.
    agreed
        Also run the whole team, once with each `fusion` of [board], and judge what its boards agree on.
    lost
        Instead of all this, run whole teams with one faulty robot, and judge the probability of being lost that boards tell of each.
    picture
        Also draw the table into this file (.svg or .png) (extra `plot`).
    """
    drawing = _drawing("--picture") if picture is not None else None
    seed = SEED if length.seed is None else length.seed
    _at_least(runs=(runs, 0), variants=(variants, 1), every=(every, 0), seed=(seed, 0), streams=(streams, 0))
    if streams:
        return _study(streams_of_fusions, streams_of_fusions.jobs(streams, np.random.default_rng(seed)), output)
    trials_rng, intervals_rng = np.random.default_rng(seed).spawn(2)
    teams = _teams(scenario, length, recording)
    if lost:
        teams = teams or [load("demo").changed("time", seconds=length.seconds)]
        return _study(lost_robots, lost_robots.jobs(teams, variants), output)
    if (ideal or agreed) and not teams:
        raise UserError("--ideal and --agreed are about a team: name a scenario or a recording too")
    jobs = parallel.trial_jobs(runs, trials_rng) if runs else []
    situations = _situations(jobs, teams, variants, every, parallel.Beside(agreed, ideal))
    if not situations:
        raise UserError("--runs 0: nothing is left to judge; name a scenario or a recording too")
    table = comparison.report(situations, intervals_rng)
    if drawing is not None and picture is not None:
        drawing.save(drawing.comparison(table), picture)
    output.show(table, comparison.text)
    return 0


def _situations(
    trials: Sequence[tuple[Any, ...]], teams: Sequence[Scenario], variants: int, every: float, beside: parallel.Beside
) -> dict[str, dict[str, RuleScores]]:
    """What is judged, by name: the trials, and for each team its variants together. UserError: nothing was ever fused in a team."""
    situations = {}
    with progress("lab") as show_progress:
        if trials:
            judged = parallel.run_jobs(parallel.judge_trial, trials, show_progress)
            for name in dict.fromkeys(job[0] for job in trials):
                some = [scores for job, scores in zip(trials, judged, strict=True) if job[0] == name]
                situations[name] = comparison.merged(some)
        for one in teams:
            jobs = [(one, number, every, beside) for number in range(variants)]
            of_variants = parallel.run_jobs(parallel.judge_team, jobs, show_progress)
            for kind in dict.fromkeys(kind for parts in of_variants for kind in parts):
                some = [parts[kind] for parts in of_variants if kind in parts]
                situations[f"team {one.name}{kind}"] = comparison.merged(some)
            if not situations[f"team {one.name}"][comparison.DEFAULT_NAME].runs:
                raise UserError(f"{one.where}: nobody ever had a second opinion; give more robots or a longer run")
    return situations


def tune(
    scenario: str | None = None,
    *,
    rule: str | None = None,
    variants: int = 8,
    held_out: int = 8,
    every: float = 2.0,
    coverage: float = 0.9,
    gain: float = 0.05,
    ideal: bool = False,
    agreed: bool = False,
    length: LengthFlags = LengthFlags(),
    recording: RecordingFlags = RecordingFlags(),
    output: OutputFlags = OutputFlags(),
) -> int:
    """Choose the rule and the parameters of a board from runs, and compare them with the default and the paper's on other runs.

    The choice is recommended if it has a higher log score there than the default, the whole interval of the difference (of 4 runs
    or more) being above 0; else the default is. The exit status is 0 if the choice is recommended, 1 if the default is to be kept.

    Parameters
    ----------
    scenario
        The scenario whose team is run: a TOML file, or the name of one that comes with the package [default: demo].
    rule
        Choose among the settings of this rule only, "calibrated", "coalition" or a plug-in's.
    variants
        Seeds of the scenario, or stretches of the recording, from which is chosen.
    held_out
        The ones after these, on which the choice is judged.
    every
        Seconds of team time from one fusion to the next.
    coverage
        The share of 95 % regions that must hold the truth.
    gain
        Nats of log score that one more robot must gain to be worth it.
    ideal
        Also judge one filter that has all robots' readings on the held-out runs.
    agreed
        Also run the whole team on them, once with each `fusion` of [board], and judge what its boards agree on.
    """
    seed = SEED if length.seed is None else length.seed
    _at_least(variants=(variants, 1), held_out=(held_out, 1), every=(every, 0), seed=(seed, 0), coverage=(coverage, 0))
    if coverage > 1:
        raise UserError(f"--coverage {coverage:g}: give a share of at most 1")
    if scenario and recording.mrclam is not None:
        raise UserError(f"{scenario} and --mrclam: give one of the two")
    (team,) = _teams(scenario if scenario or recording.given else "demo", length, recording)
    rng = np.random.default_rng(seed)
    choices = _choices(rule, team, variants, every, coverage, rng)
    best = max(choices.values(), key=lambda c: (c["honest"], c["log_score"]))
    judged = {"tuned": best["setting"], "default": comparison.DEFAULT, "paper": comparison.PAPER}
    with progress("tune: held-out runs") as show_progress:
        beside = parallel.Beside(agreed, ideal)
        held = [(judged, team, number, every, beside) for number in range(variants, variants + held_out)]
        checks = parallel.run_jobs(parallel.judge_held_out, held, show_progress)
    table = tuning_report.tuned(choices, best, judged, checks, coverage=coverage, gain=gain, rng=rng)
    output.show(table, tuning_report.text)
    return 0 if table["recommended"]["which"] == "tuned" else 1


def _choices(
    rule: str | None, team: Scenario, variants: int, every: float, coverage: float, rng: np.random.Generator
) -> dict[str, dict[str, Any]]:
    """The best setting of one rule, or of each that can be tuned, on the first variants of a team. UserError: no such rule."""
    rules = [rule] if rule else list(tuning.spaces())
    for name in rules:
        tuning.space(name)
    with progress("tune: runs to choose from") as show_progress:
        jobs = [(rules, team, number, every) for number in range(variants)]
        parts = parallel.run_jobs(parallel.try_settings, jobs, show_progress)
    return {
        name: tuning.choose(reduce(CandidateScores.merge, (p[name] for p in parts)), coverage, team.grid.cell, rng)
        for name in rules
    }


def figures(
    *,
    out: Path = Path("figures"),
    seeds: int = 20,
    robots: int = 10,
    grids: Annotated[list[int] | None, Parameter(negative="")] = None,
    seconds: float = 60.0,
    every: float = 5.0,
    output: OutputFlags = OutputFlags(),
) -> int:
    """Draw the paper's figures into a folder (SVG, PNG, a page of all), and list the files; with --json also their numbers.

    Figs. 1 to 5 are 1-D; Figs. 6 and 7 come from the simulated world with the paper's sensors. (Extra `plot`.)

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
        Seconds of team time from one judged instant to the next in Fig. 7; Fig. 6 shows every tick.
    """
    drawing = _drawing("a figure")
    sizes = grids or [50, 100, 200]
    _at_least(seeds=(seeds, 1), robots=(robots, 2), grids=(min(sizes), 20), every=(every, 0), seconds=(seconds, every))
    rng = np.random.default_rng(1)
    with progress("figures") as show_progress:
        table = paper.on_a_line(rng)
        files = drawing.save_all(drawing.paper(table), out)  # at once: the others take minutes
        print(f"figures: Figs. 1 to 5 are in {drawing.gallery(out)}; Figs. 6 and 7 follow", file=sys.stderr, flush=True)
        worlds = [paper.world(load("paper"), n, robots, seconds) for n in sorted(sizes, reverse=True)]
        alike = [(dict[str, Rule](), worlds), *((paper.RULES, [one]) for one in worlds)]
        jobs = [(*job, number, every) for job in alike for number in range(seeds)]
        parts = parallel.run_jobs(parallel.score_figures, jobs, show_progress)
    joints, *by_rules = (parts[i : i + seeds] for i in range(0, len(parts), seeds))
    runs = {
        world.grid.shape[0]: [rules.beside(joint[i]) for (rules,), joint in zip(of_world, joints, strict=True)]
        for i, (world, of_world) in enumerate(zip(worlds, by_rules, strict=True))
    }
    shown = paper.in_the_world({n: runs[n] for n in sizes}, rng)
    told = [str(file) for file in [*files, *drawing.save_all(drawing.paper(shown), out), drawing.gallery(out)]]
    output.show({**table, **shown, "files": told}, lambda _: "\n".join(told))
    return 0


def sweep(
    scenario: str | None = None,
    *,
    seeds: str = "1..8",
    set: Annotated[tuple[str, ...], Parameter(negative="", show_default=False)] = (),
    seconds: float | None = None,
    runs: Path | None = None,
    table: Path | None = None,
    plot: Path | None = None,
    team: TeamFlags = TeamFlags(),
    recording: RecordingFlags = RecordingFlags(),
    output: OutputFlags = OutputFlags(),
) -> int:
    """Run a scenario with every combination of settings and every seed, and compare what the teams agreed on.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package [default: demo].
    seeds
        Seeds of the world, as 1..20 or 1,5,9.
    set
        A key of the scenario and its values, as board.rule=cooperative,coalition; may be given again. The first value of each is what
        the others are compared with. A rule is set as with --rule, but fusion stays what it is (--fusion).
    seconds
        Length of a run, in seconds of team time [default: the scenario's].
    runs
        Keep each finished run in this file (JSON lines); runs that are there already are not made again.
    table
        Also write a row for each run, group and level into this file: .csv, .jsonl or .parquet.
    plot
        Also draw the comparison into this folder (extra `plot`).
    """
    drawing = _drawing("--plot", "sweep_drawing") if plot is not None else None
    if table is not None:
        check_table(table, "--table")
    if plot is not None:
        check_folder(plot, "--plot")
    chosen = team.apply(recording.scenario(scenario) if recording.given or scenario is None else load(scenario))
    chosen = chosen.changed("time", seconds=seconds, mode="lockstep")
    planned = plan(chosen, parse_seeds(seeds), set)
    for one in {one.combination: one for one in planned}.values():
        InProcessTeam(one.scenario)  # a mistake in any section is reported before anything runs
    with kept_runs(runs) as (done, keep), progress("sweep") as show:
        cards = run_all(planned, done, keep, show)
    summary = sweep_report.report(planned, cards, np.random.default_rng(SEED))
    output.show(summary, sweep_report.text)  # first: a file may fail after hours
    if table is not None:
        columns, rows = sweep_report.rows(planned, cards)
        with table_file(table, columns, "--table") as write:
            for each in rows:
                write(each)
    if drawing is not None and plot is not None:
        drawing.draw_sweep(summary, planned, cards, plot)
    return 0


def _study(study: ModuleType, jobs: Sequence[tuple[Any, ...]], output: OutputFlags) -> int:
    """Judge the jobs of `lost` or `streams`, each under the name that comes first in it."""
    with progress("lab") as show_progress:
        parts = parallel.run_jobs(study.judge, jobs, show_progress)
    output.show(study.report([str(job[0]) for job in jobs], parts), study.text)
    return 0


def _teams(scenario: str | None, length: LengthFlags, recording: RecordingFlags) -> list[Scenario]:
    """The scenarios whose teams are judged: the named one, and the recording where its flags are given."""
    teams = [load(scenario)] if scenario else []
    if recording.given:
        teams.append(recording.scenario())
    return [team.changed("time", seconds=length.seconds) for team in teams]


def _at_least(**numbers: tuple[float, float]) -> None:
    for name, (value, least) in numbers.items():
        if not value >= least:
            raise UserError(f"--{name.replace('_', '-')} {value:g}: give at least {least:g}")


def _drawing(what: str, module: str = "drawing") -> ModuleType:
    """A module of the laboratory that draws. UserError: matplotlib, which it needs, is not installed."""
    with extra("plot", what):
        return import_module(f"blackboard.lab.{module}")
