"""Random grounds on which three robots drive smoothly, whatever their rates. `python -m tests.field.grounds FIRST PAST`.

All move on in small pieces of time. A robot sums the pieces of its odometry until it steps, and sees where the others then are. Beside
the team is one filter with all pieces, all readings and the true models. Metres, radians, seconds.
"""

import argparse
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from blackboard.opinion.gaussian.vehicle import turned_by
from blackboard.wire.messages import Odometry, Sighting
from examples.field.central import Central
from examples.field.world import ROBOTS, Arena, Said, Seen, Truth, bounced
from robot_agent.driven import SinceStep
from tests.field.play import SETTLED, Robots, Scores, add_all, gathered, new_scores, note, parts_alone, show, team_on

PIECE = 0.05
COMPASS = 0.05  # radians: the noise of a compass, as it claims
MARGIN = 1.0  # metres that goals keep from the walls


@dataclass(frozen=True, kw_only=True)
class Kit(Truth):
    """What one robot is like."""

    pieces: int  # of time, in a step
    phase: int  # pieces by which it steps late
    speed: float = 0.6  # m/s
    turning: float = 1.0  # rad/s
    gps: float = 0.0  # 0: it has none


class Ground(Arena):
    """Mutable; `passing` moves it on."""

    def __init__(
        self, seed: int, hertz: float | None = None, *, together: bool = False, walks: float = 0.3, rolls: float = 0.0
    ) -> None:
        """`hertz`: the rate of all robots [default: drawn for each], `together`: they step at the same times.

        The ball `walks` at random (per sqrt(s)), or it `rolls` (m/s), and the walls throw it back.
        """
        self.seed, self.hertz, self.together, self.walks, self.rolls = seed, hertz, together, walks, rolls
        self.random = draw = np.random.default_rng(seed)
        self.size = draw.uniform((8.0, 6.0), (20.0, 14.0)).round()
        with_gps = f"r{draw.integers(1, 4)}"
        self.kits = {robot: self._kit(robot == with_gps) for robot in ROBOTS}
        super().__init__(draw, ROBOTS, np.full(2, MARGIN), self.size - MARGIN)
        self.ball = draw.uniform(self.size / 3, self.size * 2 / 3)
        angle = draw.uniform(-math.pi, math.pi)
        self.velocity = rolls * np.array([math.cos(angle), math.sin(angle)])
        self.number = 0

    def _kit(self, has_gps: bool) -> Kit:
        draw = self.random.uniform
        hertz = self.hertz or float(self.random.choice([2.0, 5.0, 10.0]))
        pieces = round(1 / hertz / PIECE)
        return Kit(
            pieces=pieces,
            phase=0 if self.together else int(self.random.integers(0, pieces)),
            speed=draw(0.3, 1.0),
            turning=draw(0.5, 1.5),
            along=draw(0.02, 0.08),
            turn=draw(0.01, 0.05),
            gps=draw(0.2, 0.6) if has_gps else 0.0,
            gps_every=float(self.random.choice([0.5, 1.0, 2.0])),
            range=draw(0.05, 0.2),
            bearing=draw(0.02, 0.06),
            reach=draw(4.0, 10.0),
            view=draw(1.0, math.pi),
            seen_every=0.5,
            ball=0.0 if self.rolls else self.walks,
            dt=PIECE,
        )

    @property
    def time(self) -> float:
        return self.number * PIECE

    def passing(self, seconds: float) -> Iterator[Mapping[str, Said]]:
        """What each robot's sensors say in each piece of time, the starts first; `steps` says who steps at its end."""
        yield {robot: Said(0.0, 0.0, PIECE, start=self.start(robot, kit)) for robot, kit in self.kits.items()}
        for self.number in range(1, round(seconds / PIECE) + 1):
            self._roll()
            driven = {r: self.drive(r, kit, PIECE, kit.speed, kit.turning) for r, kit in self.kits.items()}
            yield {robot: self._said(robot, *measured) for robot, measured in driven.items()}

    def steps(self, robot: str) -> bool:
        kit = self.kits[robot]
        return (self.number - kit.phase) % kit.pieces == 0

    def _said(self, robot: str, distance: float, turn: float) -> Said:
        kit, gps, seen = self.kits[robot], None, tuple[Seen, ...]()
        if self.steps(robot):
            step = (self.number - kit.phase) // kit.pieces
            if kit.gps and step % max(1, round(kit.gps_every / PIECE / kit.pieces)) == 0:
                gps = self.fix(robot, kit)
            if step % max(1, round(kit.seen_every / PIECE / kit.pieces)) == 0:
                seen = self.seen(robot, kit)
        return Said(distance, turn, PIECE, gps=gps, seen=seen)

    def _roll(self) -> None:
        walked = 0.0 if self.rolls else self.walks * math.sqrt(PIECE)
        place = self.ball + self.velocity * PIECE + self.random.normal(size=2) * walked
        self.ball, self.velocity = bounced(place, self.velocity, self.size)


def odometry_of(pieces: list[Said], kit: Kit, told: bool) -> Odometry:
    """The sum of some pieces; `told`: with its sigmas."""
    distance, turn, dt = (sum(getattr(piece, name) for piece in pieces) for name in ("distance", "turn", "dt"))
    sigmas = {}
    if told:
        sigmas = {"distance_sigma": kit.along * math.sqrt(abs(distance)), "turn_sigma": kit.turn * math.sqrt(dt)}
    return Odometry(distance=distance, turn=turn, dt=dt, **sigmas)


class Grounds(Robots):
    """A board and a team of robots that are driven by a ground. `each`: pieces of odometry are told one by one, not summed.

    They see ranges or bearings `alone`. Who is `unplaced` is not told where it starts. A share of `wild` sightings is of anywhere
    in view, and their ranges are `longer` by this factor, their bearings `askew` by an angle (radians). Odometry measures `less`:
    these shares of ways and of turns; the fresh noise of it is `described` by the scenario. Robots have a `compass` that reads this angle too much, if any, and antennas so far `ahead`.
    Wheels are `dead` from and until a time (s): they measure nothing while the robot drives on. The filters beside the team get the
    right ranges and odometry.
    """

    def __init__(
        self,
        ground: Ground,
        *,
        told: bool = False,
        each: bool = False,
        alone: Literal["range", "bearing"] | None = None,
        unplaced: Collection[str] = (),
        wild: float = 0.0,
        longer: float = 1.0,
        askew: float = 0.0,
        less: tuple[float, float] = (1.0, 1.0),
        compass: float | None = None,
        ahead: float = 0.0,
        dead: Mapping[str, tuple[float, float]] | None = None,
        described: bool = False,
        **board: object,
    ) -> None:
        drift = {} if ground.rolls else {"objects_drift": ground.walks}
        noise = {
            robot: {"odometry": {"along": kit.along * kit.speed**0.5, "across": 0.0, "turn": kit.turn}}
            for robot, kit in ground.kits.items()
        }
        chosen = team_on(ground.size, ground.kits, drift | board, **({"robots": noise} if described else {}))
        super().__init__(chosen, 0.2 * (0.618 * ground.seed % 1.0))
        self.ground, self.told, self.each, self.alone, self.unplaced = ground, told, each, alone, unplaced
        self.dead = dict(dead or {})
        self.askew, self.less, self.compass, self.ahead = askew, less, compass, ahead
        self.wild, self.longer, self.random = wild, longer, np.random.default_rng([ground.seed, 1])

    def play(self, seconds: float) -> Scores:
        """Scores by who believes (`team`, `central`, `alone`) and subject."""
        ground, scores = self.ground, new_scores()
        central, alone = Central(ground.kits), {robot: Central({robot: kit}) for robot, kit in ground.kits.items()}
        begin = self.now + 1.0
        self.run_to(begin)
        pieces: dict[str, list[Said]] = {robot: [] for robot in ground.kits}
        for said in ground.passing(seconds):
            central.step(said, PIECE)
            for robot, own in alone.items():
                own.step({robot: said[robot]}, PIECE)
                pieces[robot].append(said[robot])
            self.run_to(max(self.now, begin + ground.time))
            for robot in ground.kits:
                if ground.number and not ground.steps(robot):
                    continue
                since = self._since(robot, said[robot], pieces[robot])
                pieces[robot] = []
                pose, out = self.robots[robot].step(since, self.now, begin + ground.time)
                self.send(self.robots[robot], out)
                if ground.time >= SETTLED:
                    note(scores, robot, pose, ground.poses[robot], central, alone[robot])
            if ground.time >= SETTLED and ground.number % 4 == 0:
                self.note_ball(scores, "ball", ground.ball, central)
        return scores

    def _since(self, robot: str, last: Said, pieces: list[Said]) -> SinceStep:
        kit = self.ground.kits[robot]
        since = replace(gathered(last, kit, False), odometry=None)
        if last.start is not None:
            return SinceStep() if robot in self.unplaced else since
        since = self._pointing(robot, since)
        since = replace(since, sightings=tuple(self._misread(seen, kit) for seen in since.sightings))
        since = since if self.alone is None else parts_alone(since, self.alone)
        begin, end = self.dead.get(robot, (0.0, 0.0))
        if begin <= self.ground.time < end:
            pieces = [replace(piece, distance=0.0, turn=0.0) for piece in pieces]
        for part in [[piece] for piece in pieces] if self.each else [pieces]:
            told, (way, turn) = odometry_of(part, kit, self.told), self.less
            told = told.model_copy(update={"distance": way * told.distance, "turn": turn * told.turn})
            since = since.plus(SinceStep(told))
        return since

    def _pointing(self, robot: str, since: SinceStep) -> SinceStep:
        """With a compass, and fixes of an antenna that is ahead, if there are such."""
        heading, fix = float(self.ground.poses[robot][2]), since.fix
        if self.compass is not None:
            told = heading + self.compass + self.random.normal(0.0, COMPASS)
            since = replace(since, compass=(math.remainder(told, math.tau), COMPASS))
        if self.ahead and fix is not None:
            (x, y), (dx, dy) = fix.position, turned_by((self.ahead, 0.0), heading)
            since = replace(since, fix=fix.model_copy(update={"position": (x + dx, y + dy)}))
        return since

    def _misread(self, seen: Sighting, kit: Kit) -> Sighting:
        if self.random.random() >= self.wild:
            bearing = math.remainder(seen.bearing + self.askew, math.tau)
            return seen.model_copy(update={"range": self.longer * seen.range, "bearing": bearing})
        anywhere = {"range": self.random.uniform(0.0, kit.reach), "bearing": self.random.uniform(-kit.view, kit.view)}
        return seen.model_copy(update=anywhere)


#: Flags of `main` that say what is wrong with the robots of `Grounds`.
WRONG = ("told", "each", "alone", "wild", "longer", "askew", "less", "compass", "ahead", "described")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("first", type=int)
    parser.add_argument("past", type=int)
    parser.add_argument("--hertz", type=float)
    parser.add_argument("--ball", type=float, default=0.3)
    parser.add_argument("--rolls", type=float, default=0.0)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--told", action="store_true")
    parser.add_argument("--each", action="store_true")
    parser.add_argument("--described", action="store_true", help="the scenario says how exact the odometry is")
    parser.add_argument("--together", action="store_true")
    parser.add_argument("--alone", choices=("range", "bearing"), help="what robots see of others")
    parser.add_argument("--unplaced", action="store_true", help="one robot without GPS is not told where it starts")
    parser.add_argument("--wild", type=float, default=0.0, help="share of sightings that are of anywhere in view")
    parser.add_argument("--longer", type=float, default=1.0, help="factor of all ranges that the robots measure")
    parser.add_argument(
        "--askew", type=float, default=0.0, help="radians that the bearings of all robots read too much"
    )
    parser.add_argument(
        "--less", type=float, nargs=2, default=(1.0, 1.0), help="shares of ways and turns that odometry measures"
    )
    parser.add_argument("--compass", type=float, help="radians that the compasses of all robots read too much")
    parser.add_argument(
        "--ahead", type=float, default=0.0, help="metres that the antenna of a GPS stands ahead of its robot"
    )
    chosen = parser.parse_args()
    totals = new_scores()
    for seed in range(chosen.first, chosen.past):
        ground = Ground(seed, chosen.hertz, together=chosen.together, walks=chosen.ball, rolls=chosen.rolls)
        unplaced = [robot for robot, kit in ground.kits.items() if not kit.gps][:1] if chosen.unplaced else []
        wrong = {name: value for name, value in vars(chosen).items() if name in WRONG}
        played = Grounds(ground, unplaced=unplaced, **wrong).play(chosen.seconds)
        ratios = [f"{n} {t.rmse / played['central'][n].rmse:.2f} {t.coverage():.2f}" for n, t in played["team"].items()]
        print(seed, ", ".join([*(f"{robot} unplaced" for robot in unplaced), *ratios]), flush=True)
        add_all(totals, played)
    show(totals)


if __name__ == "__main__":
    main()
