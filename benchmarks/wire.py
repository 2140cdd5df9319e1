"""What does a belief cost on the wire? `python benchmarks/wire.py`.

A Gaussian of sigma 5 on 200 x 200 cells, its mean between two centres, as a Report and as a Consensus, with its first-hand part; or
as the raw array in msgpack. And the time that Zenoh needs to carry that array to another session of the same process on
127.0.0.1 and back (wall time, in turns with the encoding).
"""

import queue
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import msgpack  # type: ignore[import-untyped,unused-ignore]
import numpy as np
import zenoh
from ratios import Measured, milliseconds, show

from blackboard import Grid
from blackboard.board.board import Board
from blackboard.config import BoardSection
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import Belief, gaussian
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.levels import Coding
from blackboard.wire.messages import Consensus, Report

GRID = Grid((200, 200))
ROUNDS = 40
PORT = 17993
PLACES = 40
CODINGS: tuple[Coding, ...] = ("log8", "log16")


def belief(x: float = 100.3) -> Belief:
    return gaussian(GRID, (x, 87.7), 5.0)


def report(source: str, x: float = 100.3, coding: Coding = "log8") -> Report:
    packed = pack(belief(x), coding)
    return Report(source=source, subject="robot/r1", tick=1, time=0.2, belief=packed, ancestors={source: 0.2})


def consensus(robots: int) -> Consensus:
    board = Board("a", "board-a", GRID, BoardSection())
    for i in range(robots):
        board.hear(report(f"r{i + 1}", 100.3 + i), 0.2)
    return board.settle(1, 0.2)[0]


def there_and_back(payload: bytes, *works: Callable[[], object]) -> list[float]:
    """Milliseconds of wall time, the medians of trips of a payload through Zenoh and back, and of calls of each of `works` between."""
    arrived: queue.Queue[int] = queue.Queue()
    ends = []
    for setting in (
        {"listen/endpoints": f'["tcp/127.0.0.1:{PORT}"]'},
        {"connect/endpoints": f'["tcp/127.0.0.1:{PORT}"]'},
    ):
        config = zenoh.Config()
        for key, value in (setting | {"mode": '"peer"', "scouting/multicast/enabled": "false"}).items():
            config.insert_json5(key, value)
        ends.append(zenoh.open(config))
    here, there = ends
    echo = there.declare_publisher("bench/back")
    keep = [
        there.declare_subscriber("bench/there", lambda sample: echo.put(sample.payload)),
        here.declare_subscriber("bench/back", lambda sample: arrived.put(len(sample.payload.to_bytes()))),
    ]
    times: list[list[float]] = []
    try:
        out = here.declare_publisher("bench/there")
        deadline = time.monotonic() + 10.0
        while not (_matches(out) and _matches(echo)):
            if time.monotonic() > deadline:
                raise RuntimeError("the two sessions do not find each other on 127.0.0.1")
        for _ in range(ROUNDS):
            stamps = [time.perf_counter()]
            out.put(payload)
            arrived.get(timeout=10)
            stamps.append(time.perf_counter())
            for work in works:
                work()
                stamps.append(time.perf_counter())
            times.append([1e3 * (b - a) for a, b in pairwise(stamps)])
    finally:
        for entity in keep:
            entity.undeclare()  # type: ignore[no-untyped-call]
        for session in ends:
            session.close()  # type: ignore[no-untyped-call]
    return [float(median) for median in np.median(times, axis=0)]


def _matches(publisher: Any) -> bool:
    return bool(publisher.matching_status.matching)


def rows() -> Iterator[Measured]:
    sent = belief()
    said = encode(report("r1"))
    raw64, raw32 = sent.p.tobytes(), sent.p.astype(np.float32).tobytes()
    for coding in CODINGS:
        size, loss = (len(encode(report("r1", coding=coding))), kullback_leibler(sent.p, unpack(pack(sent, coding)).p))
        yield Measured(f"bytes of a Report of a Gaussian of sigma 5, {coding}", size, "bytes", most=700.0)
        yield Measured(f"what is lost of it (Kullback-Leibler), {coding}", loss, "nats", most=1e-4)
        sizes, losses = zip(*elsewhere(coding), strict=True)
        yield Measured(f"bytes of such Reports elsewhere, mean of {PLACES}, {coding}", float(np.mean(sizes)), "bytes")
        yield Measured(f"what is lost of them, the most, {coding}", max(losses), "nats")
    yield Measured("msgpack of float64 / a Report", len(msgpack.packb(raw64)) / len(said))
    yield Measured("msgpack of float32 / a Report", len(msgpack.packb(raw32)) / len(said))
    for robots in (1, 4, 8):
        size = len(encode(consensus(robots)))
        yield Measured(f"bytes of a Consensus of {robots} robots / a Report", size / len(said), most=3.0)

    ways = [partial(_ours, sent, report("r1"), coding) for coding in CODINGS]
    trip, *taken = there_and_back(raw64, *ways)
    for coding, own, mine in zip(CODINGS, ways, taken, strict=True):
        about = f"encode + decode a Report / Zenoh carries 320 kB there and back ({trip:.2f} ms), {coding}"
        yield Measured(about, mine / trip, most=1 / 3)
        ours, packed = milliseconds(own, partial(_msgpack, raw64))
        yield Measured(f"encode + decode a Report / msgpack packs and unpacks its float64, {coding}", ours / packed)


def elsewhere(coding: Coding) -> Iterator[tuple[int, float]]:
    """The bytes of a Report, and what is lost of it, for the same Gaussian at other places."""
    rng = np.random.default_rng(7)
    for place in rng.uniform(60, 140, (PLACES, 2)):
        placed = gaussian(GRID, tuple(place), 5.0)
        packed = pack(placed, coding)
        said = report("r1").model_copy(update={"belief": packed})
        yield len(encode(said)), kullback_leibler(placed.p, unpack(packed).p)


def _ours(given: Belief, made: Report, coding: Coding) -> None:
    said = encode(made.model_copy(update={"belief": pack(given, coding)}))
    unpack(decode(Report, said).belief, GRID)


def _msgpack(raw: bytes) -> None:
    np.frombuffer(msgpack.unpackb(msgpack.packb(raw)), np.float64).copy()


if __name__ == "__main__":
    show(rows())
