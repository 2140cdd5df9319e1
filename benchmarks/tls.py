"""What keys cost: latency and processor time of messages through a router, plain and with mutual TLS and access control.

Run `python benchmarks/tls.py` from the repository (extra `keys`). Everything is on 127.0.0.1 and the two ends share a process,
so that the ratios say more than the numbers.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from programs import Program, program

from blackboard.access import directory
from blackboard.config import TeamSection
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope

TEAM = TeamSection(name="t", sub_teams={"a": ["r1"]})
ASK, ANSWER = "cop/t/a/status/r1", "cop/t/a/status/board-a"
ROUNDS = 4  # of which the best is shown, because others may use the machine


@contextmanager
def router(keys: str | None, log: bool) -> Iterator[tuple[str, Program]]:
    """A router and its endpoint. Without `log` Zenoh does not tell what it denies."""
    endpoint = f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
    flags = ["--keys", keys] if keys else []
    environment = {} if log or not keys else {"RUST_LOG": "error"}
    with program("-m", "blackboard", "router", "-l", endpoint, *flags, **environment) as running:
        yield endpoint, running


def bounce(one: Link, other: Link, payload: bytes) -> float:
    """Seconds for a message there and one back."""
    began = time.perf_counter()
    one.send(Envelope(ASK, payload))
    while not other.receive(5.0):
        pass
    other.send(Envelope(ANSWER, payload))
    while not one.receive(5.0):
        pass
    return time.perf_counter() - began


def measure(keys: str | None, log: bool, size: int, number: int) -> tuple[float, ...]:
    """Milliseconds there and back (median, 99 %), and microseconds of a processor for each message (router, both ends)."""
    with router(keys, log) as (endpoint, between):
        ends = [Link(LinkConfig(connect=(endpoint,), keys=keys, who=w), w) for w in ("robot/r1", "board/board-a")]
        with ends[0] as one, ends[1] as other:
            one.subscribe(ANSWER)
            other.subscribe("cop/t/*/status/*")
            payload = os.urandom(size)
            while not other.receive(0.05):
                one.send(Envelope(ASK, payload))
            while one.receive(0.05) or other.receive(0.2):  # take what is still on its way
                pass
            other.send(Envelope(ANSWER, payload))
            one.receive(1.0)
            before, here = between.processor_seconds(), time.process_time()
            times = sorted(bounce(one, other, payload) for _ in range(number))
            spent, mine = between.processor_seconds() - before, time.process_time() - here
    median, late = times[number // 2], times[int(number * 0.99)]
    per = 1e6 / (2 * number)
    return 1e3 * median, 1e3 * late, per * spent, per * mine


def demo(keys: str | None, seconds: str) -> str:
    """Wall and processor seconds of a demo with three robots, and the first digits of its hash."""
    command = [sys.executable, "-m", "blackboard", "demo", "--robots", "3", "--seconds", seconds, "--json"]
    began, before = time.perf_counter(), os.times()
    done = subprocess.run([*command, *(["--keys", keys] if keys else [])], capture_output=True, text=True, check=False)
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return f"{time.perf_counter() - began:6.1f} s, {spent:6.1f} s of processors, hash {json.loads(done.stdout)['hash'][:12]}"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        keys, demo_keys = Path(folder) / "keys", Path(folder) / "demo"
        directory.init(keys, TEAM, (), time.time(), 30.0, force=False)
        three = TeamSection(sub_teams={"a": ["r1", "r2"], "b": ["r3"]})
        directory.init(demo_keys, three, (), time.time(), 30.0, force=False)
        print("there and back: ms median, ms 99 %, and microseconds of a processor for each message: router, both ends")
        ways = (("plain", None, True), ("keys", str(keys), True), ("keys, denials not told", str(keys), False))
        for size in (1 << 10, 1 << 14, 1 << 18):
            number = 2000 if size < 1 << 18 else 500
            runs = [[measure(where, log, size, number) for _, where, log in ways] for _ in range(ROUNDS)]
            for (name, _, _), results in zip(ways, zip(*runs, strict=True), strict=True):
                best = [min(column) for column in zip(*results, strict=True)]
                print(f"  {size >> 10:4} KiB {name:24}", *(f"{value:9.3f}" for value in best))
        print("demo of three robots, 20 s of team time in lockstep")
        for name, where in (("plain", None), ("keys", str(demo_keys))) * 2:
            print(f"  {name:8} {demo(where, '20')}")


if __name__ == "__main__":
    main()
