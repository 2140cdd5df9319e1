"""What is the team worth at how many bytes? `python benchmarks/radio.py --picture docs/radio.png`.

Long, because the ways of saving, the runs, the table and the picture belong to one question.

The log score of what the team agrees on, against the bytes that a robot sends to its boards (reports and statuses, keys
included), for three ways: everything in every tick, everything in every k-th tick, and `[robot.send] budget`. Each way plays the same
team, of the demo or of a recording, with the same sensor readings in one process. The ways were made on other seeds than those here.

The score is the mean over robots and objects of the samples that "everything" has; a sample that a way lacks counts as a uniform
belief, so that silence cannot win by leaving hard samples out.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from ratios import ROOT  # noqa: F401  (makes the packages importable)

from blackboard.config import Scenario, load
from blackboard.lab.team import Team
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Report
from robot_agent.budget import Budget, Known, Said, Sent
from robot_agent.service import AgentService
from sim_world.series import Sample

SEEDS = (101, 102, 103, 104)
EVERY = (2, 4, 8)
SHARES = (0.5, 0.25, 0.18, 0.12)  # of the reports' bytes that "everything" sends, as a budget
COLOURS = {"everything": "black", "every k-th": "tab:orange", "budget": "tab:blue"}


class EveryKth(Budget):
    """Everything in every k-th tick, each robot in a tick of its own; the boards keep the rest as under a budget."""

    k = 1
    tick = -1
    saves = True

    def choose(self, reports: Sequence[Report], time: float, speed: float | None, team: Mapping[str, Known]) -> Said:
        self.tick += 1
        subjects = {report.subject for report in reports}
        self.sent = {subject: it for subject, it in self.sent.items() if subject in subjects}
        if (self.tick + int(self.robot[1:])) % self.k == 0:
            for report in reports:
                packed = report.belief if report.informed is None else report.informed.belief
                self.sent[report.subject] = Sent(time, unpack(packed, self.grid))
            return Said(list(reports), {})
        return Said([], {s: self.aged(s, time, speed) for s in sorted(self.sent)})


@dataclass(frozen=True)
class Play:
    """One run: a team, a fusion, a seed, and a way with its number (k, or bytes a second)."""

    team: str
    fusion: str
    seed: int
    way: str = "everything"
    number: float = 1.0
    seconds: float = 20.0
    recording: str = ""

    def scenario(self) -> Scenario:
        scenario = load(self.team).changed("board", fusion=self.fusion).changed("time", seconds=self.seconds)
        if self.recording:
            return scenario.changed("world", dir=self.recording, start=1248446200.0, protocol="C_blind12")
        return scenario.changed("world", seed=self.seed)


@dataclass
class Played:
    """What a run gave: bytes a second and robot, and the log score of each sample of what was agreed."""

    play: Play
    reports: float
    statuses: float
    scores: dict[str, float]

    @property
    def sent(self) -> float:
        return self.reports + self.statuses


def every_kth(robot: AgentService, k: int) -> EveryKth:
    budget = EveryKth(robot.settings.send, robot.grid, robot.robot, robot.drift, robot._size)
    budget.k = k
    return budget


def played(play: Play) -> Played:
    scenario = play.scenario()
    budget = {"budget": play.number if play.way == "budget" else math.inf}
    if play.way != "everything":
        scenario = scenario.changed("robot", send=budget)
    team, sent = Team(scenario), defaultdict[str, int](int)
    for robot in team.robots.values():
        if play.way == "every k-th":
            robot._new_budget = partial(every_kth, robot, int(play.number))  # type: ignore[method-assign]
            robot._begin("")

    names, samples = set(team.robots), dict[str, float]()

    def count(envelope: Envelope) -> None:
        found = keys.parse(envelope.key)
        if (
            found
            and found[0] in (keys.REPORT, keys.STATUS)
            and found[1].get("source", found[1].get("process")) in names
        ):
            sent[found[0].name] += len(envelope.key) + len(envelope.payload)

    def keep(sample: Sample) -> None:
        if sample.level == "agreed":
            samples[f"{sample.tick} {sample.robot} {sample.subject}"] = sample.log_score

    team.bus.spies.append(count)
    team.world.referee._record = keep
    team.run()
    each = play.seconds * len(names)
    return Played(play, sent["report"] / each, sent["status"] / each, samples)


def curve(first: Play, seeds: Sequence[int], jobs: int) -> list[dict[str, object]]:
    """All ways on some seeds: one row for each way, with the means over the seeds."""
    with ProcessPoolExecutor(jobs) as pool:
        whole = dict(zip(seeds, pool.map(played, [replace(first, seed=seed) for seed in seeds]), strict=True))
        rate = float(np.mean([it.reports for it in whole.values()]))
        ways = [("every k-th", float(k)) for k in EVERY] + [("budget", round(share * rate)) for share in SHARES]
        plays = [replace(first, seed=seed, way=way, number=number) for way, number in ways for seed in seeds]
        found = [*whole.values(), *pool.map(played, plays)]
    rows = []
    for way, number in [("everything", 1.0), *ways]:
        mine = [it for it in found if (it.play.way, it.play.number) == (way, number)]
        rows.append(_row(way, number, mine, [whole[it.play.seed] for it in mine]))
    return rows


def _row(way: str, number: float, runs: Sequence[Played], whole: Sequence[Played]) -> dict[str, object]:
    """The means of runs of one way, beside those of everything on the same seeds."""
    lacking = sum(len(full.scores.keys() - run.scores.keys()) for run, full in zip(runs, whole, strict=True))
    return {
        "way": way,
        "number": number,
        "bytes": round(float(np.mean([run.sent for run in runs]))),
        "share": round(float(np.mean([run.sent / full.sent for run, full in zip(runs, whole, strict=True)])), 3),
        "score": round(float(np.mean([_score(run, full) for run, full in zip(runs, whole, strict=True)])), 3),
        "less": [round(_score(run, full) - _score(full, full), 3) for run, full in zip(runs, whole, strict=True)],
        "lacking": lacking,
        "samples": sum(len(full.scores) for full in whole),
    }


def _score(run: Played, whole: Played) -> float:
    nothing = -math.log(run.play.scenario().grid.size)
    return float(np.mean([run.scores.get(sample, nothing) for sample in whole.scores]))


def draw(curves: Mapping[str, Sequence[Mapping[str, Any]]], picture: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(curves), figsize=(4.2 * len(curves), 3.6), squeeze=False)
    for axis, (name, rows) in zip(axes[0], curves.items(), strict=True):
        for way in ("every k-th", "budget"):
            mine = sorted((row for row in rows if row["way"] in (way, "everything")), key=lambda row: row["bytes"])
            axis.plot([r["share"] for r in mine], [r["score"] for r in mine], "o-", color=COLOURS[way], label=way)
        whole = next(row for row in rows if row["way"] == "everything")
        axis.axhline(whole["score"], color="grey", lw=0.8, ls=":")
        axis.set(title=name, xlabel=f"share of the bytes of everything ({whole['bytes']} B/s a robot)", xlim=(0, 1.05))
    axes[0][0].set_ylabel("log score of agreed, nats")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(picture, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the demo, team time")
    parser.add_argument("--recording", default="", help="folder of MRCLAM data set 7, to play that too")
    parser.add_argument("--recorded", type=float, default=200.0, help="seconds of the recording")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="opinions or joint: only that fusion")
    parser.add_argument(
        "--rows", type=Path, help="write the rows here as JSON; rows of other teams that are there stay"
    )
    parser.add_argument("--picture", type=Path, help="draw the rows (needs the extra `plot`)")
    told = parser.parse_args()
    curves = json.loads(told.rows.read_text()) if told.rows and told.rows.is_file() else {}
    fusions = [told.only] if told.only else ["opinions", "joint"]
    asked: list[tuple[Play, tuple[int, ...]]] = [
        (Play("demo", fusion, 1, seconds=told.seconds), SEEDS) for fusion in fusions if told.seconds
    ]
    if told.recording:
        asked += [(Play("mrclam", f, 1, seconds=told.recorded, recording=told.recording), (1,)) for f in fusions]
    for play, seeds in asked:
        name = f"{play.team}, {play.fusion}"
        curves[name] = curve(play, seeds, told.jobs)
        for row in curves[name]:
            print(name, row, flush=True)
        if told.rows:
            told.rows.write_text(json.dumps(curves, indent=1) + "\n")
    if told.picture:
        draw(curves, told.picture)


if __name__ == "__main__":
    main()
