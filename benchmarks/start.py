"""What does a process cost before it does anything? `python benchmarks/start.py`.

Processor seconds of commands, the best of several; the memory of a robot and a board; and how long they take from `exec` until they
are ready (wall time, the best of several). A router runs beside them on 127.0.0.1.
"""

import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from programs import Program, program
from ratios import Measured, show

ENDPOINT = "tcp/127.0.0.1:17994"
ROUNDS = 5
IDLE = 8.0  # seconds that a board is watched
BIN = Path(sys.executable).parent


def cpu(*command: str) -> float:
    """Processor seconds of a command that ends by itself, the best of `ROUNDS`."""
    times = []
    for _ in range(ROUNDS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return min(times)


def seconds_to_ready(*command: str) -> float:
    """From `exec` until a program is ready, the best of `ROUNDS`."""
    times = []
    for _ in range(ROUNDS):
        begin = time.monotonic()
        with program(*command):
            times.append(time.monotonic() - begin)
    return min(times)


def idle_share(running: Program) -> float:
    """How much of a core a program uses while no message comes, in percent."""
    before = running.processor_seconds()
    try:
        running.process.wait(IDLE)
    except subprocess.TimeoutExpired:
        return 100 * (running.processor_seconds() - before) / IDLE
    raise RuntimeError(f"{running.process.args!r} ended")


def rows() -> Iterator[Measured]:
    numpy = cpu(sys.executable, "-c", "import numpy")
    yield Measured("import blackboard, processor time", cpu(sys.executable, "-c", "import blackboard"), "s", most=0.15)
    yield Measured("import numpy, which is in everything below", numpy, "s")
    blackboard, agent = str(BIN / "blackboard"), str(BIN / "robot-agent")
    team = ("--team", "demo", "--sub-team", "a", "--scenario", "demo", "-e", ENDPOINT)
    with program(blackboard, "router", "-l", ENDPOINT):
        health = cpu(blackboard, "health", "router", "-e", ENDPOINT)
        yield Measured("blackboard health, processor time", health, "s", most=0.2)
        for kind, command in (("board", (blackboard, "serve", *team)), ("robot", (agent, "--id", "r1", *team))):
            yield Measured(f"a {kind}, exec to ready", seconds_to_ready(*command), "s", most=0.8)
            with program(*command) as running:
                yield Measured(f"an idle {kind}, share of a core", idle_share(running), "%", most=1.0)
                yield Measured(f"an idle {kind}, resident", running.mebibytes(), "MiB", most=80.0)


if __name__ == "__main__":
    show(rows())
