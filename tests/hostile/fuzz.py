"""A fuzz of every message type that knows their structure: changed messages of a running team, sent to all of its services.

`python -m tests.hostile.fuzz --count 100000 --seed 1` sends so many in runs of `PER_RUN`; it ends with status 1 where a service met an exception, a
run did not come to its end, or a service holds more than its bounds. Each run is repeated by its own seed.
"""

import argparse
import logging
import multiprocessing
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import msgpack
import numpy as np

from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from tests.hostile.examples import RICH
from tests.scenarios import JOINT, SCENARIO
from tests.wire.messages import TOPICS, as_map

PER_RUN = 500
TELL = 100_000  # messages between two lines that say how far it is
SECONDS = 600.0  # of bus time until a run must have ended

NUMBERS = (
    0, 1, -1, 0.5, 3, 4, 1e-300, 1e-6, 1e12, -1e12, 1e13, 1.7e308, float("nan"), float("inf"), 2**53 - 1, 2**53,
    2**63, True,
)  # fmt: skip
TEXTS = (
    "", "r1", "r2", "r3", "x", "board-a", "board-b", "a", "b", "robot/r1", "robot/x", "object/ball", "landmark/l",
    "x" * 5000, "\n\x1b[2J",
)  # fmt: skip
WORDS = (
    "robot", "board", "reported", "consensus", "agreed", "idle", "lockstep", "realtime", "log8", "log16", "f32",
    "independent",
)  # fmt: skip


def places(value: Any) -> list[tuple[Any, Any]]:
    """All (container, key or index) of a message as maps and arrays."""
    inside: list[tuple[Any, Any]] = []
    if isinstance(value, dict | list):
        for key, item in list(value.items()) if isinstance(value, dict) else list(enumerate(value)):
            inside += [(value, key), *places(item)]
    return inside


def hostile(rng: np.random.Generator, value: Any) -> Any:
    """Something else in the place of a value, mostly of its own type."""
    choices: list[Any] = [None, {}, [], b"", "x", 1, [[]] * 300]
    if rng.random() < 0.1:
        pass
    elif isinstance(value, int | float):
        choices = list(NUMBERS) if rng.random() < 0.6 else [value + float(rng.normal()) * 3]
    elif isinstance(value, str):
        choices = [*TEXTS, *WORDS]
    elif isinstance(value, bytes):
        changed = bytearray(value or b"\0")
        changed[int(rng.integers(len(changed)))] ^= int(rng.integers(1, 256))
        choices = [bytes(changed)]
    elif isinstance(value, list):
        choices = [value[:-1], value * 2, (value * 300)[: int(rng.integers(300))], value[::-1]]
    elif isinstance(value, dict):
        choices = [{**value, **{f"x{i}": next(iter(value.values()), 1.0) for i in range(int(rng.integers(300)))}}]
    return choices[int(rng.integers(len(choices)))]


def message(rng: np.random.Generator, newest: dict[str, bytes]) -> Envelope:
    """A message of this team, or an example of any type, with a few of its values changed, sometimes on another key."""
    if newest and rng.random() < 0.75:
        key = sorted(newest)[int(rng.integers(len(newest)))]
        fields = msgpack.unpackb(newest[key])
    else:
        name, parts, example = RICH[int(rng.integers(len(RICH)))]
        key, fields = TOPICS[name].key(**parts), as_map(example)
    for _ in range(int(rng.integers(4))):
        where = places(fields)
        if where:
            container, at = where[int(rng.integers(len(where)))]
            container[at] = hostile(rng, container[at])
    if rng.random() < 0.1:
        chunks = key.split("/")
        chunks[int(rng.integers(2, len(chunks)))] = ["a", "b", "x", "r1", "r2", "board-a", "*"][int(rng.integers(7))]
        key = "/".join(chunks)
    try:
        payload = msgpack.packb(fields)
    except (OverflowError, ValueError):
        payload = b"\xc1"
    if rng.random() < 0.03:
        payload = payload[: int(rng.integers(len(payload) + 1))]
    return Envelope(key, payload)


def token(rng: np.random.Generator) -> Envelope:
    """A token of somebody invented that comes or goes."""
    name, sub_team = f"x{int(rng.integers(50))}", ["a", "b", "z"][int(rng.integers(3))]
    key = keys.BOARD.key(team="t", sub_team=sub_team, board=name)
    return Envelope(key, kind=Kind.ALIVE if rng.random() < 0.5 else Kind.GONE)


def run(seed: int, count: int, joint: bool) -> Counter[str]:
    """One run of a team to which so many messages are sent; what its services counted. AssertionError: what does not hold."""
    rng = np.random.default_rng([seed, joint])
    team, newest, left = InProcessTeam(JOINT if joint else SCENARIO), dict[str, bytes](), count
    per_message = count / 150  # that the team sends itself
    owed = 0.0

    def remember(envelope: Envelope) -> None:
        nonlocal left, owed
        if attacking or envelope.kind is not Kind.PUT:
            return
        newest[envelope.key] = envelope.payload
        owed += per_message
        while owed >= 1 and left:
            owed, left = owed - 1, left - 1
            pending.append(message(rng, newest))

    attacking, pending = False, list[Envelope]()
    team.bus.spies.append(remember)
    while not team.world.done:
        ticks = team.world.tick
        team.run_until(lambda before=ticks: bool(pending) or team.world.done or team.world.tick != before, SECONDS)  # type: ignore[misc]
        attacking = True
        for envelope in pending:
            team.bus.send(envelope)
        pending.clear()
        if rng.random() < 0.02:
            change = token(rng)
            for link in team.bus.links:
                if any(expr.endswith("/board/*") for expr in link.watched):
                    team.bus.deliver(link, change)
        attacking = False
    services: list[Any] = [*team.boards.values(), *team.robots.values(), team.world]
    counted: Counter[str] = Counter(sent=count - left)
    for service in services:
        counted += Counter(service.refused)
        assert service.counters["failed"] == 0, f"seed {seed}: {service} met an exception"
    for board in team.boards.values():
        board.check()
    assert team.world.why == "", f"seed {seed}: {team.world.why}"
    return counted


def one_run(seed: int, joint: bool) -> tuple[Counter[str], str]:
    """What a run counted, and why it failed, if it did."""
    logging.disable(logging.ERROR)  # what is refused is logged, and there is much of it
    try:
        return run(seed, PER_RUN, joint=joint), ""
    except Exception as error:
        return Counter(), f"{type(error).__name__}: {error}"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    given = parser.parse_args()
    runs = range(-(-given.count // PER_RUN))
    total: Counter[str] = Counter()
    began, failed = time.monotonic(), 0
    with ProcessPoolExecutor(given.jobs, multiprocessing.get_context("spawn")) as pool:
        outcomes = pool.map(one_run, (given.seed * 1_000_000 + i for i in runs), (i % 2 == 1 for i in runs))
        for i, (counted, why) in enumerate(outcomes):
            total += counted
            failed += bool(why)
            if why:
                print(f"run {i}: {why}", flush=True)
            if total["sent"] // TELL > (total["sent"] - counted["sent"]) // TELL:
                print(f"{total['sent']} messages, {failed} runs failed", flush=True)
    spent = time.monotonic() - began
    print(f"{total['sent']} messages, {failed} runs failed, {spent:.0f} s; refused: {dict(total)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
