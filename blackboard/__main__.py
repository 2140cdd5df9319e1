"""The door of the blackboard: all commands, each loaded when it is asked for, so that a health check loads no pool and no grid."""

import sys
from typing import Literal

from blackboard.run import door

#: Module -> its commands, and what is said of each in `blackboard --help`.
COMMANDS = {
    "blackboard.commands": {
        "demo": "Run a whole team on this machine: six simulated robots and two objects, or a recorded real team.",
        "up": "Run every process of a scenario on this machine.",
        "serve": "Run the board of one sub-team until it is stopped.",
        "router": "Run a Zenoh router until it is stopped.",
        "scenario": "Print all keys of a scenario file with default, unit and meaning (Markdown).",
    },
    "blackboard.run.plan": {"plan": "Say how many teams, boards and levels a fleet needs, and what binds."},
    "blackboard.run.health": {"health": "Ask a process over Zenoh whether it does its work; exit status 1 where not."},
    "blackboard.lab.__main__": {
        "lab": "Fuse the same opinions with every rule and score the results.",
        "tune": "Choose a board's rule and parameters from simulated or recorded runs.",
        "figures": "Draw the paper's figures into a folder, and list the files.",
        "sweep": "Run a scenario with every combination of settings and seeds, and compare them.",
    },
    "blackboard.lab.score": {"score": "Score a recorded team: its robots, protocols, fusions."},
    "blackboard.lab.calibrate": {
        "calibrate": "Find what a team's wheels and cameras are like, from a tape or a recording, without the truth."
    },
    "blackboard.tape.__main__": {
        "record": "Record every message of a running team onto a tape.",
        "replay": "Replay a tape into boards, or into a live network, and ask what other boards would have made of it.\n\n"
        "Each board gets what its journal says, at the same times, as fast as the machine can: its consensuses are the recorded "
        "ones to the bit, and the exit status is 1 where they are not. With a change (--without, --rule, --fusion, --set, --lie, "
        "--loss) the boards are run anew on what the robots sent, and scorecards are shown side by side, with intervals of the "
        "differences. With --speed nothing is judged: the tape goes into a live network.",
        "tape": "Look at a tape, mend it, cut it, make a table of it, or export it.",
    },
    "blackboard.chaos.__main__": {"chaos": "Run a team under network trouble, case by case."},
    "blackboard.client.__main__": {"share": "Tell a team what another one agrees on: a tree of teams, or two sites."},
    "blackboard.bridges.__main__": {"ros": "Join a team to nodes of ROS 2 (extra `ros`)."},
    "blackboard.view.__main__": {
        "why": "Say why a team that runs or is on a tape believes what it believes about a subject.",
        "status": "Show teams, processes and beliefs, once or again and again.",
        "echo": "Print every message on a key expression, decoded.",
        "hz": "Print how often messages come on each key.",
        "top": "Show a running team in this terminal: who is there, heat maps, reasons (extra `tui`).",
        "view": "Serve a live page of a running team, or a page of a tape (extra `web`).",
    },
}

#: What `blackboard --help` shows together, in this order.
GROUPS = {
    "Run a team": "demo up serve router share ros",
    "Look at it": "status why view top health echo hz",
    "Keep it, and ask what if": "record replay tape",
    "Compare and measure": "sweep lab tune score calibrate figures chaos plan",
    "Set up": "scenario keys completion",
}
GROUP_OF = door.groups(GROUPS)

app = door.new_app(
    "blackboard", "A distributed blackboard for robot teams: beliefs fused with the Cooperative Opinion Pool."
)
for module, commands in COMMANDS.items():
    for command, about in commands.items():
        app.command(f"{module}:{command}", name=command, help=about, group=GROUP_OF[command])
app.command(
    "blackboard.run.keys:app",
    name="keys",
    help="Make and revoke the certificates that shut a team's door.",
    group=GROUP_OF["keys"],
)


@app.command(group=GROUP_OF["completion"])
def completion(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print what completes the commands and flags of `blackboard` in a shell, as `source <(blackboard completion bash)`."""
    sys.stdout.write(app.generate_completion(prog_name="blackboard", shell=shell))
    return 0


def main() -> None:
    """Run the command line."""
    door.main(app)


if __name__ == "__main__":
    main()
