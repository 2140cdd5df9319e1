"""The door of a robot: `robot-agent --team T --sub-team S --id r1`."""

from __future__ import annotations

import logging
import socket
from typing import Annotated

from cyclopts import App, Parameter

from blackboard.config import Scenario, load
from blackboard.run import door
from robot_agent.team import robot_of

log = logging.getLogger(__name__)

app = App(
    name="robot-agent",
    help="One robot of a team: it localises itself, reports what it believes, and takes its team's beliefs back.",
    version=door.version,
)


@app.default
def robot_agent(
    *,
    team: str | None = None,
    sub_team: Annotated[list[str] | None, Parameter(negative="")] = None,
    robot: Annotated[str | None, Parameter(name="--id")] = None,
    scenario: str | None = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run one robot until it is stopped.

    Parameters
    ----------
    team
        Name of the team [default: the scenario's].
    sub_team
        The sub-team it registers in; may be given again [default: those of the scenario, else one chosen by its name].
    robot
        Its name in the team [default: the name of this host].
    scenario
        A scenario file with the grid and the robot's models, or the name of one that comes with the package.
    """
    chosen = load(scenario) if scenario else Scenario({})
    name = robot or socket.gethostname()
    sub_teams = sub_team or chosen.team.of(name)
    for what, value in (("--team", team or chosen.team.name), ("--id", name), *(("--sub-team", s) for s in sub_teams)):
        door.check_name(what, value)
    for warning in chosen.unknown_sub_teams(sub_teams) if scenario else ():
        log.warning(warning)
    door.serve(robot_of(chosen, name, team=team, sub_teams=sub_teams), name, flags)
    return 0


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
