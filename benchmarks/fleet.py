"""What does a tree of teams cost and know, to 10 000 robots? `python benchmarks/fleet.py [--robots 64 512 4096 10000]`.

Real boards and shares in virtual time, in one process. Teams of eight robots share two objects with a team above them, eight teams
with each: a ball, which only the first team sees, and a can, which all see. Robots say what robots of the demo said in a run of
their own, byte by byte, so that sizes, sightings and covariances are theirs. What they hear changes nothing that they say.

Each team has a bus of its own, as it would have a router; what passes between teams waits for the next `STEP`. Processor time is
that of boards and shares, without Zenoh. `costs.py` measures a real board behind a real router.
"""

import argparse
import gc
import itertools
import math
import resource
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from recorded import RecordedRun, Voice, record

from blackboard.board.service import BoardService
from blackboard.client.share import Share
from blackboard.config import BoardSection
from blackboard.net.scheduler import BEGIN, Scheduler
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.process.columns import markdown_table
from blackboard.process.service import Around, Quiet, Service
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from blackboard.wire.names import VIA

SIZES = (64, 512, 4096, 10_000)
SIZE = 8  # robots of a team, and teams that share with one team above them
STEP = 0.05  # seconds: the longest way from one team to another
WARM, COUNTED = 10, 2  # seconds: until every team knows of the ball, and that are counted then
DEAD, HEALED = 14.0, 12.0  # seconds: longer than a belief lasts, and until all know of it again
SEEN = "object/ball"  # by the first team alone
SHARED = (SEEN, "object/can")
FRESH = 1.5  # seconds: boards agree once a second
GRID = Grid((50, 50))
GOLDEN = 0.618034  # of a tick, by which each team ticks later than the one before, so that no two tick at once


# --- a fleet ----------------------------------------------------------------------------------------------------------


@dataclass
class Spent:
    """What a process has used and carried since it was last set to zero."""

    seconds: float = 0.0  # of the processor
    into: int = 0  # bytes of keys and payloads
    out: int = 0


class Counted(Around):
    """A service that is measured. It opens each message by itself, as it would in a process of its own."""

    def __init__(self, inner: Service) -> None:
        super().__init__(inner)
        self.spent = Spent()

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind is Kind.PUT:
            self.spent.into += len(envelope.key) + len(envelope.payload)
        open_envelope.cache_clear()
        envelope = Envelope(envelope.key, envelope.payload, envelope.kind)  # the bytes alone
        began = time.process_time()
        return self._counted(super().receive(envelope, now), began)

    def wake(self, now: float) -> list[Envelope]:
        began = time.process_time()
        return self._counted(super().wake(now), began)

    def _counted(self, out: list[Envelope], began: float) -> list[Envelope]:
        self.spent.seconds += time.process_time() - began
        self.spent.out += sum(len(envelope.key) + len(envelope.payload) for envelope in out)
        return out


class Mouth(Counted):
    """A share in the team that it tells: there it is a robot."""

    def __init__(self, share: Share) -> None:
        super().__init__(share)
        self.share = share

    @property
    def listens(self) -> tuple[str, ...]:
        return self.share.tells.listens

    @property
    def watches(self) -> tuple[str, ...]:
        return self.share.tells.watches


class Ear(Quiet):
    """A share in the team that it hears: it keeps what came until the next step, as a network would."""

    def __init__(self, share: Share) -> None:
        self.listens, self.watches = share.hears.listens, share.hears.watches
        self.came: list[Envelope] = []

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self.came.append(envelope)
        return []


@dataclass(frozen=True)
class Knowledge:
    """What a team agrees on about the ball."""

    age: float  # seconds since the newest sighting in it
    entropy: float  # nats

    def __str__(self) -> str:
        return f"of age {self.age:.2f} s and entropy {self.entropy:.3f} nats"


class Fleet:
    """Teams in step, joined by shares from one team to another. Those of `recordings` have robots, the first name sees the ball."""

    def __init__(self, recordings: Mapping[str, RecordedRun], shares: Iterable[tuple[str, str]]) -> None:
        self.now, self.recordings, pairs = BEGIN, recordings, list(shares)
        self.teams = {name: Scheduler() for name in sorted({*recordings, *(name for pair in pairs for name in pair)})}
        self.boards: dict[str, Counted] = {}
        self.robots: dict[str, Counted] = {}  # one of each team: what all of them say, and what one of them hears
        self.shares: dict[tuple[str, str], tuple[Mouth, Ear]] = {}
        self._balls: dict[str, tuple[float, bytes]] = {}
        for number, name in enumerate(self.teams):
            self._begin(name, number * GOLDEN % 1.0)
        for source, to in pairs:
            share = Share(source, to, sub_team="a", grid=GRID, settings=BoardSection(), subjects=SHARED)
            self.shares[source, to] = mouth, ear = Mouth(share), Ear(share)
            self.teams[source].join(ear)
            self.teams[to].join(mouth)

    def _begin(self, name: str, later: float) -> None:
        team, recording = self.teams[name], self.recordings.get(name)
        team.bus.spies.append(partial(self._note, name))
        self.board_begins(name)
        if recording is not None:
            members = recording.scenario.team.robots
            tokens = tuple(keys.MEMBER.key(team="fleet", sub_team="a", robot=robot) for robot in members)
            self.robots[name] = Counted(Voice(recording.robots, name, later, tokens, recording.listens))
            team.join(self.robots[name])
            team.join(Voice(recording.world, name, later, (keys.WORLD.key(team="fleet"),)))

    def _note(self, name: str, envelope: Envelope) -> None:
        if envelope.key.endswith(f"/agreed/{SEEN}"):
            self._balls[name] = self.now, envelope.payload

    def board_begins(self, name: str) -> None:
        recording = self.recordings.get(name)
        settings = BoardSection() if recording is None else recording.scenario.board
        board = BoardService(team=name, sub_team="a", board="board-a", grid=GRID, settings=settings)
        self.boards[name] = Counted(board)
        self.teams[name].join(self.boards[name])

    def board_dies(self, name: str) -> None:
        self.teams[name].leave(self.boards[name])

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for team in self.teams.values():
                team.run_to(self.now)
            for (_, to), (mouth, ear) in self.shares.items():
                came, ear.came = ear.came, []
                for envelope in came:
                    self.teams[to].send(mouth, mouth.receive(envelope, self.now))

    def count_anew(self) -> None:
        for service in (*self.boards.values(), *self.robots.values(), *(mouth for mouth, _ in self.shares.values())):
            service.spent = Spent()

    def knows(self, name: str) -> Knowledge | None:
        """What a team agreed on about the ball in the last second; None: nothing."""
        at, payload = self._balls.get(name, (-math.inf, b""))
        if at < self.now - FRESH:
            return None
        consensus = decode(Consensus, payload)
        gathered = max(until for robot, until in consensus.ancestors.items() if not robot.startswith(VIA))
        return Knowledge(consensus.time - gathered + self.now - at, entropy(unpack(consensus.belief).p))


def tree(teams: int) -> dict[str, str]:
    """Each team of a tree, and the one above it; those of level 0 have robots."""
    level, number, above = 0, teams, dict[str, str]()
    while number > 1:
        above |= {f"t{level}.{i}": f"t{level + 1}.{i // SIZE}" for i in range(number)}
        level, number = level + 1, -(-number // SIZE)
    return above


def planted(above: Mapping[str, str], recordings: Sequence[RecordedRun]) -> Fleet:
    """A tree that shares both ways; its first team is that of the first recording, and sees the ball."""
    first, others = recordings
    names = [name for name in above if name.startswith("t0.")]
    ways = [way for low, high in above.items() for way in ((low, high), (high, low))]
    return Fleet({name: others if i else first for i, name in enumerate(names)}, ways)


def way(above: Mapping[str, str], name: str) -> list[str]:
    """A team, the one above it, and so on to the root."""
    return [name, *way(above, above[name])] if name in above else [name]


# --- what is measured -------------------------------------------------------------------------------------------------


def grown(robots: int, recordings: Sequence[RecordedRun]) -> tuple[list[list[str]], list[list[str]]]:
    """What a tree with so many robots costs in a second, and what its teams know of the ball, by the shares on the way."""
    began, worked = time.perf_counter(), time.process_time()
    above = tree(robots // SIZE)
    fleet = planted(above, recordings)
    gc.freeze()  # else boards are charged for walks through all the others
    up, down = way(above, "t0.0"), way(above, f"t0.{robots // SIZE - 1}")
    path = [*up, *reversed(down[:-1])]
    known: dict[str, list[Knowledge]] = {name: [] for name in path}
    for second in range(WARM + COUNTED):
        if second <= WARM:
            fleet.count_anew()
        for _ in range(round(1 / STEP)):
            fleet.run(STEP)
            for name in path:
                known[name] += [knows] if (knows := fleet.knows(name)) is not None and second >= WARM else []
        heard = np.mean([crew.spent.into for crew in fleet.robots.values()]) / max(1, second + 1 - WARM) / 1e3
        know = [f"{knowledge.age:.1f}" for name in path if (knowledge := fleet.knows(name)) is not None]
        left = (time.perf_counter() - began) / (second + 1) * (WARM + COUNTED - second - 1)
        print(
            f"{robots} robots, {second + 1} s of {WARM + COUNTED}: {heard:.2f} kB/s into a robot, ages {' '.join(know)} s, "
            f"{left / 60:.1f} min left",
            file=sys.stderr,
        )
    processor = time.process_time() - worked
    rows = [["robots", f"{robots}"], ["boards", f"{len(fleet.boards)}"], *costs(fleet)]
    rows += [["wall, s", f"{time.perf_counter() - began:.0f}"], ["processor, s", f"{processor:.0f}"]]
    rows += [["memory, GiB", f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2:.2f}"]]
    return [list(row) for row in zip(*rows, strict=True)], told(robots, path, known)


def costs(fleet: Fleet) -> list[list[str]]:
    """What boards, shares and robots have spent in each second that was counted: rows of a name and a number."""
    leaves, inner = (
        [board.spent for name, board in fleet.boards.items() if (name in fleet.robots) == robotic]
        for robotic in (True, False)
    )
    shares, crews = [mouth.spent for mouth, _ in fleet.shares.values()], [crew.spent for crew in fleet.robots.values()]
    spent = {
        "a board with robots, ms": 1e3 * np.median([used.seconds for used in leaves]),
        "the busiest without, ms": 1e3 * max(used.seconds for used in inner),
        "all boards, cores": sum(used.seconds for used in (*leaves, *inner)),
        "all shares, cores": sum(used.seconds for used in shares),
        "into a board, kB": np.median([used.into for used in leaves]) / 1e3,
        "into one without robots, kB": max(used.into for used in inner) / 1e3,
        "a share hears, kB": max(used.into for used in shares) / 1e3,
        "a share says, kB": max(used.out for used in shares) / 1e3,
        "out of a robot, kB": np.mean([used.out for used in crews]) / SIZE / 1e3,
        "into a robot, kB": np.mean([used.into for used in crews]) / 1e3,
        "at most, kB": max(used.into for used in crews) / 1e3,
    }
    return [[name, f"{value / COUNTED:.3g}"] for name, value in spent.items()]


def told(robots: int, path: Sequence[str], known: Mapping[str, Sequence[Knowledge]]) -> list[list[str]]:
    """What each team on a path knew of the ball, if anything: rows for `TOLD`."""
    return [
        [
            f"{robots}",
            f"{shares_on}",
            name,
            f"{np.mean([k.age for k in known[name]]):.2f}",
            f"{known[name][-1].entropy:.3f}",
        ]
        for shares_on, name in enumerate(path)
        if known[name]
    ]


def died(recordings: Sequence[RecordedRun]) -> list[str]:
    """A node in the middle dies and comes back: until when others know of the ball, and from when on again."""
    above = tree(SIZE**2)
    fleet, middle = planted(above, recordings), above["t0.0"]
    lines = []

    def look(seconds: float, until: Callable[[], bool]) -> float:
        """Seconds until a fact holds first, of those that are let pass."""
        first = math.inf
        for step in range(1, round(seconds / STEP) + 1):
            fleet.run(STEP)
            first = min(first, step * STEP if until() else math.inf)
        return first

    last = f"t0.{SIZE**2 - 1}"
    fleet.run(WARM)
    before = fleet.knows("t0.0"), fleet.knows(last)
    fleet.board_dies(middle)
    gone = look(DEAD, lambda: fleet.knows(last) is None)
    lines.append(
        f"{middle} dies: {last} knows nothing of the ball after {gone:.1f} s; t0.0 knew it {before[0]}, then {fleet.knows('t0.0')}"
    )
    fleet.board_begins(middle)
    again = look(HEALED, lambda: fleet.knows(last) is not None)
    lines.append(
        f"{middle} comes back: {last} knows of the ball after {again:.1f} s; it knew it {before[1]}, then {fleet.knows(last)}"
    )
    return lines


def circle(recordings: Sequence[RecordedRun]) -> str:
    """Teams that tell each other in a circle, against the same ones where the last does not tell the first."""
    first, others = recordings
    names = [f"t{i}" for i in range(SIZE)]
    line = list(itertools.pairwise(names))
    fleets = [
        Fleet({name: others if i else first for i, name in enumerate(names)}, ways)
        for ways in (line, [*line, (names[-1], names[0])])
    ]
    gained = -math.inf  # nats
    for _ in range(round((WARM + COUNTED) / STEP)):
        for fleet in fleets:
            fleet.run(STEP)
        for name in names:
            open_, closed = (fleet.knows(name) for fleet in fleets)
            if open_ is not None and closed is not None:
                gained = max(gained, open_.entropy - closed.entropy)
    return f"a circle of {SIZE} teams is surer of the ball than a line, at most, by {gained:.3g} nats"


# --- all together -----------------------------------------------------------------------------------------------------

TOLD = ("robots", "shares on the way", "team", "mean age, s", "entropy at the end, nats")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fusion", choices=("opinions", "joint"), default="opinions", help="of the teams with robots")
    parser.add_argument("--robots", type=int, nargs="*", default=SIZES, help="sizes of the tree; none: no tree")
    parser.add_argument("--trouble", action="store_true", help="a node that dies, and a circle of teams")
    args = parser.parse_args()
    if args.robots or args.trouble:
        recordings = [record(SIZE, args.fusion, WARM + DEAD + HEALED, subject) for subject in ("ball", "mine")]
    for robots in args.robots:
        costs, knowing = grown(robots, recordings)
        print("\n".join([*markdown_table(costs), "", *markdown_table([TOLD, *knowing]), ""]), flush=True)
    if args.trouble:
        print("\n".join([*died(recordings), circle(recordings)]))


if __name__ == "__main__":
    main()
