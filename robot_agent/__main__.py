"""The door of a robot: `robot-agent --team T --sub-team S --id r1`."""

import socket
from typing import Annotated

from cyclopts import App, Parameter

from blackboard.run import door
from blackboard.run.flags import MemberFlags
from robot_agent.team import robot_of

app = App(
    name="robot-agent",
    help="One robot of a team: it localises itself, reports what it believes, and takes its team's beliefs back.",
    version=door.version,
)


@app.default
def robot_agent(
    *,
    which: MemberFlags = MemberFlags(),
    sub_team: Annotated[list[str] | None, Parameter(negative="")] = None,
    robot: Annotated[str | None, Parameter(name="--id")] = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run one robot until it is stopped; the scenario has the grid and the robot's models.

    Parameters
    ----------
    sub_team
        The sub-team it registers in; may be given again [default: those of the scenario, else one chosen by its name].
    robot
        Its name in the team [default: the name of this host].
    """
    chosen, name = which.chosen(), robot or socket.gethostname()
    sub_teams = sub_team or chosen.team.of(name)
    which.check_member(chosen, name, sub_teams)
    door.serve(robot_of(chosen, name, sub_teams=sub_teams), name, flags, within=door.PROMPT)
    return 0


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
