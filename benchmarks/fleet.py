"""What do a board, a router and a link carry, and how far does that go? `python benchmarks/fleet.py`.

Long, because what is measured, and the comparison with what is simulated from it, belong to one question.

1. *costs*: processor time of a board's work by kind (hear, settle, exchange), in this process, without Zenoh: a least-squares fit.
2. *drive*: real boards as processes behind a real Zenoh router on 127.0.0.1, with generated robots, slower to faster: processor time
   of boards and router, what arrived, how old the answers are. So the costs of the network are known too.
3. *simulate* (`fleet_simulation.py`): a discrete-event simulation of robots, router and boards with these costs, to 10 000 robots.

Nobody gives a world's clock, so that boards settle every `period` whatever has arrived: the way of real robots. Processor time counts,
not wall time, because the machine may be shared; a share of 1 is one busy core.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections import defaultdict
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from fleet_simulation import Costs, Fleet, Simulation
from programs import program

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
FULL = 0.8  # of a core: a busier board may have left ticks out, so that the costs are not fitted to its run


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


@dataclass
class Driven:
    """What real processes did under generated traffic; shares of a core, messages a second."""

    fleet: Fleet
    seconds: float
    sent: float  # reports and statuses a second that were really published
    board: float  # share of a core, the busiest
    boards: float  # all of them
    router: float
    heard: float  # share of what was sent to the busiest board that it has handled
    settled: float  # settlements of the first board, as a share of those that were due
    age: float  # seconds, median: from a settlement's stamp until the consensus arrived here, in the first third of the run
    age_last: float  # the same in the last third


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
        router = stack.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        boards = [
            stack.enter_context(
                program("-m", "blackboard", "serve", "--scenario", str(file), "--sub-team", name, "-e", endpoint)
            )
            for name in members
        ]
        link = stack.enter_context(Link(LinkConfig(connect=(endpoint,)), "fleet"))
        for name in members:
            for token in tokens(fleet, name):
                link.token(token)
        link.subscribe(keys.CONSENSUS.key(team="fleet", sub_team="s0", subject="**"))
        link.subscribe(keys.STATUS.key(team="fleet", sub_team="*", process="*"))
        _say(link, fleet, 2.0)
        before = [it.processor_seconds() for it in (router, *boards)]
        spoken = _say(link, fleet, seconds)
        after = [it.processor_seconds() for it in (router, *boards)]
    spent = [(b - a) / spoken.wall for a, b in zip(before, after, strict=True)]
    mine = spoken.sent / spoken.wall / len(members)
    thirds = [[age for at, age in spoken.ages if int(3 * at / spoken.wall) == third] for third in (0, 2)]
    first, last = (float(np.median(it)) if it else math.nan for it in thirds)
    return Driven(
        fleet, spoken.wall, spoken.sent / spoken.wall, max(spent[1:]), sum(spent[1:]), spent[0],
        min(1.0, spoken.heard() / mine), min(1.0, spoken.answers * fleet.period / spoken.wall), first, last,
    )  # fmt: skip


@dataclass
class Spoken:
    """What was said for all robots, and what came back."""

    wall: float = 0.0  # seconds
    sent: int = 0  # messages
    answers: int = 0  # consensuses of the first board about one robot
    ages: list[tuple[float, float]] = field(default_factory=list)  # when a consensus came, and its age then; seconds
    #: Of each board, from its statuses: when they came, in seconds, and how many messages it had handled.
    counted: dict[str, list[tuple[float, int]]] = field(default_factory=dict)

    def heard(self) -> float:
        """Messages a second that the board which handled most has handled."""
        ends = [(of[0], of[-1]) for of in self.counted.values() if len(of) > 1]
        return max(((b[1] - a[1]) / (b[0] - a[0]) for a, b in ends), default=0.0)


def _say(link: Link, fleet: Fleet, seconds: float) -> Spoken:
    """Speak for all robots."""
    began = due = time.time()
    end, tick, found = began + seconds, 0, Spoken()
    while time.time() < end:
        now = time.time()
        for sub_team in fleet.members():
            for envelope in said(fleet, sub_team, tick, now):
                link.send(envelope)
                found.sent += 1
        tick, due = tick + 1, max(due + 1 / fleet.rate, time.time() - 1.0)
        while True:
            for envelope in link.receive(max(0.0, min(due, end) - time.time())):
                arrived = time.time()
                if "/consensus/" in envelope.key:
                    found.ages.append((arrived - began, arrived - decode(Consensus, envelope.payload).time))
                    found.answers += envelope.key.endswith("/robot/r0")
                elif "/status/board" in envelope.key:
                    handled = decode(Status, envelope.payload).counters.get("heard", 0)
                    found.counted.setdefault(envelope.key, []).append((arrived - began, handled))
            if time.time() >= min(due, end):
                break
    found.wall = time.time() - began
    return found


# --- all together -----------------------------------------------------------------------------------------------------------


def fitted(costs: Costs, curve: list[Driven]) -> Costs:
    """The network's costs and those of idling, from the real runs of one board: what its process spent beyond its own work."""
    rows, beyond, routes = [], [], []
    for it in curve:
        bare = Simulation(it.fleet, replaced(costs, take=0.0, route=1.0)).run()
        unit = Simulation(it.fleet, replaced(costs, take=1.0)).run().board - bare.board
        rows.append([unit / it.board, 1e-3 / it.board])  # so that errors count by their share
        beyond.append((it.board - bare.board) / it.board)
        routes.append(it.router / bare.router)
    take, idle = _non_negative(np.array(rows), np.array(beyond))
    return replaced(costs, take=take, idle=idle, route=float(np.median(routes[-3:])))


def replaced(costs: Costs, **changes: float) -> Costs:
    return Costs(**{**asdict(costs), **changes})


#: Driven in turn: one board of 8 robots, which report and are settled faster and faster.
CURVE = tuple(Fleet(8, 1, rate, 1 / rate) for rate in (0.5, 1, 2, 4, 8, 16, 32, 64))
#: Compared with the simulation, which was fitted to the curve alone: robots, sub-teams, and reports and settlements a second.
COMPARED = (
    (6, 2, 1.0),
    (12, 2, 1.0),
    (24, 2, 1.0),
    (48, 2, 1.0),
    (24, 4, 2.0),
    (64, 8, 1.0),
    (64, 8, 2.0),
    (64, 8, 10.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=9.0, help="of each real run")
    parser.add_argument("--rows", type=Path, help="write all numbers here as JSON")
    parser.add_argument("--picture", type=Path, help="draw them (needs the extra `plot`)")
    told = parser.parse_args()
    found = costs()
    print("costs, ms:", {k: round(v, 4) for k, v in asdict(found).items()}, flush=True)
    curve = []
    for fleet in CURVE:
        curve.append(drive(fleet, max(told.seconds, 4 / fleet.rate)))
        print(f"one board, {fleet.rate:g} Hz: {_shown(curve[-1])}", flush=True)
    found = fitted(found, [it for it in curve if it.board < FULL])
    print("with the network, ms:", {k: round(v, 4) for k, v in asdict(found).items()}, flush=True)
    compared = []
    for robots, sub_teams, rate in COMPARED:
        real = drive(Fleet(robots, sub_teams, rate, 1 / rate), told.seconds)
        expected = Simulation(real.fleet, found).run()
        compared.append({"robots": robots, "sub_teams": sub_teams, "real": asdict(real), "simulated": asdict(expected)})
        print(
            f"{robots} robots, {sub_teams} boards, {rate:g} Hz, real: {_shown(real)}; simulated: "
            f"busiest board {expected.board:.3f}, all boards {expected.boards:.3f}, router {expected.router:.3f}",
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
    return (
        f"{it.sent:.0f} messages/s, busiest board {it.board:.3f}, all boards {it.boards:.3f}, router {it.router:.3f}, "
        f"heard {it.heard:.2f}, settled {it.settled:.2f}, age {it.age:.3f} then {it.age_last:.3f} s"
    )


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
