"""The laboratory's work, divided into jobs that run on all cores of the machine, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

import numpy as np

from blackboard.config import Scenario
from blackboard.lab.cases import GRID, TRIALS, Run
from blackboard.lab.comparison import AGREED, IDEAL, Other, by_kind, contenders, judge, merged
from blackboard.lab.estimates import RuleScores
from blackboard.lab.ideal import ideal_beliefs
from blackboard.lab.paper import JOINT, FigureScores
from blackboard.lab.team_cases import agreed_beliefs, first_hand_cases, variant
from blackboard.lab.team_joint import joint_sizes
from blackboard.lab.team_size import TeamSizeScores, score_sizes
from blackboard.lab.tuning import CandidateScores, try_all
from blackboard.opinion.rules import Rule
from blackboard.process.clock import UnixClock
from blackboard.run.lifeline import follow

T = TypeVar("T")
Progress = Callable[[int, int], None]  # jobs done, of all


@dataclass(frozen=True)
class Beside:
    """What is judged beside the rules: what whole teams agree on, and the centralised filter."""

    agreed: bool = False
    ideal: bool = False


CHUNK = 25  # runs of a trial in one job
LOOK = 0.5  # seconds between two looks whether a signal has come: one that comes just before a wait does not end it


def run_jobs(
    function: Callable[..., T],
    jobs: Sequence[tuple[Any, ...]],
    progress: Progress | None = None,
    keep: Callable[[T], None] | None = None,
) -> list[T]:
    """function(*job) for each job, in processes of their own, one a core: the results in the order of the jobs.

    `keep` is given each result as soon as it is there.

    The first exception of a job is raised here; then, as at SIGINT and SIGTERM, all processes are gone.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one thread a process: there is one process a core
    spawn = multiprocessing.get_context("spawn")
    workers = max(1, min(cores, len(jobs)))
    before = signal.signal(signal.SIGTERM, _exit_at_signal)
    with ProcessPoolExecutor(workers, mp_context=spawn, initializer=_set_up_worker, initargs=(os.getpid(),)) as pool:
        try:
            with _signals_later():
                futures = [pool.submit(function, *job) for job in jobs]
            for done, future in enumerate(_as_completed(futures), start=1):
                result = future.result()
                if keep is not None:
                    keep(result)
                if progress is not None:
                    progress(done, len(jobs))
            return [future.result() for future in futures]
        except BaseException:
            # The pool finds its workers gone, fails what is left, and is joined when this block is left. To ask it to shut down
            # without waiting would leave its thread to close its pipe while Python exits.
            for worker in multiprocessing.active_children():
                worker.kill()
            raise
        finally:
            signal.signal(signal.SIGTERM, before)


def _as_completed(futures: Sequence[Future[T]]) -> Iterator[Future[T]]:
    """The jobs as they are done."""
    waiting = set(futures)
    while waiting:
        done, waiting = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
        yield from done


@contextmanager
def _signals_later() -> Iterator[None]:
    """SIGINT and SIGTERM take effect when this block is left: a pool that is interrupted while it starts cannot be joined."""
    arrived: list[int] = []
    before = {
        number: signal.signal(number, lambda number, frame: arrived.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for arrival in arrived:
            signal.raise_signal(arrival)


def _exit_at_signal(number: int, frame: object) -> NoReturn:
    """Leave by an exception, so that `run_jobs` ends its workers first."""
    sys.exit(128 + number)


def _set_up_worker(parent: int) -> None:
    """In a worker: leave Ctrl-C, which a terminal sends to all of them, to the parent, and die with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    follow(parent)


def trial_jobs(runs: int, rng: np.random.Generator) -> list[tuple[str, int, list[np.random.Generator]]]:
    """The jobs for `judge_trial`: each trial's runs in chunks, every run with random numbers of its own."""
    jobs = []
    for name, own in zip(TRIALS, rng.spawn(len(TRIALS)), strict=True):
        streams = own.spawn(runs)
        jobs += [(name, first, streams[first : first + CHUNK]) for first in range(0, runs, CHUNK)]
    return jobs


def judge_trial(name: str, first: int, streams: Sequence[np.random.Generator]) -> dict[str, RuleScores]:
    """Judge all contenders on runs `first`, `first` + 1, ... of a trial."""
    runs = [(first + i, [TRIALS[name](stream)]) for i, stream in enumerate(streams)]
    return judge(runs, contenders(GRID), UnixClock().now)


def judge_team(
    scenario: Scenario, number: int, every: float, beside: Beside = Beside()
) -> dict[str, dict[str, RuleScores]]:
    """Judge all contenders on a variant of a scenario, wherever there is something to pool: together (""), then `by_kind`."""
    run = [case for case in _cases(scenario, number, every) if len(case.sources) > 1]
    rules, others = contenders(scenario.grid, scenario.board), _others(scenario, number, run, beside)
    parts = {
        kind: {
            **judge([(number, some)], rules, UnixClock().now),
            **{name: other.judge(number, some) for name, other in others.items()},
        }
        for kind, some in (by_kind(run) or {"": []}).items()
    }
    return {"": merged(list(parts.values())), **(parts if len(parts) > 1 else {})}


def try_settings(rules: Sequence[str], scenario: Scenario, number: int, every: float) -> dict[str, CandidateScores]:
    run = _cases(scenario, number, every)
    return {rule: try_all(rule, [run]) for rule in rules}


def judge_held_out(
    rules: dict[str, Rule], scenario: Scenario, number: int, every: float, beside: Beside = Beside()
) -> tuple[dict[str, RuleScores], dict[str, TeamSizeScores]]:
    """Judge some rules on a variant of a scenario, and what one more robot gains with the first of them."""
    run = _cases(scenario, number, every)
    first = next(iter(rules))
    by_size = score_sizes([(number, run)], scenario.team.robots, {first: rules[first]})
    others = {name: other.judge(number, run) for name, other in _others(scenario, number, run, beside).items()}
    return {**judge([(number, run)], rules, UnixClock().now), **others}, by_size


def score_figures(
    rules: Mapping[str, Rule], scenarios: Sequence[Scenario], number: int, every: float
) -> list[FigureScores]:
    """For each scenario score each rule in its variant `number`; without rules score the joint.

    Scored are one robot and all in every tick, and all sizes of the team every `every` seconds. Nothing but their grid may tell
    the scenarios from each other: the joint knows no grid, so it is run once for all of them.
    """
    variants, robots = [variant(scenario, number) for scenario in scenarios], scenarios[0].team.robots
    parts: list[tuple[Run, Sequence[int]]] = []
    for own in variants:
        run, stride = first_hand_cases(own, own.time.tick), max(1, round(every / own.time.tick))
        fewer = [case for case in run if round(case.time / own.time.tick) % stride == 0]
        parts += [(run, (1, len(robots))), (fewer, range(1, len(robots) + 1))]
    if rules:
        by_rule = [score_sizes([(number, cases)], robots, rules, sizes) for cases, sizes in parts]
    else:
        by_rule = [{JOINT: scores} for scores in joint_sizes(variants[0], parts, number)]
    return [FigureScores(*pair) for pair in zip(by_rule[::2], by_rule[1::2], strict=True)]


def _others(scenario: Scenario, number: int, run: Run, beside: Beside) -> dict[str, Other]:
    """What is asked for beside the rules, on the subjects and times of the cases of a run."""
    others, wanted, own = {}, [case.asked for case in run], variant(scenario, number)
    for name, fusion in AGREED.items() if beside.agreed else ():
        team = own.changed("board", fusion=fusion).changed("time", mode="lockstep")
        others[name] = Other(agreed_beliefs(team, wanted), {"rule": scenario.board.rule, "fusion": fusion})
    if beside.ideal:
        others[IDEAL] = Other(ideal_beliefs(own, wanted), {"rule": IDEAL})
    return others


def _cases(scenario: Scenario, number: int, every: float) -> Run:
    return first_hand_cases(variant(scenario, number), every)
