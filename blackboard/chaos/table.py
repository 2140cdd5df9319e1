"""One case after the other with a team of real processes, and the table of what came of them."""

import asyncio
import math
import signal
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from blackboard.chaos.cases import TroubleCase, members
from blackboard.chaos.sight import recovery, settled
from blackboard.chaos.team import SITES, StormTeam, storm_team
from blackboard.chaos.trouble import Trouble
from blackboard.config import Scenario
from blackboard.errors import RunFailed
from blackboard.judge.samples import Sample, held_by, read_series, rms_error
from blackboard.process.columns import cell, markdown_table

WARM_UP = 6.0  # seconds of team time before the trouble
AFTER = 5.0  # seconds of team time after it that are judged with it
REST = 9.0  # seconds of team time after it until the run ends
LINGER = 3.0  # seconds that the world takes answers, so that a slow network is judged by what it did, not by having been slow


async def run_case(scenario: Scenario, case: TroubleCase, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """Run a scenario in real time with one trouble: its row; `seed` is the world's, `rng` draws losses and jitter.

    RunFailed: the team did not come up, or the world gave no scorecard.
    """
    who = members(case.who, scenario)
    laned = [name for name in who if name != "router"] if case.trouble or case.cut else []
    with tempfile.TemporaryDirectory(prefix="blackboard-chaos-") as folder:
        series = Path(folder) / "series.csv"
        async with storm_team(
            prepared(scenario, case, seed),
            Path(folder),
            rng,
            laned=[name for name in laned if name != SITES],
            sites=case.who == "sites",
            series=series,
        ) as team:
            await team.until(lambda: team.sight.time >= WARM_UP, f"{WARM_UP:g} s of team time")
            begin, since = team.now(), team.sight.time
            await _trouble(team, case, who)
            end, until = team.now(), team.sight.time
            card = await team.card()
        samples = [s for s in read_series(series) if since <= s.time <= until + AFTER]
    return {
        "case": case.name,
        "what": case.what,
        "recovery": recovery(team.looks, begin, end),
        "settled": settled(team.looks, begin, end + AFTER),
        **judged(samples),
        "missing": _missing(card),
        "dropped": card["messages"]["dropped"],
    }


def prepared(scenario: Scenario, case: TroubleCase, seed: int) -> Scenario:
    """The scenario in real time, as long as the case needs, with lost reports where the case has them."""
    seconds = math.ceil(WARM_UP + case.seconds + REST)
    chosen = scenario.changed("time", mode="realtime", seconds=float(seconds))
    chosen = chosen.changed("world", seed=seed, linger=LINGER)
    if case.lose:
        few = [robot for robots in scenario.team.sub_teams.values() for robot in robots[1:]]
        lose = {"kind": "lose", "robots": few, "share": case.lose, "start": WARM_UP, "end": WARM_UP + case.seconds}
        chosen = Scenario({**chosen.tables, "fault": [*chosen.tables.get("fault", []), lose]}, chosen.where)
    return chosen


async def _trouble(team: StormTeam, case: TroubleCase, who: Sequence[str]) -> None:
    """Begin the trouble, wait, and end it."""
    lanes = [team.lanes[name] for name in who if name in team.lanes]
    for lane in lanes:
        lane.trouble = case.trouble or Trouble()
        if case.cut:
            lane.cut()
    if case.signal is not None:
        for name in who:
            team.signal(name, case.signal)
    await asyncio.wait([team.world], timeout=case.seconds)
    if team.world.done():
        raise RunFailed(f"{case.name}: the world ended before its trouble did; it said last:\n" + "\n".join(team.lines))
    for lane in lanes:
        lane.trouble = Trouble()
        lane.mend()
    if case.signal == signal.SIGSTOP:
        for name in who:
            team.signal(name, signal.SIGCONT)


def judged(samples: Sequence[Sample]) -> dict[str, Any]:
    """RMSE (unit) of robots alone and as agreed on and of objects, and the share of agreed 95 % regions that held the truth."""
    verdict: dict[str, Any] = {}
    for name, level, kind in (
        ("solo", "solo", "robot/"),
        ("robots", "agreed", "robot/"),
        ("objects", "agreed", "object/"),
    ):
        mine = [s for s in samples if s.level == level and s.subject.startswith(kind)]
        verdict[name] = rms_error(mine) if mine else None
    agreed = [s for s in samples if s.level == "agreed"]
    return verdict | {"coverage": float(held_by(agreed, 95).mean()) if agreed else None, "samples": len(agreed)}


def _missing(card: dict[str, Any]) -> float:
    """The share of the robots' samples of the whole run for which a belief was missing."""
    missing = sum(max(levels.values()) for subject, levels in card["missing"].items() if subject.startswith("robot/"))
    groups = [card["scores"][group]["solo"]["n"] for group in card["scores"] if group != "objects"]
    return float(missing / max(1, missing + sum(groups)))


COLUMNS = ("case", "trouble", "again settled", "settled", "solo", "robots", "objects", "95 %", "missing")


def text(table: dict[str, Any]) -> str:
    """The table as Markdown, and what it was made with."""
    lines: list[Sequence[str]] = [COLUMNS]
    for row in table["rows"]:
        again = "never" if row["recovery"] is None else f"{row['recovery']:.1f} s"
        errors = [cell(row[name], "{:.2f}") for name in ("solo", "robots", "objects")]
        shares = [cell(row[name], "{:.0%}").replace("%", " %") for name in ("coverage", "missing")]
        share = f"{row['settled']:.0%}".replace("%", " %")
        lines.append((row["case"], row["what"], again, share, *errors, *shares))
    return "\n".join([*markdown_table(lines), "", table["network"]])
