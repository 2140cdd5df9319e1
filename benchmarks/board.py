"""How long does a board keep its robots waiting, and what does it do when they say too much? `python benchmarks/board.py`.

A real board (`blackboard serve`, the default rule), a real router and this process, which plays the world and eight robots with ten
subjects each, on 127.0.0.1. Latency is wall time from the last message of a tick sent, the status after its reports, to the last
consensus received. A relay is put beside it: a process in Python that puts the bytes of every report out again; its latency is
from the last report sent to the last one received. Both take turns with the same reports.

In real time the ticks are sent at a rate, whether the board follows or not.
"""

import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import msgpack  # type: ignore[import-untyped,unused-ignore]
import numpy as np
from programs import program
from ratios import Measured, show

from blackboard import Grid
from blackboard.config import Scenario
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.belief import gaussian
from blackboard.run.launch import free_port
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Report, Status

ROBOTS = [f"r{i + 1}" for i in range(8)]
SUBJECTS = [f"object/o{i}" for i in range(10)]
TICK = 0.2  # seconds of team time
ROUNDS = 30
SECONDS = 6.0  # of each rate in real time
HOME = {"team": "bench", "sub_team": "a"}
SEEN = keys.CONSENSUS.key(**HOME, subject="**")
THERE, BACK = "cop/there/", "cop/back/"  # what begins the keys of reports to the relay, and from it


def relay(endpoint: str) -> None:
    """Put every report to the team `there` out again in the team `back`, until the process is ended.

    Both teams' robots hold tokens, as those of the board's team do, because a link reads what strangers say last.
    """
    with Link(LinkConfig(connect=(endpoint,)), "relay") as link:
        hold(link, "back")
        link.watch(keys.MEMBER.key(team="there", sub_team="a", robot="*"))
        link.subscribe(keys.REPORT.key(team="there", sub_team="a", source="*", subject="**"))
        print("ready", file=sys.stderr, flush=True)
        while True:
            for envelope in link.receive(0.5):
                if envelope.kind is Kind.PUT:
                    link.send(Envelope(envelope.key.replace(THERE, BACK, 1), envelope.payload))


def hold(link: Link, team: str) -> None:
    """The tokens of the robots of a team."""
    for robot in ROBOTS:
        link.token(keys.MEMBER.key(team=team, sub_team="a", robot=robot))


class Speakers:
    """The world and its robots: what they say in a tick, and what comes back."""

    def __init__(self, link: Link, side: int) -> None:
        rng = np.random.default_rng(side)
        grid = Grid((side, side))
        places = rng.uniform(0.3 * side, 0.7 * side, (len(SUBJECTS), 2))
        self.link, self.tick = link, 0
        self.began = time.time()
        self.beliefs = {
            (robot, subject): pack(gaussian(grid, tuple(place + rng.normal(0, 1.5, 2)), rng.uniform(2, 6)))
            for robot in ROBOTS
            for subject, place in zip(SUBJECTS, places, strict=True)
        }

    def said(self, tick: int) -> list[Envelope]:
        """The reports of a tick and the statuses after them."""
        envelopes = [
            Envelope(
                keys.REPORT.key(**HOME, source=robot, subject=subject),
                encode(Report(source=robot, subject=subject, belief=belief, tick=tick, time=tick * TICK)),
            )
            for (robot, subject), belief in self.beliefs.items()
        ]
        for robot in ROBOTS:
            status = Status(
                process=robot, kind="robot", phase="reported", subjects=SUBJECTS, tick=tick, time=tick * TICK
            )
            envelopes.append(Envelope(keys.STATUS.key(**HOME, process=robot), encode(status)))
        return envelopes

    def clock(self, tick: int, mode: str) -> Envelope:
        clock = Clock(run="b", tick=tick, time=tick * TICK, mode=mode, robots={"a": ROBOTS})  # type: ignore[arg-type]
        return Envelope(keys.CLOCK.key(team="bench"), encode(clock))

    def seen(self, timeout: float) -> list[tuple[int, float]]:
        """The tick of each consensus that has come, and when it was taken out."""
        return [
            (msgpack.unpackb(e.payload)["tick"], time.perf_counter())
            for e in self.link.receive(timeout)
            if e.kind is Kind.PUT
        ]

    def through_board(self) -> float:
        """Milliseconds of a tick in lockstep."""
        self.tick += 1
        said = self.said(self.tick)
        self.link.send(self.clock(self.tick, "lockstep"))
        for envelope in said:
            self.link.send(envelope)
        return self._until(lambda: sum(tick == self.tick for tick, _ in self.seen(5.0)), len(SUBJECTS))

    def through_relay(self) -> float:
        """Milliseconds of the same reports there and back."""
        for envelope in self.said(self.tick)[: -len(ROBOTS)]:
            self.link.send(Envelope(envelope.key.replace("cop/bench/", THERE, 1), envelope.payload))
        return self._until(lambda: sum(e.kind is Kind.PUT for e in self.link.receive(5.0)), len(self.beliefs))

    def _until(self, came: Callable[[], int], most: int) -> float:
        began = time.perf_counter()
        left = most
        while left > 0:
            count = came()
            left -= count
            if not count and time.perf_counter() - began > 20.0:
                raise RuntimeError(f"{left} of {most} messages did not come back within 20 s")
        return 1e3 * (time.perf_counter() - began)

    def at_rate(self, hertz: float) -> tuple[float, float, float]:
        """Real time: the share of the ticks that the board settled, and its delay in their first and their last third, seconds."""
        ticks, first = int(SECONDS * hertz), self.tick + 1
        said = [(self.clock(tick, "realtime"), *self.said(tick)) for tick in range(first, first + ticks)]
        sent: dict[int, float] = {}
        delays: dict[int, float] = defaultdict(float)
        begin = time.perf_counter()

        def take(timeout: float) -> int:
            settled = self.seen(timeout)
            for tick, at in settled:
                if tick in sent:
                    delays[tick] = max(delays[tick], at - sent[tick])
            return len(settled)

        for i, envelopes in enumerate(said):
            while (left := begin + i / hertz - time.perf_counter()) > 0:
                take(left)
            for envelope in envelopes:
                self.link.send(envelope)
            sent[first + i] = time.perf_counter()
        while take(3.0):  # what it still has to say
            pass
        self.tick += ticks
        third = [[delays[t] for t in list(sent)[i * ticks // 3 : (i + 1) * ticks // 3] if t in delays] for i in (0, 2)]
        early, late = (float(np.median(part)) if part else float("nan") for part in third)
        return len(delays) / ticks, early, late


def rows() -> Iterator[Measured]:
    for side, hertz in ((50, 20.0), (200, 5.0)):
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            scenario = folder / "bench.json"
            team_table = {"name": "bench", "sub_teams": {"a": ROBOTS}}
            scenario.write_text(Scenario({"team": team_table, "grid": {"shape": [side, side]}}).to_json())
            endpoint = f"tcp/127.0.0.1:{free_port()}"
            stack.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
            board = stack.enter_context(
                program("-m", "blackboard", "serve", "--sub-team", "a", "--scenario", str(scenario), "-e", endpoint)
            )
            stack.enter_context(program(__file__, "relay", endpoint))
            link = stack.enter_context(Link(LinkConfig(connect=(endpoint,)), "world"))
            team = Speakers(link, side)
            link.token(keys.WORLD.key(team="bench"))
            for name in ("bench", "there"):
                hold(link, name)
            link.watch(keys.BOARD.key(**HOME, board="*"))
            link.watch(keys.MEMBER.key(team="back", sub_team="a", robot="*"))
            link.subscribe(SEEN)
            link.subscribe(keys.REPORT.key(team="back", sub_team="a", source="*", subject="**"))
            link.receive(1.0)  # nothing comes: the tokens are on their way
            for _ in range(3):  # the first ticks are not counted
                team.through_board()
                team.through_relay()
            before = board.processor_seconds()
            waits = np.array([(team.through_board(), team.through_relay()) for _ in range(ROUNDS)])
            spent = board.processor_seconds() - before
            about = f"{side} x {side}, 8 robots, 10 subjects"
            for name, share in (("median", 50), ("95 %", 95)):
                own, relayed = np.percentile(waits, share, axis=0)
                yield Measured(f"from the last report to the last consensus, {name}, {about}", own, "ms")
                yield Measured(f"the same reports through a relay in Python, {name}", relayed, "ms")
                if name == "median":
                    work = 1e3 * spent / ROUNDS  # of the board in a tick: reading the reports, and pooling
                    yield Measured(
                        "that latency / (twice the relay's and the board's own work)",
                        own / (2 * relayed + work),
                        most=1.0,
                    )
                    yield Measured("that latency / (twice the relay's)", own / (2 * relayed))
            yield Measured(
                f"reports a second and core of the board, {about}", ROUNDS * len(team.beliefs) / spent, "1/s"
            )
            yield Measured(f"ticks a second and core of the board, {about}", ROUNDS / spent, "Hz", least=hertz)
            for rate in (hertz / 4, hertz):
                settled, early, late = team.at_rate(rate)
                yield Measured(f"real time at {rate:g} Hz, {about}: share of the ticks settled", 100 * settled, "%")
                yield Measured(f"real time at {rate:g} Hz: delay in the first third of {SECONDS:g} s", early, "s")
                yield Measured(f"real time at {rate:g} Hz: delay in the last third", late, "s")


if __name__ == "__main__":
    if sys.argv[1:2] == ["relay"]:
        relay(sys.argv[2])
    else:
        show(rows())
