"""The commands of the blackboard that run processes: `blackboard demo | up | scenario | serve | router`."""

import logging
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from blackboard.config import Scenario, load
from blackboard.errors import UserError, extra
from blackboard.run import door
from blackboard.run.flags import MemberFlags, OutputFlags, RecordingFlags, RunFlags, TeamFlags, ViewFlags
from blackboard.run.progress import progress

log = logging.getLogger(__name__)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LaunchFlags:
    """Which team runs on this machine and how, and what is kept and shown of it."""

    team: TeamFlags = TeamFlags()
    run: RunFlags = RunFlags()
    look: ViewFlags = ViewFlags()
    record: Path | None = None
    "Record every message of the team onto this tape (MCAP)."
    output: OutputFlags = OutputFlags()
    flags: door.ZenohFlags = door.ZenohFlags()


def demo(*, recording: RecordingFlags = RecordingFlags(), how: LaunchFlags = LaunchFlags()) -> int:
    """Run a whole team on this machine: six simulated robots in two sub-teams and two objects, or a recorded real team."""
    return _run(recording.scenario(), how)


def up(scenario: str, *, how: LaunchFlags = LaunchFlags()) -> int:
    """Run every process of a scenario on this machine.

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of one that comes with the package.
    """
    return _run(load(scenario), how)


def scenario(section: Literal["team", "grid", "time", "board", "robot", "world", "fault"] | None = None) -> int:
    """Print all keys of a scenario file with default, unit and meaning (Markdown).

    Parameters
    ----------
    section
        Of this section only.
    """
    from typing import get_args

    from blackboard import config, faults
    from blackboard.config.world import WorldSection
    from blackboard.run import reference
    from robot_agent.config import RobotSection

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


def serve(
    *,
    which: MemberFlags = MemberFlags(),
    sub_team: str,
    board: Annotated[str | None, Parameter(name="--id")] = None,
    guests: Literal["watch", "vote"] | None = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run the board of one sub-team until it is stopped; the scenario has the grid and the board's settings.

    Parameters
    ----------
    sub_team
        The sub-team whose reports it fuses.
    board
        Name of the board [default: board-SUB_TEAM].
    guests
        Whether robots that the scenario does not name are heard [default: the scenario's].
    """
    from blackboard.board.service import board_of
    from blackboard.tape.journal import Journaled

    chosen, name = which.chosen().changed("team", guests=guests), board or f"board-{sub_team}"
    which.check_member(chosen, name, [sub_team])
    service = board_of(chosen, sub_team, name)
    journaled = Journaled(service, team=service.team, sub_team=sub_team, board=name)
    door.serve(journaled, name, flags, within=door.PROMPT)
    return 0


def router(*, flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Run a Zenoh router until it is stopped; listens on tcp/127.0.0.1:7447 (with --keys tls/) unless -l gives other endpoints."""
    door.route(flags)
    return 0


def _run(scenario: Scenario, how: LaunchFlags) -> int:
    from blackboard.judge.card import text
    from blackboard.judge.files import check_folder, check_table
    from blackboard.run.browser import can_open
    from blackboard.run.launch import Interrupted, TapeIncomplete, run_scenario

    scenario, run, look, record = how.run.apply(how.team.apply(scenario)), how.run, how.look, how.record
    _check(scenario)
    if run.table is not None:
        check_table(run.table, "--table")
    if look.plot is not None:
        check_folder(look.plot, "--plot")
    if record is not None:
        from blackboard.tape.file import check_new

        check_new(record)
    incomplete: TapeIncomplete | None = None
    opens = look.view and can_open(terminal=sys.stdout.isatty(), environment=os.environ)
    with _samples(scenario, run.table, look.plot) as samples:
        with progress(scenario.name, lines=False) as show_progress:
            try:
                status, card = run_scenario(
                    scenario, show_progress, how.flags.link(), samples, record, view=look.view, open_page=opens
                )
            except Interrupted as stopped:
                status, card = door.INTERRUPTED, stopped.card
            except TapeIncomplete as found:
                status, card, incomplete = door.FAILED, found.card, found
        how.output.show(card, text)
    if incomplete is not None:
        raise incomplete
    return status


@contextmanager
def _samples(scenario: Scenario, table: Path | None, plot: Path | None) -> Iterator[Path | None]:
    """Where the world writes its samples; afterwards they are drawn into `plot`, and written as `table` where that is no CSV."""
    if plot is None:
        yield table
        return
    with extra("plot", "--plot"):
        from blackboard.lab import run_drawing
    from blackboard.config.world import WorldSection
    from blackboard.judge.samples import read_series, series_file

    with tempfile.TemporaryDirectory(prefix="blackboard-") as folder:
        file = table if table is not None and table.suffix == ".csv" else Path(folder) / "samples.csv"
        yield file
        samples = read_series(file)
        with series_file(table if table != file else None) as record:
            for sample in samples if record is not None else ():
                record(sample)  # type: ignore[misc]  # not None where there are any
        title = f"{scenario.name}, seed {scenario.section('world', WorldSection).seed}"
        files = run_drawing.draw_run(samples, scenario.grid.unit, plot, title)
        sys.stderr.writelines(f"drawn: {each}\n" for each in files)


def _check(scenario: Scenario) -> None:
    """Validate every section of a scenario before anything starts, also those that only robots and the world read.

    Mistakes that only two sections together show are reported here too; a process that is started alone does not look for them.
    """
    from blackboard.config.world import check_world
    from blackboard.faults import faults_of
    from robot_agent.config import RobotSection, check_robots

    _ = scenario.grid, scenario.time
    check_robots(scenario)
    robot = scenario.section("robot", RobotSection)
    if robot.send.budget is not None and robot.send.longest >= scenario.board.max_age:
        raise UserError(
            f"{scenario.where}: robot.send.longest: boards forget what is older than board.max_age, "
            f"{scenario.board.max_age:g} s; give less, not {robot.send.longest:g}"
        )
    if not scenario.team.robots:
        raise UserError(f"{scenario.where}: team.sub_teams: no robot in any sub-team; name one at least")
    for warning in check_world(scenario):
        log.warning(warning)
    faults_of(scenario)
