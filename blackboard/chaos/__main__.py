"""The doors of the storm: `blackboard chaos` and `python -m blackboard.chaos soak`, which `make soak` runs."""

import asyncio
import signal
import sys
from collections.abc import Coroutine
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from blackboard.chaos.cases import CASES, chosen
from blackboard.chaos.lies import table as lying
from blackboard.chaos.lies.catalogue import CATALOGUE, Lie
from blackboard.chaos.lies.trial import try_lie
from blackboard.chaos.soak import LOSS
from blackboard.chaos.soak import soak as run_soak
from blackboard.chaos.table import run_case, text
from blackboard.chaos.verdict import text as table
from blackboard.config import Scenario, load
from blackboard.lab.parallel import run_jobs
from blackboard.lab.sweep_plan import parse_seeds
from blackboard.run import door
from blackboard.run.flags import OutputFlags
from blackboard.run.progress import progress

NETWORK = (
    "network: a TCP proxy of this package on 127.0.0.1 between each troubled process and its router. Delays and cuts are as given; "
    "TCP loses no bytes, so a lost segment is one that comes 0.2 s later (0.4 s more if lost again) and holds up what is behind it. "
    "`reports-20` loses whole reports, in the robots themselves."
)

LIES = (
    "Ratios to the same seed without the lie, of what was agreed on honest robots and objects from its beginning to the run's end. "
    "named: after its beginning; cleared: after its end; innocent: the longest that an honest robot was named; slower: processor time."
)

PER_CASE = 22.0  # seconds beside the trouble itself: 15 s of team time, and starting and stopping the team

ONLY = (
    f"Names of cases, or lies, with commas between them [default: all; {len(CASES)} cases take about 7 minutes, lies about 10]. "
    f"Cases: {', '.join(CASES)}."
)

app = door.new_app("blackboard-chaos")


@app.command
def chaos(
    scenario: str = "demo",
    *,
    only: Annotated[str | None, Parameter(help=ONLY)] = None,
    seed: int = 1,
    lies: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    seeds: str | None = None,
    fusion: Literal["joint", "opinions"] | None = None,
    seconds: float = 20.0,
    output: OutputFlags = OutputFlags(),
) -> int:
    """Run a team in real time under one network trouble after the other, or with one liar after the other, and print what each cost.

    For each case a new team of real processes, on a router of its own. "again settled" is the time from the end of the
    trouble until every board has beliefs that are at most 2 s old about all, and that rest on what each robot said at most 2 s
    ago. From the beginning of the trouble to 5 s after it: the mean share of beliefs that were settled, the RMSE of robots alone
    ("solo") and as agreed on, that of objects, and how many 95 % regions held the truth. Of the whole run: the share of the
    robots' samples that are missing. Exit status 1 where a case was never settled again.

    With --lies robots lie instead, one lie of the catalogue (`blackboard/chaos/lies/catalogue.py`) after the other: whole teams in
    lockstep, each in one process, on all cores. Exit status 1 where what is asked for, the last lines, does not hold.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package.
    seed
        Of the world and of losses and jitter.
    lies
        Robots lie, and the network is well.
    seeds
        Of lies: the seeds of the world, as 1..4 or 1,5 [default: --seed].
    fusion
        Of lies: pool opinions, or keep a joint belief [default: the scenario's].
    seconds
        Of lies: how long each run is, in team time; most lies begin after a fifth, and end after four.
    """
    if lies:
        numbers = parse_seeds(seeds) if seeds else [seed]
        team = load(scenario).changed("board", fusion=fusion).changed("time", seconds=seconds)
        return _try_lies(team, numbers, chosen(only, CATALOGUE, "lie"), output)
    team, cases = load(scenario), chosen(only, CASES, "case")

    async def run() -> list[dict[str, Any]]:
        rows = []
        for number, case in enumerate(cases):
            left = sum(PER_CASE + case.seconds for case in cases[number:]) / 60
            sys.stderr.write(f"{number + 1} of {len(cases)}: {case.name}, about {left:.1f} minutes left\n")
            rows.append(await run_case(team, case, seed, np.random.default_rng([seed, number])))
        return rows

    rows = _run(run())
    output.show({"scenario": team.name, "seed": seed, "network": NETWORK, "rows": rows}, text)
    return 1 if any(row["recovery"] is None for row in rows) else 0


def _try_lies(team: Scenario, seeds: list[int], lies: list[Lie], output: OutputFlags) -> int:
    """Run every lie with every seed, and each seed without one; print the table."""
    worlds = {seed: team.changed("world", seed=seed) for seed in seeds}
    jobs: list[tuple[int, Lie | None]] = [(seed, lie) for lie in (None, *lies) for seed in seeds]
    with progress("lies") as show:
        todo = [(worlds[seed], lie, np.random.default_rng([seed, number])) for number, (seed, lie) in enumerate(jobs)]
        done = run_jobs(try_lie, todo, show)
    trials = dict(zip(jobs, done, strict=True))
    rows = [
        lying.row(worlds[seed], seed, lie, trials[seed, None], trials[seed, lie])
        for seed, lie in jobs
        if lie is not None
    ]
    asked = lying.asked(rows, team.board.fusion)
    result = {"scenario": team.name, "fusion": team.board.fusion, "seeds": seeds, "what": LIES, "rows": rows}
    output.show({**result, "asked": asked}, lying.text)
    return 0 if all(holds for holds, _ in asked) else 1


@app.command
def soak(scenario: str = "demo", *, minutes: float = 10.0, seed: int = 1) -> int:
    """Run a team in real time while its processes are killed, frozen, restarted and cut off, and judge it.

    Exit status 1 where a line of the table is not true.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package.
    minutes
        How long; a process is judged by its memory once it has lived for one.
    seed
        Of the world, of what happens when to whom, and of losses.
    """
    rng = np.random.default_rng(seed)
    lines, card = _run(run_soak(load(scenario), 60 * minutes, seed, rng, lambda line: sys.stderr.write(f"{line}\n")))
    scores = card["scores"]["robots"]
    head = f"{minutes:g} minutes, seed {seed}: {card['events']} events, {LOSS:.0%} of segments lost; robots' RMSE "
    head += ", ".join(f"{level} {scores[level]['rmse']:.2f}" for level in ("solo", "agreed") if scores[level]["n"])
    sys.stdout.write(f"{head} {card['unit']}\n{table(lines)}\n")
    if all(line.holds for line in lines):
        return 0
    sys.stderr.write("the processes said last:\n" + "\n".join(card["said"]) + "\n")
    return 1


def _run(body: Coroutine[Any, Any, Any]) -> Any:
    """Run a coroutine until SIGINT or SIGTERM, which stop all processes."""

    async def guarded() -> Any:
        main = asyncio.current_task()
        assert main is not None
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, main.cancel)
        return await body

    try:
        return asyncio.run(guarded())
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
