"""Three robots on a field, each with wheels and a camera, one with GPS; `Robot` gives each its place in the team.

    blackboard router -l tcp/127.0.0.1:7447
    blackboard serve --scenario examples/field/field.toml --sub-team a -e tcp/127.0.0.1:7447
    python -m examples.field.client -e tcp/127.0.0.1:7447 --seconds 30

Where they really are is made up in world.py. At the end it prints how far off each was.
"""

import argparse
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from blackboard.client import Robot
from examples.field.world import ROBOTS, Said, World

HERE = Path(__file__).parent


def tell(robot: Robot, said: Said, world: World) -> None:
    """What the sensors say, and how exact they are."""
    truth = world.truth
    if said.start is not None:
        x, y, heading = said.start
        robot.fix((x, y), truth.start, heading, truth.start_heading)
    else:
        robot.odometry(said.distance, said.turn, said.dt)
    if said.gps is not None:
        robot.fix(said.gps, truth.gps)
    for sighting in said.seen:
        robot.see(sighting.subject, sighting.range, sighting.bearing, truth.range, truth.bearing)


def main(args: argparse.Namespace, tell: Callable[[Robot, Said, World], None] = tell) -> None:
    world, off = World(args.seed), dict[str, list[float]]()
    with ExitStack() as stack:
        robots = {n: stack.enter_context(Robot(n, HERE / "field.toml", endpoint=args.connect)) for n in args.robots}
        for at, said in each_step(world, args):
            for name, robot in robots.items():
                tell(robot, said[name], world)
                pose = robot.step(time=at)  # when it was measured, because the loop may be late
                if pose is not None:
                    off.setdefault(name, []).append(math.dist(pose.mean[:2], world.poses[name][:2]))
        for name, robot in robots.items():
            report(name, off[name], robot.agreed["object/ball"].belief.mean())


def each_step(world: World, args: argparse.Namespace) -> Iterator[tuple[float, Mapping[str, Said]]]:
    """The steps of a world as time goes on, each with its Unix time (s)."""
    pause, begin = threading.Event(), max(args.begin, time.time())
    for number, said in enumerate(world.steps(args.seconds)):
        at = begin + number * world.truth.dt
        pause.wait(max(0.0, at - time.time()))
        yield at, said


def report(name: str, off: list[float], ball: np.ndarray) -> None:
    """Print how far off a robot was."""
    rmse = math.sqrt(sum(distance**2 for distance in off) / len(off))
    print(f"{name}: RMSE {rmse:.2f} m; ball at {ball.round(1)}", flush=True)


def parser(about: str | None) -> argparse.ArgumentParser:
    arguments = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("-e", "--connect", default="tcp/127.0.0.1:7447")
    arguments.add_argument("--seconds", type=float, default=30.0)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--robots", nargs="+", default=ROBOTS, choices=ROBOTS, help="play these alone")
    arguments.add_argument("--begin", type=float, default=0.0, help="Unix time at which programs of one world begin")
    return arguments


if __name__ == "__main__":
    main(parser(__doc__).parse_args())
