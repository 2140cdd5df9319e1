"""The robot of minimal_robot.py with the client: it stands still, reports itself and a ball, and prints what its team agrees on."""

import argparse
import signal
import sys
import threading
import time

import numpy as np

from blackboard import Belief
from blackboard.client import Team


def main(args: argparse.Namespace) -> None:
    pause, end = threading.Event(), time.monotonic() + args.seconds
    with Team(args.id, args.scenario, endpoint=args.connect, team=args.team, sub_team=args.sub_team) as team:
        team.on_agreed(lambda agreed: print(agreed.tick, agreed.subject, *agreed.belief.mode().round(3), flush=True))
        while time.monotonic() < end:
            team.report(f"robot/{args.id}", Belief.from_gaussian(team.grid, args.at, np.eye(2)))
            team.report("object/ball", Belief.from_gaussian(team.grid, np.add(args.at, 5), 4 * np.eye(2)))
            pause.wait(0.2)


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-e", "--connect", default="tcp/127.0.0.1:7447")
    for name in ("--team", "--sub-team", "--scenario"):
        parser.add_argument(name)
    parser.add_argument("--id", required=True)
    parser.add_argument("--at", nargs=2, type=float, default=[10.0, 10.0])
    parser.add_argument("--seconds", type=float, default=float("inf"))
    main(parser.parse_args())
