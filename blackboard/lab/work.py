"""The laboratory's work, spread over the machine's cores: jobs that a fresh process can be given."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, NoReturn, TypeVar

import numpy as np

from blackboard.clock import Clock
from blackboard.config import RuleSection, Scenario
from blackboard.lab.cases import GRID, TRIALS
from blackboard.lab.contest import contenders, judge
from blackboard.lab.growth import Growth, grow
from blackboard.lab.rehearsal import rehearse, variant
from blackboard.lab.tally import Tally
from blackboard.lab.tuning import Trials, try_all
from blackboard.lifeline import follow

T = TypeVar("T")
Progress = Callable[[int, int], None]  # jobs done, of all
CHUNK = 25  # runs of a trial in one job


def spread(work: Callable[..., T], jobs: Sequence[tuple[Any, ...]], progress: Progress | None = None) -> list[T]:
    """The results of work(*job) for each job, in their order. The first exception of a job is raised here."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one thread a process: there is one process a core
    spawn = multiprocessing.get_context("spawn")
    workers = max(1, min(cores, len(jobs)))
    before = signal.signal(signal.SIGTERM, _stop)
    with ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin, initargs=(os.getpid(),)) as pool:
        try:
            futures = [pool.submit(work, *job) for job in jobs]
            for done, future in enumerate(as_completed(futures), start=1):
                future.result()
                if progress is not None:
                    progress(done, len(jobs))
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.kill()
            raise
        finally:
            signal.signal(signal.SIGTERM, before)


def _stop(number: int, frame: object) -> NoReturn:
    """SIGTERM: leave in order, so that the workers go first."""
    sys.exit(128 + number)


def _begin(parent: int) -> None:
    """A worker: Ctrl-C is for its parent, with which it dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    follow(parent)


def trial_jobs(runs: int, chance: np.random.Generator) -> list[tuple[str, int, list[np.random.Generator]]]:
    """Jobs for `trial`: each trial's runs in chunks, every run with random numbers of its own."""
    jobs = []
    for name, own in zip(TRIALS, chance.spawn(len(TRIALS)), strict=True):
        streams = own.spawn(runs)
        jobs += [(name, first, streams[first : first + CHUNK]) for first in range(0, runs, CHUNK)]
    return jobs


def trial(name: str, first: int, streams: Sequence[np.random.Generator]) -> dict[str, Tally]:
    """Judge all contenders on runs `first`, `first` + 1, ... of a trial."""
    runs = [(first + i, [TRIALS[name](stream)]) for i, stream in enumerate(streams)]
    return judge(runs, contenders(GRID), Clock().now)


def team(scenario: Scenario, number: int, every: float) -> dict[str, Tally]:
    """Judge all contenders on a variant of a scenario, wherever there is something to pool."""
    cases = [case for case in rehearse(variant(scenario, number), every) if len(case.sources) > 1]
    return judge([(number, cases)], contenders(scenario.grid), Clock().now)


def tried(rules: Sequence[str], scenario: Scenario, number: int, every: float) -> dict[str, Trials]:
    """Every candidate of some rules on a variant of a scenario."""
    run = rehearse(variant(scenario, number), every)
    return {rule: try_all(rule, [run]) for rule in rules}


def held_out(
    rules: dict[str, RuleSection], scenario: Scenario, number: int, every: float
) -> tuple[dict[str, Tally], dict[str, Growth]]:
    """Judge some rules on a variant of a scenario, and what one more robot gains with the first of them."""
    run = rehearse(variant(scenario, number), every)
    first = next(iter(rules))
    growth = grow([(number, run)], scenario.team.robots, {first: rules[first]})
    return judge([(number, run)], rules, Clock().now), growth


def grown(rules: dict[str, RuleSection], scenario: Scenario, number: int, every: float) -> dict[str, Growth]:
    """What one more robot gains with each rule, in a variant of a scenario."""
    return grow([(number, rehearse(variant(scenario, number), every))], scenario.team.robots, rules)
