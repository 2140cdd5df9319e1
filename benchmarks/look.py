"""What it costs to look: processor time, memory and bytes of the live page and the recorder, for a large team or a tape.

    python benchmarks/look.py --robots 64 --hz 10 --pages 10     # invented traffic of 64 robots in four sub-teams
    python benchmarks/look.py --tape run.mcap --hz 5             # what is on a tape, so many ticks a second

A router, the page and the recorder run as processes of their own on 127.0.0.1; this one sends. Processor time is that of a whole
process (user and system) over the seconds in which was sent, memory the most that it ever had.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.managers import ValueProxy
from pathlib import Path
from typing import Any, Literal

import numpy as np
from programs import program

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.run.launch import free_port
from blackboard.tape.file import read
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Informed, Report, Status, Truth, Used

TEAM, SUB_TEAMS, SEES = "demo", ("a", "b", "c", "d"), 6
GRID = Grid((200, 200))
SHAPES = 64  # beliefs that are made once and shown in turn

Tick = list[Envelope]


def invented(robots: int, ticks: int, hz: float, rng: np.random.Generator) -> Iterator[Tick]:
    """Ticks of a team: each robot reports itself and SEES mates, each board a consensus and an agreed belief of everybody."""
    names = [f"r{n + 1}" for n in range(robots)]
    team_of = {name: SUB_TEAMS[n % len(SUB_TEAMS)] for n, name in enumerate(names)}
    centres, sigmas = rng.uniform(20, 180, (SHAPES, 2)), rng.uniform(0.8, 3.0, SHAPES)
    shapes = [pack(gaussian(GRID, (x, y), s)) for (x, y), s in zip(centres.tolist(), sigmas.tolist(), strict=True)]
    subjects = [f"robot/{name}" for name in names]
    positions = {subject: tuple(centres[n % SHAPES].tolist()) for n, subject in enumerate(subjects)}
    for tick in range(ticks):
        at: dict[str, Any] = {"tick": tick, "time": tick / hz}
        found = [Envelope(keys.TRUTH.key(team=TEAM), encode(Truth(run="bench", positions=positions, **at)))]
        found.append(Envelope(keys.CLOCK.key(team=TEAM), encode(Clock(run="bench", mode="realtime", **at))))
        for n, name in enumerate(names):
            told = [subjects[(n + k) % robots] for k in range(SEES + 1)]
            for k, subject in enumerate(told):
                belief = shapes[(n + k) % SHAPES]
                informed = Informed(belief=belief, ancestors={name: at["time"], names[(n + 1) % robots]: at["time"]})
                key = keys.REPORT.key(team=TEAM, sub_team=team_of[name], source=name, subject=subject)
                found.append(
                    Envelope(key, encode(Report(source=name, subject=subject, belief=belief, informed=informed, **at)))
                )
            key = keys.STATUS.key(team=TEAM, sub_team=team_of[name], process=name)
            found.append(
                Envelope(key, encode(Status(process=name, kind="robot", phase="reported", subjects=told, **at)))
            )
        levels: tuple[tuple[Literal["consensus", "agreed"], keys.Topic], ...]
        levels = (("consensus", keys.CONSENSUS), ("agreed", keys.AGREED))
        for level, topic in levels:
            for sub_team in SUB_TEAMS:
                board = f"board-{sub_team}"
                for n, subject in enumerate(subjects):
                    used = [Used(source=names[n], weight=1.0, age=0.0, entropy=2.0, how="independent")]
                    consensus = Consensus(
                        board=board, sub_team=sub_team, level=level, subject=subject, belief=shapes[n % SHAPES], used=used,
                        ancestors={names[n]: at["time"]}, entropy=2.0, conflict=False, rule="coalition", **at,
                    )  # fmt: skip
                    found.append(Envelope(topic.key(team=TEAM, sub_team=sub_team, subject=subject), encode(consensus)))
                key = keys.STATUS.key(team=TEAM, sub_team=sub_team, process=board)
                status = Status(process=board, kind="board", phase=level, subjects=subjects, **at)
                found.append(Envelope(key, encode(status)))
        yield found


def tokens(robots: int) -> list[str]:
    """Those of an invented team."""
    held = [keys.BOARD.key(team=TEAM, sub_team=s, board=f"board-{s}") for s in SUB_TEAMS] + [keys.WORLD.key(team=TEAM)]
    return held + [
        keys.MEMBER.key(team=TEAM, sub_team=SUB_TEAMS[n % len(SUB_TEAMS)], robot=f"r{n + 1}") for n in range(robots)
    ]


def taped(path: Path) -> tuple[list[str], list[Tick]]:
    """The tokens and the ticks of a tape."""
    held, ticks = list[str](), list[Tick]([[]])
    for _, envelope in read(path):
        if envelope.kind is Kind.ALIVE and envelope.key not in held:
            held.append(envelope.key)
        elif envelope.kind is Kind.PUT:
            if keys.CLOCK.match(envelope.key):
                ticks.append([])
            ticks[-1].append(envelope)
    return held, ticks


Count = ValueProxy[tuple[int, int]]  # frames and bytes


def browse(url: str, count: Count) -> None:
    """A browser that takes every frame."""
    from websockets.sync.client import connect

    with connect(url.replace("http", "ws") + "live", max_size=None) as socket:
        socket.recv()
        socket.send("robot/r1")
        while True:
            frame = socket.recv()
            frames, size = count.value
            count.value = frames + 1, size + len(frame)


@contextmanager
def browsers(url: str, number: int) -> Iterator[list[Count]]:
    """So many browsers as processes of their own until the block ends, and what each has taken."""
    with multiprocessing.Manager() as manager, ExitStack() as stack:
        counts = [manager.Value("x", (0, 0)) for _ in range(number)]
        for count in counts:
            browser = multiprocessing.Process(target=browse, args=(url, count), daemon=True)
            browser.start()
            stack.callback(browser.kill)
        yield counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=64)
    parser.add_argument("--hz", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--pages", type=int, default=1)
    parser.add_argument("--tape", type=Path)
    given = parser.parse_args()
    count = round(given.seconds * given.hz)
    if given.tape is not None:
        held, ticks = taped(given.tape)
        ticks = ticks[:count]
    else:
        held, ticks = tokens(given.robots), list(invented(given.robots, count, given.hz, np.random.default_rng(1)))
    size = sum(len(envelope.payload) for tick in ticks for envelope in tick)
    print(
        f"{len(ticks)} ticks, {sum(map(len, ticks)) / len(ticks):.0f} messages and {size / len(ticks) / 1e3:.0f} kB each"
    )
    measure(held, ticks, given.hz, given.pages)


def measure(held: list[str], ticks: list[Tick], hz: float, pages: int) -> None:
    """Send the ticks at a rate, in Hz, to a page with some browsers and to a recorder, and print what that costs."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    team = ("--team", TEAM, "-e", endpoint)
    with ExitStack() as stack:
        tape = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "x.mcap"
        stack.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        link = stack.enter_context(Link(LinkConfig(connect=(endpoint,)), "bench", patience=30.0))
        for token in held:
            link.token(token)
        page = stack.enter_context(program("-m", "blackboard", "view", "--port", "0", *team, says="http://"))
        recorder = stack.enter_context(program("-m", "blackboard", "record", str(tape), *team))
        (url,) = re.findall(r"http://\S+", page.said)
        counts = stack.enter_context(browsers(url, pages))
        before = {it: it.processor_seconds() for it in (page, recorder)}
        wall, late = send(link, ticks, hz)
        for name, it in (("page", page), ("recorder", recorder)):
            share = 100 * (it.processor_seconds() - before[it]) / wall
            print(f"{name:10}{share:6.1f} % of a core, {it.mebibytes('VmHWM'):6.0f} MB")
        frames, size = (sum(part) for part in zip((0, 0), *(count.value for count in counts), strict=True))
        print(f"{len(ticks) / wall:.1f} ticks/s in {wall:.1f} s, {late} late")
        print(f"pages     {frames / max(1, pages) / wall:.1f} frames/s of {size / max(1, frames) / 1e3:.0f} kB each")
        print(f"tape      {tape.stat().st_size / wall / 1e3:.0f} kB/s")


def send(link: Link, ticks: list[Tick], hz: float) -> tuple[float, int]:
    """Send so many ticks a second: how long it took, in seconds, and how many ticks were late by a whole one."""
    begin, late, never = time.monotonic(), 0, threading.Event()
    for n, tick in enumerate(ticks):
        never.wait(max(0.0, begin + n / hz - time.monotonic()))
        late += time.monotonic() > begin + (n + 1) / hz
        for envelope in tick:
            link.send(envelope)
    return time.monotonic() - begin, late


if __name__ == "__main__":
    main()
