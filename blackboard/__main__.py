"""The door of the blackboard: `blackboard demo | up | serve | router | health`, and those of other rooms, loaded when asked for.

Long, because it is the door of many commands, each with its flags.
"""

from __future__ import annotations

import os
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from blackboard.config import Scenario, load
from blackboard.errors import UserError
from blackboard.run import door
from blackboard.run.flags import OutputFlags, RecordingFlags, RunFlags, TeamFlags, ViewFlags
from blackboard.run.progress import progress

app = App(
    name="blackboard",
    help="A distributed blackboard for robot teams: beliefs fused with the Cooperative Opinion Pool.",
    version=door.version,
)

for command, about in {
    "lab": "Fuse the same opinions with every rule and score the results.",
    "tune": "Choose a board's rule and parameters from simulated or recorded runs.",
    "figures": "Draw the paper's figures into a folder, and list the files.",
    "sweep": "Run a scenario with every combination of settings and seeds, and compare them.",
}.items():
    app.command(f"blackboard.lab.__main__:{command}", name=command, help=about)  # loaded when it is asked for
for command, about in {
    "record": "Record every message of a running team onto a tape.",
    "replay": "Replay a tape into boards, or into a live network, and ask what other boards would have made of it.\n\n"
    "Each board gets what its journal says, at the same times, as fast as the machine can: its consensuses are the recorded ones "
    "to the bit, and the exit status is 1 where they are not. With a change (--without, --rule, --fusion, --set, --lie, --loss) "
    "the boards are run anew on what the robots sent, and scorecards are shown side by side, with intervals of the differences. "
    "With --speed nothing is judged: the tape goes into a live network.",
}.items():
    app.command(f"blackboard.tape.__main__:{command}", name=command, help=about)
app.command(
    "blackboard.tape.__main__:tape",
    name="tape",
    help="Look at a tape, mend it, cut it, make a table of it, or export it.",
)
app.command("blackboard.lab.score:score", name="score", help="Score a recorded team: its robots, protocols, fusions.")

app.command("blackboard.chaos.__main__:chaos", name="chaos", help="Run a team under network trouble, case by case.")

app.command("blackboard.bridges.__main__:ros", name="ros", help="Join a team to nodes of ROS 2 (extra `ros`).")

app.command("blackboard.run.keys:app", name="keys", help="Make and revoke the certificates that shut a team's door.")

for command, about in {
    "why": "Say why a team that runs or is on a tape believes what it believes about a subject.",
    "status": "Show teams, processes and beliefs, once or again and again.",
    "echo": "Print every message on a key expression, decoded.",
    "hz": "Print how often messages come on each key.",
    "top": "Show a running team in this terminal: who is there, heat maps, reasons (extra `tui`).",
    "view": "Serve a live page of a running team, or a page of a tape (extra `web`).",
}.items():
    app.command(f"blackboard.view.__main__:{command}", name=command, help=about)


@app.command
def demo(
    *,
    team: TeamFlags = TeamFlags(),
    run: RunFlags = RunFlags(),
    recording: RecordingFlags = RecordingFlags(),
    look: ViewFlags = ViewFlags(),
    record: Path | None = None,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run a whole team on this machine: six simulated robots in two sub-teams and two objects, or a recorded real team.

    Parameters
    ----------
    record
        Record every message of the team onto this tape (MCAP).
    """
    return _run(run.apply(team.apply(recording.scenario())), run, look, record, output, flags)


@app.command
def up(
    scenario: str,
    *,
    team: TeamFlags = TeamFlags(),
    run: RunFlags = RunFlags(),
    look: ViewFlags = ViewFlags(),
    record: Path | None = None,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run every process of a scenario on this machine.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package.
    record
        Record every message of the team onto this tape (MCAP).
    """
    return _run(run.apply(team.apply(load(scenario))), run, look, record, output, flags)


@app.command
def scenario(section: Literal["team", "grid", "time", "board", "robot", "world", "fault"] | None = None) -> int:
    """Print all keys of a scenario file with default, unit and meaning (Markdown).

    Parameters
    ----------
    section
        Of this section only.
    """
    from typing import get_args

    from blackboard import config, faults
    from blackboard.run import reference
    from robot_agent.config import RobotSection
    from sim_world.scenario import WorldSection

    sections: dict[str, type[config.Section]] = {
        "team": config.TeamSection,
        "grid": config.GridSection,
        "time": config.TimeSection,
        "board": config.BoardSection,
        "robot": RobotSection,
        "world": WorldSection,
    }
    kinds = dict(zip(faults.KINDS, get_args(faults.AnyFault), strict=True))
    if section is None:
        text = reference.page(sections, kinds)
    else:
        text = reference.faults(kinds) if section == "fault" else reference.section(section, sections[section])
    sys.stdout.write(text)
    return 0


@app.command
def completion(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print what completes the commands and flags of `blackboard` in a shell, as `source <(blackboard completion bash)`."""
    sys.stdout.write(app.generate_completion(prog_name="blackboard", shell=shell))
    return 0


@app.command
def serve(
    *,
    team: str | None = None,
    sub_team: str,
    board: Annotated[str | None, Parameter(name="--id")] = None,
    scenario: str | None = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
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
    from blackboard.board.service import BoardService
    from blackboard.tape.journal import Journaled

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
    journaled = Journaled(service, team=service.team, sub_team=sub_team, board=name)
    door.serve(journaled, name, flags)
    return 0


@app.command
def router(*, flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Run a Zenoh router until it is stopped; listens on tcp/127.0.0.1:7447 (with --keys tls/) unless -l gives other endpoints."""
    door.route(flags)
    return 0


@app.command
def health(
    kind: Literal["router", "world", "board", "robot"],
    *,
    process: Annotated[str | None, Parameter(name="--id")] = None,
    team: str | None = None,
    scenario: str | None = None,
    max_age: float = 5.0,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Ask a process over Zenoh whether it does its work; exit status 1 and one line where it does not.

    Parameters
    ----------
    kind
        What the process is.
    process
        Its name [default: the name of this host].
    team
        Its team [default: the scenario's].
    scenario
        The team's scenario, a file or the name of one that comes with the package [default: demo].
    max_age
        Seconds of team time after which a belief or a status is no longer fresh.
    """
    from blackboard.net.link import Link
    from blackboard.process.clock import UnixClock
    from blackboard.run.health import diagnose, part

    name, of = process or socket.gethostname(), team or load(scenario or "demo").team.name
    door.check_name("--team", of)
    # with keys it is asked as the process itself, so that it is also found out whether the router lets this certificate in
    who = {"router": "health", "world": "world"}.get(kind, f"{kind}/{name}")
    with Link(flags.link(who=who), f"health-{name}", patience=3.0) as link:
        fault = link.denials() or diagnose(link, kind, name, UnixClock().now(), team=of, max_age=max_age)
        found = fault or "healthy" + part(link, kind, name, team=of)
    sys.stdout.write(f"{found}\n")
    return 1 if fault else 0


def _run(
    scenario: Scenario,
    run: RunFlags,
    look: ViewFlags,
    record: Path | None,
    output: OutputFlags,
    flags: door.ZenohFlags,
) -> int:
    from blackboard.run.browser import can_open
    from blackboard.run.launch import Interrupted, run_scenario
    from sim_world.scorecard import text
    from sim_world.table import check_table

    _check(scenario)
    if run.table is not None:
        check_table(run.table, "--table")
    if record is not None:
        from blackboard.tape.file import check_new

        check_new(record)
    opens = look.view and can_open(terminal=sys.stdout.isatty(), environment=os.environ)
    with _samples(scenario, run.table, look.plot) as samples:
        with progress(scenario.name) as show_progress:
            try:
                status, card = run_scenario(
                    scenario, show_progress, flags.link(), samples, record, view=look.view, open_page=opens
                )
            except Interrupted as stopped:
                status, card = door.INTERRUPTED, stopped.card
        output.show(card, text)
    return status


@contextmanager
def _samples(scenario: Scenario, table: Path | None, plot: Path | None) -> Iterator[Path | None]:
    """Where the world writes its samples; afterwards they are drawn into `plot`, and written as `table` where that is no CSV."""
    if plot is None:
        yield table
        return
    try:
        from blackboard.lab import run_drawing
    except ModuleNotFoundError as error:
        raise UserError(f"--plot: {error.name} is missing; pip install 'cop-blackboard[plot]'") from error
    from sim_world.series import read_series, series_file

    with tempfile.TemporaryDirectory(prefix="blackboard-") as folder:
        file = table if table is not None and table.suffix == ".csv" else Path(folder) / "samples.csv"
        yield file
        samples = read_series(file)
        with series_file(table if table != file else None) as record:
            for sample in samples if record is not None else ():
                record(sample)  # type: ignore[misc]  # not None where there are any
        files = run_drawing.draw_run(samples, scenario.grid.unit, plot)
        sys.stderr.writelines(f"drawn: {each}\n" for each in files)


def _check(scenario: Scenario) -> None:
    """Validate every section of a scenario before anything starts, also those that only robots and the world read."""
    from blackboard.faults import faults_of
    from robot_agent.config import RobotSection
    from sim_world.scenario import WorldSection

    _ = scenario.team, scenario.grid, scenario.time, scenario.board
    scenario.section("robot", RobotSection)
    scenario.section("world", WorldSection)
    faults_of(scenario)


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
