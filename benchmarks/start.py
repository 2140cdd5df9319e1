"""What does a process cost before it does anything? `python benchmarks/start.py`.

Processor seconds of commands, the best of several; the memory of a robot and a board; and how long they take from `exec` until they
are ready (wall time, the best of several). A router runs beside them on 127.0.0.1.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from ratios import Row, show

ENDPOINT = "tcp/127.0.0.1:17994"
ROUNDS = 5
IDLE = 8.0  # seconds that a board is watched
BIN = Path(sys.executable).parent


def cpu(*command: str) -> float:
    """Processor seconds of a command that ends by itself, the best of `ROUNDS`."""
    found = []
    for _ in range(ROUNDS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return min(found)


def started(*command: str) -> subprocess.Popen[str]:
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def ready(process: subprocess.Popen[str], word: str) -> None:
    """Wait until a process has said a word."""
    assert process.stderr is not None
    for line in process.stderr:
        if word in line:
            return
    raise RuntimeError(f"{process.args!r} ended without a line with {word!r}")


def stop(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=10)


def seconds_of(pid: int) -> float:
    """Processor seconds that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def mebibytes(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def rows() -> Iterator[Row]:
    numpy = cpu(sys.executable, "-c", "import numpy")
    yield Row("import blackboard, processor time", cpu(sys.executable, "-c", "import blackboard"), "s", most=0.15)
    yield Row("import numpy, which is in everything below", numpy, "s")
    router = started(str(BIN / "blackboard"), "router", "-l", ENDPOINT)
    try:
        ready(router, "ready")
        health = cpu(str(BIN / "blackboard"), "health", "router", "-e", ENDPOINT)
        yield Row("blackboard health, processor time", health, "s", most=0.2)
        commands = {
            "board": (str(BIN / "blackboard"), "serve", "--team", "demo", "--sub-team", "a", "--scenario", "demo"),
            "robot": (
                str(BIN / "robot-agent"),
                "--team",
                "demo",
                "--sub-team",
                "a",
                "--id",
                "r1",
                "--scenario",
                "demo",
            ),
        }
        for kind, command in commands.items():
            found = []
            for _ in range(ROUNDS):
                begin = time.monotonic()
                process = started(*command, "-e", ENDPOINT)
                ready(process, "ready")
                found.append(time.monotonic() - begin)
                if len(found) < ROUNDS:
                    stop(process)
            yield Row(f"a {kind}, exec to ready", min(found), "s", most=0.8)
            before = seconds_of(process.pid)
            try:
                process.wait(IDLE)
            except subprocess.TimeoutExpired:
                used = seconds_of(process.pid) - before
            else:
                raise RuntimeError(f"the {kind} ended")
            yield Row(f"an idle {kind}, share of a core", 100 * used / IDLE, "%", most=1.0)
            yield Row(f"an idle {kind}, resident", mebibytes(process.pid), "MiB", most=80.0)
            stop(process)
    finally:
        stop(router)


if __name__ == "__main__":
    show(rows())
