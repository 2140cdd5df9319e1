"""What does a tick cost a real board and router? `python benchmarks/costs.py 4 8 16 32 48 [--fusion joint]`.

One team without shares, in real time at 1 Hz on 127.0.0.1. Its robots say what robots of the demo said in virtual time. The numbers
at the end are those by which `blackboard plan` reckons: the a and b of a n + b n^2 for n robots.
"""

import argparse
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fleet import Fleet
from programs import program
from recorded import Said, Voice, record

from blackboard.net.link import Link
from blackboard.net.scheduler import BEGIN
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from blackboard.wire import keys
from blackboard.wire.envelope import Kind

EARLY, TIMED = 3.5, 20.0  # seconds: until the team is under way, and of which processes are timed
SETTLED = 0.95  # of the ticks: a board that left more out has not done the work that is fitted


@dataclass(frozen=True)
class Cost:
    """Of a tick of one team without shares, in real time at 1 Hz."""

    board: float  # ms of the processor, of the board's process
    router: float  # the same
    out: float  # kB of all robots
    into: float  # kB into one robot
    settled: float  # share of the ticks


def cost(robots: int, fusion: str) -> Cost:
    """Processor time of a real board and router; bytes as in virtual time."""
    recording = record(robots, fusion, EARLY + TIMED)
    alone = Fleet({"fleet": recording}, [])
    alone.run(EARLY)
    alone.count_anew()
    alone.run(TIMED)
    crew, endpoint = alone.robots["fleet"], f"tcp/127.0.0.1:{free_port()}"
    assert isinstance(crew.inner, Voice)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        file = Path(folder) / "fleet.json"
        file.write_text(recording.scenario.to_json())
        router = stack.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        serve = ("-m", "blackboard", "serve", "--scenario", str(file), "--sub-team", "a", "-e", endpoint)
        board = stack.enter_context(program(*serve))
        link = stack.enter_context(Link(LinkConfig(connect=(endpoint,)), "fleet"))
        for token in (keys.WORLD.key(team="fleet"), *crew.tokens):
            link.token(token)
        link.subscribe(keys.AGREED.key(team="fleet", sub_team="a", subject="robot/r1"))
        said = sorted([*recording.world, *recording.robots], key=lambda pair: pair[0])
        begin = time.monotonic() - BEGIN
        _play(link, [pair for pair in said if pair[0] < BEGIN + EARLY], begin)
        before = board.processor_seconds(), router.processor_seconds()
        settled = _play(link, [pair for pair in said if BEGIN + EARLY <= pair[0] < BEGIN + EARLY + TIMED], begin)
        spent = [
            1e3 * (process.processor_seconds() - was) for process, was in zip((board, router), before, strict=True)
        ]
    of = crew.spent
    return Cost(*(number / TIMED for number in (*spent, of.out / 1e3, of.into / 1e3, settled)))


def _play(link: Link, said: Said, begin: float) -> int:
    """Send each at its time, which `begin` makes one of this process; how many ticks were settled meanwhile."""
    settled = 0
    for at, envelope in said:
        while (left := begin + at - time.monotonic()) > 0:
            settled += sum(answer.kind is Kind.PUT for answer in link.receive(left))
        link.send(envelope)
    return settled


def fitted(costs: Mapping[int, float]) -> tuple[float, float]:
    """The a and b of a n + b n^2, least squares of the relative errors; neither is negative."""
    n, value = np.array([*costs], dtype=float), np.array([*costs.values()])
    rows = np.stack([n, n**2], axis=1) / value[:, None]
    both = np.linalg.lstsq(rows, np.ones(len(n)), rcond=None)[0]
    if (both >= 0).all():
        return float(both[0]), float(both[1])
    alone = rows.sum(axis=0) / (rows**2).sum(axis=0)
    errors = ((rows * alone - 1) ** 2).sum(axis=0)
    return (float(alone[0]), 0.0) if errors[0] < errors[1] else (0.0, float(alone[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", type=int, nargs="+", help="sizes of the team")
    parser.add_argument("--fusion", choices=("opinions", "joint"), default="opinions")
    args = parser.parse_args()
    by_size = {}
    for robots in args.robots:
        by_size[robots] = cost(robots, args.fusion)
        print(f"{robots} robots: {by_size[robots]}", flush=True)
    timely = {robots: measured for robots, measured in by_size.items() if measured.settled > SETTLED}
    print("board, ms:", fitted({robots: measured.board for robots, measured in timely.items()}))
    print("out, kB:", fitted({robots: measured.out for robots, measured in by_size.items()}))
    print("into, kB:", fitted({robots: measured.into for robots, measured in by_size.items()}), flush=True)


if __name__ == "__main__":
    main()
