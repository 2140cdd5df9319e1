"""One team of sub-teams, or a tree of teams that share what both see: what does each cost? `python benchmarks/tree.py`.

Real boards and shares (`blackboard share`) as services on a bus in this process, with generated robots (as in `fleet.py`: each
reports itself, two mates and one of two objects, once a second). "One team": a board for each sub-team of eight, which all hear
each other. "Tree": each of these is a team of its own, with two shares to and from a team `all` of one board, for the objects.

Processor time in the services themselves; messages and bytes as they are delivered. And whether the leaves of the tree know where an
object is that only one of them sees, and how surely: the same for one team.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from fleet import BELIEFS, GRID, belief
from fleet_simulation import Fleet

from blackboard.board.service import BoardService
from blackboard.client.share import Share
from blackboard.config import BoardSection
from blackboard.net.bus import Bus, BusLink
from blackboard.opinion.weights import entropy
from blackboard.process.service import Service, connect
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, Report, Status

SIZE = 8  # robots of a sub-team, or of a team in the tree
ROOT = "all"
ONE = "object/seen"  # by the robots of the first sub-team or team alone
STEP = 0.25  # seconds between two looks at who is due
WARM = 8.0  # seconds before anything is counted


@dataclass(frozen=True)
class Told:
    """Of a second: what a way costs, and what the last sub-team or team believes about the object that the first one sees."""

    busiest: float  # processor milliseconds of the busiest board
    boards: float  # of all boards
    shares: float  # of all shares
    delivered: int  # messages delivered to boards and shares
    robot: float  # kilobytes into a robot
    off: float  # cells, from where the first one sees it
    entropy: float  # nats
    first_entropy: float  # nats, of the first one


class Run:
    """Teams with their robots, on a bus; a place is (team, sub-team)."""

    def __init__(self, places: Iterable[tuple[str, str]], shares: Iterable[tuple[str, str]]) -> None:
        self.bus, self.now, self.begun = Bus(), 1e6, False
        self.places = list(places)
        self.spent: defaultdict[Service, float] = defaultdict(float)  # processor seconds
        self.delivered = 0
        self.into: Counter[tuple[str, str]] = Counter()  # bytes of what is agreed, by place
        self.links: dict[Service, BusLink] = {}
        self.agreed: dict[tuple[str, str], Consensus] = {}
        self.fleet = Fleet(SIZE, 1)
        self.robots = [f"r{i}" for i in range(SIZE)]
        self.bus.spies.append(self._spy)
        voice = self.bus.connect()
        for team, sub_team in self.places:
            for robot in self.robots if team != ROOT else []:
                voice.token(keys.MEMBER.key(team=team, sub_team=sub_team, robot=f"{sub_team}{robot}"))
            self._join(
                BoardService(team=team, sub_team=sub_team, board="board", grid=GRID, settings=BoardSection(period=1.0))
            )
        for source, to in shares:
            self._join(Share(source, to, sub_team="s", grid=GRID, settings=BoardSection()))

    def _join(self, service: Service) -> None:
        self.links[service] = self.bus.connect()
        connect(service, self.links[service])

    def _spy(self, envelope: Envelope) -> None:
        found = keys.AGREED.match(envelope.key)
        if found is not None and self.begun:
            place = found["team"], found["sub_team"]
            self.into[place] += len(envelope.payload) + len(envelope.key)
            if found["subject"] == ONE:
                self.agreed[place] = decode(Consensus, envelope.payload)

    def run(self, seconds: float) -> None:
        for step in range(round(seconds / STEP)):
            if step % round(1 / STEP) == 0:
                for envelope in self._said():
                    self.bus.send(envelope)
            self._settle()
            self.now += STEP

    def _said(self) -> Iterable[Envelope]:
        """What all robots report now."""
        for team, sub_team in self.places:
            for robot in self.robots if team != ROOT else []:
                subjects = self.fleet.subjects(robot, self.robots) + (
                    [ONE] if (team, sub_team) == self.places[0] else []
                )
                named = [s.replace("robot/", f"robot/{sub_team}") for s in subjects]
                source, tick = f"{sub_team}{robot}", int(1000 * self.now)
                for subject in named:
                    said = BELIEFS[7] if subject == ONE else belief(subject, source)
                    report = Report(source=source, subject=subject, tick=tick, time=self.now, belief=said)
                    yield Envelope(
                        keys.REPORT.key(team=team, sub_team=sub_team, source=source, subject=subject), encode(report)
                    )
                status = Status(
                    process=source, kind="robot", tick=tick, time=self.now, phase="reported", subjects=named
                )
                yield Envelope(keys.STATUS.key(team=team, sub_team=sub_team, process=source), encode(status))

    def _settle(self) -> None:
        """Deliver, and wake who is due, until nothing is left to do now."""
        of = {id(link): service for service, link in self.links.items()}
        due: list[Service] = [*self.links]
        while due:
            while self.bus.waiting:
                waiting, self.bus.waiting = self.bus.waiting, []
                for link, envelope, _ in waiting:
                    if (service := of.get(id(link))) is not None:
                        self.delivered += self.begun and envelope.kind is Kind.PUT
                        self._do(service, partial(service.receive, envelope, self.now))
            self.now += 1e-6
            due = [s for s in self.links if (at := s.wake_at(self.now)) is not None and at <= self.now]
            for service in due:
                self._do(service, partial(service.wake, self.now))

    def _do(self, service: Service, work: Callable[[], list[Envelope]]) -> None:
        began = time.process_time()
        out = work()
        self.spent[service] += (time.process_time() - began) * self.begun
        for envelope in out:
            self.links[service].send(envelope)

    def told(self, seconds: float) -> Told:
        self.run(WARM)
        self.begun = True
        self.run(seconds)
        boards = [ms for service, ms in self.spent.items() if isinstance(service, BoardService)]
        shares = sum(ms for service, ms in self.spent.items() if isinstance(service, Share))
        leaves = [place for place in self.places if place[0] != ROOT]
        first, last = (unpack(self.agreed[leaves[at]].belief) for at in (0, -1))
        seen = unpack(BELIEFS[7]).mean()
        return Told(
            1e3 * max(boards) / seconds, 1e3 * sum(boards) / seconds, 1e3 * shares / seconds, round(self.delivered / seconds),
            max(self.into[place] for place in leaves) / seconds / 1e3,
            float(((last.mean() - seen) ** 2).sum() ** 0.5), entropy(last.p), entropy(first.p),
        )  # fmt: skip


def one_team(sub_teams: int) -> Run:
    return Run([("one", f"s{i}") for i in range(sub_teams)], [])


def tree(teams: int) -> Run:
    leaves = [f"t{i}" for i in range(teams)]
    pairs = [pair for leaf in leaves for pair in ((leaf, ROOT), (ROOT, leaf))]
    return Run([*((leaf, "s") for leaf in leaves), (ROOT, "s")], pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each run, that are counted")
    parser.add_argument(
        "--parts", type=int, nargs="+", default=[2, 4, 8, 16], help="sub-teams, or teams below the root"
    )
    told = parser.parse_args()
    print(
        "| robots | way | busiest board, ms/s | all boards | shares | messages/s | into a robot, kB/s | off, cells | entropy, nats |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for parts in told.parts:
        for way, made in (("one team", one_team), ("tree", tree)):
            it = made(parts).told(told.seconds)
            print(
                f"| {SIZE * parts} | {way} | {it.busiest:.0f} | {it.boards:.0f} | {it.shares:.0f} | {it.delivered} | {it.robot:.0f} "
                f"| {it.off:.2f} | {it.first_entropy:.2f}, {it.entropy:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
