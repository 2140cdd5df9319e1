"""What do a board, a router and a link carry, and how far does that go? `python benchmarks/fleet.py`.

Long, because what is measured, what is simulated with it and the comparison of the two belong to one question.

1. *costs*: processor time of a board's work by kind (hear, settle, exchange), in this process, without Zenoh: a least-squares fit.
2. *drive*: real boards as processes behind a real Zenoh router on 127.0.0.1, with generated robots, slower to faster: processor time
   of boards and router, what arrived, how old the answers are. So the costs of the network are known too.
3. *simulate*: a discrete-event simulation of robots, router and boards with these costs, to 10 000 robots.

Nobody gives a world's clock, so that boards settle every `period` whatever has arrived: the way of real robots. Processor time counts,
not wall time, because the machine may be shared; a share of 1 is one busy core.
"""

from __future__ import annotations

import argparse
import heapq
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ratios import ROOT

from blackboard.board.service import BoardService
from blackboard.config import BoardSection
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.run.launch import free_port
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, PackedBelief, Report, Status

GRID = Grid((50, 50))
OBJECTS = 2
MATES = 2  # that a robot sees of its own sub-team
CORES = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Fleet:
    """A team: every robot reports itself, `MATES` mates and one object, `rate` times a second; boards settle every `period` s."""

    robots: int
    sub_teams: int
    rate: float = 5.0
    period: float = 0.2

    def members(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {f"s{i}": [] for i in range(self.sub_teams)}
        for i in range(self.robots):
            found[f"s{i % self.sub_teams}"].append(f"r{i}")
        return found

    def subjects(self, robot: str, mates: list[str]) -> list[str]:
        at = mates.index(robot)
        seen = {mates[(at + 1 + i) % len(mates)] for i in range(MATES)} - {robot}
        return [f"robot/{robot}", *(f"robot/{mate}" for mate in sorted(seen)), f"object/o{at % OBJECTS}"]


BELIEFS = [pack(gaussian(GRID, (5 + 8 * (i % 5), 5 + 8 * (i // 5)), 1.0 + 0.1 * i)) for i in range(25)]


def belief(subject: str, source: str) -> PackedBelief:
    """One of a few made once, alike for one subject, so that generating costs little."""
    return BELIEFS[(sum(subject.encode()) + len(source)) % len(BELIEFS)]


def said(fleet: Fleet, sub_team: str, tick: int, now: float) -> list[Envelope]:
    """What the robots of a sub-team report in a tick, by Unix time, and their statuses."""
    mates, out = fleet.members()[sub_team], []
    for robot in mates:
        subjects = fleet.subjects(robot, mates)
        for subject in subjects:
            report = Report(source=robot, subject=subject, tick=tick, time=now, belief=belief(subject, robot))
            key = keys.REPORT.key(team="fleet", sub_team=sub_team, source=robot, subject=subject)
            out.append(Envelope(key, encode(report)))
        status = Status(process=robot, kind="robot", tick=tick, time=now, phase="reported", subjects=subjects)
        out.append(Envelope(keys.STATUS.key(team="fleet", sub_team=sub_team, process=robot), encode(status)))
    return out


def tokens(fleet: Fleet, sub_team: str) -> list[str]:
    return [keys.MEMBER.key(team="fleet", sub_team=sub_team, robot=robot) for robot in fleet.members()[sub_team]]


# --- 1. costs ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Costs:
    """Processor milliseconds of a board's work, and of the network's for each message; bytes of the messages."""

    hear: float  # a report or a status
    hear_consensus: float
    settle: float  # a subject
    opinion: float  # an opinion in it, beyond that
    agree: float  # a subject in the exchange
    part: float  # a sub-team's consensus in it, beyond that
    take: float = 0.05  # Zenoh and the loop around a message that a board receives
    route: float = 0.02  # the router, for each message in and each delivery out
    report: int = 400  # bytes, key included
    consensus: int = 900


def costs() -> Costs:
    """Fitted to boards in this process; the network's costs are left as they stand."""
    work = []
    for robots, others in ((4, 0), (16, 0), (4, 1), (8, 1), (4, 3)):
        work.append(_worked(robots, others))
    rows = np.array([[w["settled"], w["opinions"], w["agreed"], w["parts"]] for w in work], dtype=float)
    settle, opinion, agree, part = _non_negative(rows, np.array([w["wake_ms"] for w in work]))
    hear = float(np.mean([w["hear_ms"] for w in work]))
    consensus = float(np.mean([w["consensus_ms"] for w in work if w["parts"] > w["agreed"]]))
    sizes = [int(np.mean([w[name] for w in work])) for name in ("report_bytes", "consensus_bytes")]
    return Costs(hear, consensus, settle, opinion, agree, part, report=sizes[0], consensus=sizes[1])


def _non_negative(rows: Any, times: Any) -> tuple[float, ...]:
    """Least squares over relative errors; a cost that would come out negative is 0."""
    scale, use = 1 / times, list(range(rows.shape[1]))
    while True:
        found = np.linalg.lstsq(rows[:, use] * scale[:, None], times * scale, rcond=None)[0]
        if (found >= 0).all():
            whole = np.zeros(rows.shape[1])
            whole[use] = found
            return tuple(float(it) for it in whole)
        use.pop(int(np.argmin(found)))


def _worked(robots: int, others: int, rounds: int = 3) -> dict[str, float]:
    """A board of `robots` with as many `others` of the same size: what it did in a round, and its processor milliseconds."""
    fleet = Fleet(robots * (others + 1), others + 1)
    boards = {s: board(s) for s in fleet.members()}
    mine, now = boards["s0"], 1e6
    found = defaultdict[str, list[float]](list)
    alive = [Envelope(t, kind=Kind.ALIVE) for s in fleet.members() for t in tokens(fleet, s)]
    alive += [Envelope(token, kind=Kind.ALIVE) for it in boards.values() for token in it.tokens]
    for it in boards.values():
        for envelope in alive:
            it.receive(envelope, now)
        it.wake(now)
    for tick in range(rounds + 1):
        now += 0.01  # s: no settlement is due yet, so the time spent here is that of hearing alone
        for name, it in boards.items():
            reports = said(fleet, name, tick, now - 0.001)
            spent = _heard(it, reports, now)
            if it is mine:
                found["hear_ms"].append(spent / len(reports))
                found["report_bytes"].append(float(np.mean([len(e.payload) + len(e.key) for e in reports])))
        now += fleet.period  # all boards settle at the same times, those of Unix time
        outs = {name: _settled(it, now) for name, it in boards.items()}
        found["wake_ms"].append(outs["s0"][1])
        _count(found, outs["s0"][0])
        for name, it in boards.items():
            arrived = [e for other, (box, _) in outs.items() if other != name for e in box if "/consensus/" in e.key]
            spent = _heard(it, arrived, now)
            if it is mine and arrived:
                found["consensus_ms"].append(spent / len(arrived))
    found = defaultdict(list, {name: values[1:] for name, values in found.items()})  # without the first round
    return {name: float(np.median(values)) for name, values in found.items()} | {"robots": robots, "others": others}


def _heard(it: BoardService, envelopes: list[Envelope], now: float) -> float:
    """Processor milliseconds in which a board hears these."""
    began = time.process_time()
    for envelope in envelopes:
        it.receive(envelope, now)
    return 1e3 * (time.process_time() - began)


def _settled(it: BoardService, now: float) -> tuple[list[Envelope], float]:
    """What a board sends when it settles, and the processor milliseconds."""
    began = time.process_time()
    return it.wake(now), 1e3 * (time.process_time() - began)


def _count(found: dict[str, list[float]], box: list[Envelope]) -> None:
    told = [decode(Consensus, e.payload) for e in box if "/consensus/" in e.key or "/agreed/" in e.key]
    for level, subjects, parts in (("consensus", "settled", "opinions"), ("agreed", "agreed", "parts")):
        mine = [c for c in told if c.level == level]
        found[subjects].append(len(mine))
        found[parts].append(sum(len(c.used) for c in mine))
    found["consensus_bytes"].append(float(np.mean([len(e.payload) + len(e.key) for e in box])) if box else 0.0)


def board(sub_team: str) -> BoardService:
    return BoardService(team="fleet", sub_team=sub_team, board=f"board-{sub_team}", grid=GRID, settings=BoardSection())


# --- 2. drive ----------------------------------------------------------------------------------------------------------


@contextmanager
def program(*arguments: str) -> Iterator[int]:
    """One of our programs until the block ends; yields its process number once it is ready."""
    command = [sys.executable, "-m", "blackboard", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT) as running:
        try:
            assert running.stderr is not None
            for line in running.stderr:
                if "ready" in line:
                    break
            os.set_blocking(running.stderr.fileno(), False)
            yield running.pid
        finally:
            running.send_signal(signal.SIGTERM)


def processor(pid: int) -> float:
    """Processor seconds that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / CORES


@dataclass
class Driven:
    """What real processes did under generated traffic; shares of a core, messages a second."""

    fleet: Fleet
    seconds: float
    sent: float  # reports and statuses a second that were really published
    board: float  # share of a core, the busiest
    router: float
    heard: float  # share of what was sent to the busiest board that it has handled
    age: float  # seconds, median: from a settlement's stamp until the consensus arrived here


def drive(fleet: Fleet, seconds: float) -> Driven:
    """Boards and a router as processes, robots from here."""
    endpoint, members = f"tcp/127.0.0.1:{free_port()}", fleet.members()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        file = Path(folder) / "fleet.toml"
        teams = "\n".join(f"{name} = {json.dumps(robots)}" for name, robots in members.items())
        file.write_text(
            f'name = "fleet"\n[team]\nname = "fleet"\n[team.sub_teams]\n{teams}\n[grid]\nshape = [50, 50]\n'
            f"[board]\nperiod = {fleet.period}\n"
        )
        router = stack.enter_context(program("router", "-l", endpoint))
        boards = [
            stack.enter_context(program("serve", "--scenario", str(file), "--sub-team", name, "-e", endpoint))
            for name in members
        ]
        link = stack.enter_context(Link(LinkConfig(connect=(endpoint,)), "fleet"))
        for name in members:
            for token in tokens(fleet, name):
                link.token(token)
        link.subscribe(keys.CONSENSUS.key(team="fleet", sub_team="*", subject="**"))
        link.subscribe(keys.STATUS.key(team="fleet", sub_team="*", process="*"))
        _say(link, fleet, 2.0)
        before = [processor(pid) for pid in (router, *boards)]
        began = time.time()
        sent, ages, handled = _say(link, fleet, seconds)
        wall = time.time() - began
        after = [processor(pid) for pid in (router, *boards)]
    spent = [(b - a) / wall for a, b in zip(before, after, strict=True)]
    mine = sent / len(members)
    return Driven(
        fleet, wall, sent / wall, max(spent[1:]), spent[0], min(1.0, handled / mine) if mine else 0.0,
        float(np.median(ages)) if ages else math.nan,
    )  # fmt: skip


def _say(link: Link, fleet: Fleet, seconds: float) -> tuple[int, list[float], float]:
    """Speak for all robots: messages sent, ages of consensuses in seconds, and reports and statuses that the best board handled."""
    end, tick, sent, ages = time.time() + seconds, 0, 0, []
    heard: dict[str, list[int]] = defaultdict(list)
    due = time.time()
    while time.time() < end:
        now = time.time()
        for sub_team in fleet.members():
            for envelope in said(fleet, sub_team, tick, now):
                link.send(envelope)
                sent += 1
        tick, due = tick + 1, max(due + 1 / fleet.rate, time.time() - 1.0)
        while True:
            for envelope in link.receive(max(0.0, min(due, end) - time.time())):
                if "/consensus/" in envelope.key:
                    ages.append(time.time() - decode(Consensus, envelope.payload).time)
                elif "/status/board" in envelope.key:
                    heard[envelope.key].append(decode(Status, envelope.payload).counters.get("heard", 0))
            if time.time() >= min(due, end):
                break
    return sent, ages, float(max((max(h) - min(h) for h in heard.values() if h), default=0))


# --- 3. simulate -------------------------------------------------------------------------------------------------------


@dataclass
class Server:
    """One core that works on one thing after the other."""

    free: float = 0.0  # when it has done all that it was given, seconds
    busy: float = 0.0  # seconds of work in all

    def work(self, now: float, seconds: float) -> float:
        """When something that comes now is done."""
        self.free, self.busy = max(self.free, now) + seconds, self.busy + seconds
        return self.free


@dataclass
class Simulated:
    """What a fleet would need; shares of a core."""

    fleet: Fleet
    board: float  # the busiest
    router: float
    router_mbit: float  # in and out together
    robot_mbit: float  # into one robot: what is agreed, and the clock
    latency: float  # seconds from the beginning of a period until its agreed beliefs are out, the last 20 %


@dataclass
class Simulation:
    """Robots, one router and the boards of a fleet as servers; what happens next comes from one queue.

    `fanout` None: each board hears all others, as today. A number: boards form a tree with so many children each, in which a board
    hears its children and its parent, on `shared` subjects alone, and no other sub-team's robots.
    """

    fleet: Fleet
    costs: Costs
    fanout: int | None = None
    shared: int = OBJECTS
    seconds: float = 4.0
    queue: list[tuple[float, int, str, int]] = field(default_factory=list)
    router: Server = field(default_factory=Server)
    bytes: float = 0.0
    _number: int = 0

    def run(self) -> Simulated:
        fleet, count = self.fleet, self.fleet.sub_teams
        size = math.ceil(fleet.robots / count)
        self.boards, self.settled = [Server() for _ in range(count)], [0.0] * count
        latencies: deque[float] = deque()
        for i in range(count):
            self._at(0.0, "reports", i)
            self._at(fleet.period * (0.5 + 0.5 * i / count), "settle", i)
        while self.queue:
            now, _, what, i = heapq.heappop(self.queue)
            if now > self.seconds:
                break
            if what == "reports":
                self._reports(now, i, size)
                self._at(now + 1 / fleet.rate, "reports", i)
            elif what == "settle":
                latencies.append(self._settle(now, i, size) - now)
                self._at(now + fleet.period, "settle", i)
        late = sorted(latencies)[-max(1, len(latencies) // 5) :]
        return Simulated(
            fleet,
            max(board.busy for board in self.boards) / self.seconds,
            self.router.busy / self.seconds,
            8e-6 * self.bytes / self.seconds,
            8e-6 * self._subjects(size) * self.costs.consensus / fleet.period,
            float(np.median(late)),
        )

    def _at(self, time: float, what: str, i: int) -> None:
        self._number += 1
        heapq.heappush(self.queue, (time, self._number, what, i))

    def _carry(self, now: float, messages: int, receivers: int, size: int) -> float:
        """When the router has passed messages on to all their receivers."""
        self.bytes += messages * (1 + receivers) * size
        return self.router.work(now, 1e-3 * self.costs.route * messages * (1 + receivers))

    def _reports(self, now: float, i: int, size: int) -> None:
        """Every robot of a sub-team says a round of reports and its status, which all boards hear."""
        costs, messages = self.costs, size * (MATES + 2)
        came = self._carry(now, messages, 1, costs.report)
        self._carry(now, size, len(self.boards) if self.fanout is None else 1, 150)
        self.boards[i].work(came, 1e-3 * (messages + size) * (costs.take + costs.hear))
        if self.fanout is None:
            per = 1e-3 * size * (costs.take + costs.hear)
            for j, board in enumerate(self.boards):
                if j != i:
                    board.work(came, per)

    def _hearers(self, i: int) -> list[int]:
        """The boards that hear the consensuses of a board."""
        if self.fanout is None:
            return [j for j in range(len(self.boards)) if j != i]
        children = range(i * self.fanout + 1, min(len(self.boards), (i + 1) * self.fanout + 1))
        return [*children, *([(i - 1) // self.fanout] if i else [])]

    def _subjects(self, size: int) -> int:
        """About how many subjects a board publishes what was agreed."""
        return self.fleet.robots + OBJECTS if self.fanout is None else size + self.shared

    def _settle(self, now: float, i: int, size: int) -> float:
        """Settle and exchange; when what was agreed has been sent."""
        costs, own = self.costs, size + OBJECTS
        done = self.boards[i].work(now, 1e-3 * (own * costs.settle + size * (MATES + 2) * costs.opinion))
        hearers = self._hearers(i)
        passed = own if self.fanout is None else self.shared
        came = self._carry(done, passed, len(hearers), costs.consensus)
        for j in hearers:
            self.boards[j].work(came, 1e-3 * passed * (costs.take + costs.hear_consensus))
        subjects = self._subjects(size)
        parts = own + len(hearers) * passed
        done = self.boards[i].work(done, 1e-3 * (subjects * costs.agree + parts * costs.part))
        return self._carry(done, subjects, size, costs.consensus)


# --- all together -----------------------------------------------------------------------------------------------------------


def fitted(costs: Costs, driven: list[Driven]) -> Costs:
    """The network's costs, from the smaller half of the real runs: what their processes spent beyond the boards' own work."""
    half = driven[: max(1, len(driven) // 2)]
    routes, takes = [], []
    for it in half:
        bare = Simulation(it.fleet, replaced(costs, take=0.0, route=1.0)).run()
        routes.append(it.router / bare.router)
        unit = Simulation(it.fleet, replaced(costs, take=1.0)).run().board - bare.board
        takes.append(max(0.0, it.board - bare.board) / unit)
    return replaced(costs, route=float(np.median(routes)), take=float(np.median(takes)))


def replaced(costs: Costs, **changes: float) -> Costs:
    return Costs(**{**asdict(costs), **changes})


def saturation(seconds: float) -> list[Driven]:
    """One board of 8 robots, which report and are settled faster and faster."""
    return [drive(Fleet(8, 1, rate, 1 / rate), max(seconds, 4 / rate)) for rate in (0.5, 1, 2, 4, 8, 16)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each real run")
    parser.add_argument(
        "--robots", type=int, nargs="*", default=[6, 12, 24, 48], help="of the real runs with two boards"
    )
    parser.add_argument("--rows", type=Path, help="write all numbers here as JSON")
    parser.add_argument("--picture", type=Path, help="draw them (needs the extra `plot`)")
    told = parser.parse_args()
    found = costs()
    print("costs, ms:", {k: round(v, 4) for k, v in asdict(found).items()}, flush=True)
    curve = saturation(told.seconds)
    for it in curve:
        print(f"one board, {it.fleet.rate:g} Hz: {_shown(it)}", flush=True)
    runs = [drive(Fleet(robots, 2, 1.0, 1.0), told.seconds) for robots in told.robots]
    found = fitted(found, runs)
    print("with the network, ms:", {k: round(v, 4) for k, v in asdict(found).items()}, flush=True)
    compared = []
    for it in runs:
        expected = Simulation(it.fleet, found).run()
        compared.append({"robots": it.fleet.robots, "real": asdict(it), "simulated": asdict(expected)})
        print(
            f"{it.fleet.robots} robots, 2 boards, real: {_shown(it)}; simulated: board {expected.board:.3f}, "
            f"router {expected.router:.3f}",
            flush=True,
        )
    carried = simulated(found)
    for row in carried:
        print(row, flush=True)
    rows = {"costs": asdict(found), "one board": [asdict(it) for it in curve], "compared": compared, "fleets": carried}
    if told.rows:
        told.rows.write_text(json.dumps(rows, indent=1) + "\n")
    if told.picture:
        draw(rows, told.picture)


def _shown(it: Driven) -> str:
    return f"{it.sent:.0f} messages/s, board {it.board:.3f}, router {it.router:.3f}, heard {it.heard:.2f}, age {it.age:.2f} s"


def simulated(costs: Costs) -> list[dict[str, object]]:
    """Fleets of 10 to 10 000 robots at 1 Hz, all-to-all and as a tree of three children, in sub-teams of 10."""
    rows: list[dict[str, object]] = []
    for robots in (10, 30, 100, 300, 1000, 3000, 10_000):
        fleet = Fleet(robots, max(1, robots // 10), 1.0, 1.0)
        for name, fanout in (("all to all", None), ("tree of 3", 3)):
            it = Simulation(fleet, costs, fanout, seconds=3.0).run()
            numbers = {k: round(v, 3) for k, v in asdict(it).items() if k != "fleet"}
            rows.append({"robots": robots, "exchange": name, **numbers})
    return rows


def draw(rows: dict[str, Any], picture: Path) -> None:
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
    one = rows["one board"]
    left.plot([it["sent"] for it in one], [it["board"] for it in one], "o-", label="board")
    left.plot([it["sent"] for it in one], [it["router"] for it in one], "s-", label="router")
    left.set(title="one real board, 8 robots", xlabel="messages a second", ylabel="cores")
    left.legend()
    for name in ("all to all", "tree of 3"):
        mine = [it for it in rows["fleets"] if it["exchange"] == name]
        for what, mark in (("board", "-"), ("router", "--")):
            right.loglog([it["robots"] for it in mine], [it[what] for it in mine], mark, label=f"{what}, {name}")
    right.axhline(1.0, color="grey", lw=0.8, ls=":")
    right.set(title="simulated, 1 Hz, sub-teams of 10", xlabel="robots", ylabel="cores")
    right.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
