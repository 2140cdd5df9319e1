"""The door of the blackboard: `blackboard demo | up | serve | router | health | lab | tune | figures`."""

from __future__ import annotations

import importlib
import json
import socket
import sys
from typing import Annotated, Literal

from cyclopts import App, Parameter

from blackboard import door
from blackboard.config import Scenario, load
from blackboard.errors import Mistake
from blackboard.progress import progress

app = App(
    name="blackboard", help="A distributed blackboard for robot teams: beliefs fused with the Cooperative Opinion Pool."
)

for command, about in {
    "lab": "Put all rules to the same opinions and show how each did.",
    "tune": "Choose a board's rule and parameters from simulated or recorded runs.",
    "figures": "Draw the paper's figures and print the numbers behind them.",
}.items():
    app.command(f"blackboard.lab.__main__:{command}", name=command, help=about)  # loaded when it is asked for

Flag = Parameter(negative="")


@app.command
def demo(
    *,
    robots: int | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    realtime: Annotated[bool, Flag] = False,
    mrclam: str | None = None,
    start: float | None = None,
    protocol: str | None = None,
    rule: str | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
    flags: door.ZenohFlags | None = None,
) -> int:
    """Run a whole team on this machine: six simulated robots in two sub-teams and two objects, or a recorded real team.

    Parameters
    ----------
    robots
        Another number of robots, spread over the sub-teams.
    seed
        Another seed than the scenario's.
    seconds
        Length of the run, in seconds of team time.
    realtime
        Pace by the wall clock instead of waiting for everybody.
    mrclam
        Replay the recorded team in this folder (MRCLAM format).
    start
        Where the replay begins, Unix time.
    protocol
        Which landmark sightings may be used, as A_all or C_blind12.
    rule
        Another rule than the scenario's for pooling first-hand beliefs.
    as_json
        Print the scorecard as one JSON object, and nothing else, on standard output.
    """
    scenario = load("mrclam" if mrclam else "demo")
    scenario = scenario.changed("world", dir=mrclam, start=start, protocol=protocol)
    return _run(scenario, robots, seed, seconds, realtime, rule, as_json, flags)


@app.command
def up(
    scenario: str,
    *,
    robots: int | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    realtime: Annotated[bool, Flag] = False,
    rule: str | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
    flags: door.ZenohFlags | None = None,
) -> int:
    """Run every process of a scenario on this machine.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package.
    robots
        Another number of robots, spread over the sub-teams.
    seed
        Another seed than the scenario's.
    seconds
        Length of the run, in seconds of team time.
    realtime
        Pace by the wall clock instead of waiting for everybody.
    rule
        Another rule than the scenario's for pooling first-hand beliefs.
    as_json
        Print the scorecard as one JSON object, and nothing else, on standard output.
    """
    return _run(load(scenario), robots, seed, seconds, realtime, rule, as_json, flags)


@app.command
def serve(
    *,
    team: str | None = None,
    sub_team: str,
    board: Annotated[str | None, Parameter(name="--id")] = None,
    scenario: str | None = None,
    flags: door.ZenohFlags | None = None,
) -> int:
    """Run the board of one sub-team until it is stopped.

    Parameters
    ----------
    team
        Name of the team [default: the scenario's].
    sub_team
        The sub-team whose reports it fuses.
    board
        Name of the board [default: board-SUB_TEAM].
    scenario
        A scenario file with the grid and the board's settings, or the name of one that comes with the package.
    """
    from blackboard.service import BoardService

    chosen = load(scenario) if scenario else Scenario({})
    name = board or f"board-{sub_team}"
    for what, value in (("--team", team or chosen.team.name), ("--sub-team", sub_team), ("--id", name)):
        door.check_name(what, value)
    service = BoardService(
        team=team or chosen.team.name,
        sub_team=sub_team,
        board=name,
        grid=chosen.grid,
        settings=chosen.board,
    )
    door.serve(service, name, flags or door.ZenohFlags())
    return 0


@app.command
def router(*, flags: door.ZenohFlags | None = None) -> int:
    """Run a Zenoh router until it is stopped; listens on tcp/127.0.0.1:7447 unless told otherwise with -l."""
    door.route(flags or door.ZenohFlags())
    return 0


@app.command
def health(
    kind: Literal["router", "world", "board", "robot"],
    *,
    process: Annotated[str | None, Parameter(name="--id")] = None,
    team: str = "demo",
    max_age: float = 5.0,
    flags: door.ZenohFlags | None = None,
) -> int:
    """Ask a process over Zenoh whether it does its work; exit status 1 and one line where it does not.

    Parameters
    ----------
    kind
        What the process is.
    process
        Its name [default: the name of this host].
    team
        Its team.
    max_age
        Seconds of team time after which a belief or a status is no longer fresh.
    """
    from blackboard.clock import Clock
    from blackboard.health import ailment
    from blackboard.link import Link

    name = process or socket.gethostname()
    with Link((flags or door.ZenohFlags()).link(), f"health-{name}", patience=3.0) as link:
        wrong = ailment(link, kind, name, Clock().now(), team=team, max_age=max_age)
    sys.stdout.write(f"{wrong or 'healthy'}\n")
    return 1 if wrong else 0


def _run(
    scenario: Scenario,
    robots: int | None,
    seed: int | None,
    seconds: float | None,
    realtime: bool,
    rule: str | None,
    as_json: bool,
    flags: door.ZenohFlags | None,
) -> int:
    from blackboard.launch import Failed, run_scenario

    scenario = scenario.changed("world", seed=seed).changed("board", rule=rule)
    scenario = scenario.changed("time", seconds=seconds, mode="realtime" if realtime else None)
    if robots is not None:
        scenario = scenario.changed("team", sub_teams=_spread(scenario, robots))
    _check(scenario)
    try:
        with progress(scenario.name) as tell:
            status, card = run_scenario(scenario, tell, flags.link() if flags else None)
    except Failed as failure:
        print(f"error: {failure}", file=sys.stderr)
        return 1
    text = importlib.import_module("sim_world.scorecard").text
    sys.stdout.write((json.dumps(card) if as_json else text(card)) + "\n")
    return status


def _check(scenario: Scenario) -> None:
    """Find a mistake in any section before anything starts; the other packages are named, not known (docs/design.md)."""
    _ = scenario.team, scenario.grid, scenario.time, scenario.board
    for section, module, model in (
        ("robot", "robot_agent.config", "RobotSection"),
        ("world", "sim_world.scenario", "WorldSection"),
    ):
        scenario.section(section, getattr(importlib.import_module(module), model))


def _spread(scenario: Scenario, robots: int) -> dict[str, list[str]]:
    """r1..rN over the scenario's sub-teams, in runs of equal length."""
    names = list(scenario.team.sub_teams)
    if robots < len(names):
        raise Mistake(f"--robots {robots}: at least {len(names)}, one for each sub-team")
    bounds = [round(i * robots / len(names)) for i in range(len(names) + 1)]
    return {
        name: [f"r{k + 1}" for k in range(low, high)]
        for name, low, high in zip(names, bounds, bounds[1:], strict=False)
    }


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
