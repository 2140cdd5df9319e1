"""Teams whose sensors are not what their models say: how far off they are, and how honest. One table by one command.

    python -m tests.robot_agent.spoilt recording --mrclam DIR --start 1248446200 --seconds 300 --protocols A_all D_one3
    python -m tests.robot_agent.spoilt field --seeds 1 7
    python -m tests.robot_agent.spoilt demo --seeds 31 35

`recording` spoils what a recorded team measures, or what its model claims; filters and joint alone, without processes. `field` has
three robots of `examples.field.world`, whose wheels are worse than their model. `demo` draws each robot's models wrong.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.config import Scenario, load
from blackboard.judge.samples import Sample, held_by, rms_error
from blackboard.lab.team import InProcessTeam, played
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.run.flags import RecordingFlags
from blackboard.wire.gaussians import parts_of
from blackboard.wire.messages import Odometry, Readings, Sighting
from examples.field.world import Truth, World
from robot_agent.config import RobotSection
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import Sensors, sensors_of
from tests.field.play import Field, Score, new_scenario

Random = np.random.Generator
SETTLED = 60.0  # seconds of a recording after which errors count
#: Noise is made `TIMES` times as large as that of the sensors, whose sigmas are these: range (m, share), bearing; along, heading.
TIMES = 3.0
RANGE, BEARING, ALONG, HEADING = (0.03, 0.045), 0.011, 0.03, 0.045


@dataclass(frozen=True)
class Spoil:
    """What is done to odometry and sightings, to the model, and by how many seconds commands are taken to lead the motion."""

    odometry: Callable[[Odometry, Random], Odometry] = lambda odometry, random: odometry
    sighting: Callable[[Sighting, Random], Sighting] = lambda sighting, random: sighting
    sensors: Callable[[Sensors], Sensors] = lambda sensors: sensors
    lag: float = 0.22


def moving(odometry: Odometry) -> bool:
    return odometry.distance != 0.0 or odometry.turn != 0.0


def driven(way: float = 1.0, arc: float = 1.0, turn: float = 1.0, drift: float = 0.0) -> Spoil:
    """Odometry that reports so many times each way and turn, and `drift` rad/s more while the robot moves."""

    def spoilt(odometry: Odometry, random: Random) -> Odometry:
        curved, driven = parts_of(odometry)
        more = drift * odometry.dt if moving(odometry) else 0.0
        told = {"distance": way * odometry.distance, "turn": turn * (odometry.turn + (arc - 1) * driven) + more}
        return odometry.model_copy(update=told | {"curved": way * curved, "driven": turn * arc * driven})

    return Spoil(spoilt)


def slipping(along: float, heading: float = 0.0) -> Spoil:
    """Odometry with white noise of so many metres and radians per square root of a second of motion."""

    def spoilt(odometry: Odometry, random: Random) -> Odometry:
        step_noise, turn_noise = random.normal(size=2) * math.sqrt(odometry.dt) * moving(odometry)
        return odometry.model_copy(
            update={"distance": odometry.distance + along * step_noise, "turn": odometry.turn + heading * turn_noise}
        )

    return Spoil(spoilt)


def sightings_spoilt(scale: float = 1.0, askew: float = 0.0, noise: float = 0.0) -> Spoil:
    """Sightings that report so many times each range and `askew` rad more, with white noise of `noise` times the camera's."""

    def spoilt(sighting: Sighting, random: Random) -> Sighting:
        far, aside = noise * random.normal(size=2) * [RANGE[0] + RANGE[1] * sighting.range, BEARING]
        measured = max(0.0, scale * sighting.range + far), math.remainder(sighting.bearing + askew + aside, math.tau)
        return sighting.model_copy(update={"range": measured[0], "bearing": measured[1]})

    return Spoil(sighting=spoilt)


def claimed(wheels: float = 1.0, camera: float = 1.0) -> Spoil:
    """A model with so many times the noise."""

    def spoilt(sensors: Sensors) -> Sensors:
        by = ("along", "across", "heading", "turning", "starting")
        noise = {name: wheels * getattr(sensors.wheels, name) for name in by}
        camera_noise = {name: camera * getattr(sensors.camera, name) for name in ("floor", "share", "bearing")}
        return replace(sensors, wheels=replace(sensors.wheels, **noise), camera=replace(sensors.camera, **camera_noise))

    return Spoil(sensors=spoilt)


MORE = math.sqrt(TIMES**2 - 1)  # of noise that was there, to make it `TIMES` as large
SPOILS: Mapping[str, Spoil] = {
    "nothing": Spoil(),
    "wheels x3": slipping(MORE * ALONG, MORE * HEADING),
    "way noise x3": slipping(MORE * ALONG),
    "turn noise x3": slipping(0.0, MORE * HEADING),
    "wheels claimed x3": claimed(wheels=TIMES),
    "wheels claimed /3": claimed(wheels=1 / TIMES),
    "wheels x3, told": replace(slipping(MORE * ALONG, MORE * HEADING), sensors=claimed(wheels=TIMES).sensors),
    "camera x3": sightings_spoilt(noise=MORE),
    "camera x3, told": replace(sightings_spoilt(noise=MORE), sensors=claimed(camera=TIMES).sensors),
    "camera claimed x3": claimed(camera=TIMES),
    "camera claimed /3": claimed(camera=1 / TIMES),
    "lag 0": Spoil(lag=0.0),
    "lag .5": Spoil(lag=0.5),
    "way x.7": driven(way=0.7),
    "way x1.3": driven(way=1.3),
    "arcs x.6": driven(arc=0.6),
    "range x1.15": sightings_spoilt(scale=1.15),
    "bearing +.05": sightings_spoilt(askew=0.05),
}


def recorded(
    chosen: Scenario, spoil: Spoil, seed: int = 7, after: float = SETTLED, each: Callable[[TeamJoint], object] = bool
) -> Score:
    """Errors of all robots of a spoilt recording, in whole seconds from `after` on; `each` is given the joint of each tick."""
    chosen = chosen.changed("world", odometry_lag=spoil.lag)
    sensors, random = spoil.sensors(sensors_of(chosen.section("robot", RobotSection))), np.random.default_rng(seed)
    filters = {f"robot/{name}": FirstHand(f"robot/{name}", sensors) for name in chosen.team.robots}
    joint, score = TeamJoint(Objects(chosen.board.objects_drift, chosen.board.objects_drifts)), Score()
    for tick in played(chosen):
        evidence = []
        for readings in tick.readings:
            robot = f"robot/{readings.robot}"
            at = joint.pose(robot) if joint.knows(robot) else None
            evidence.append(filters[robot].step(_spoilt(readings, spoil, random), at))
        joint.settle(tick.number, tick.dt, evidence)
        each(joint)
        for robot in filters if tick.judged and tick.truth.time >= after else ():
            if joint.knows(robot) and robot in tick.truth.positions:
                marginal = joint.marginal(robot)
                score.add(marginal.mean, marginal.covariance, np.array(tick.truth.positions[robot]))
    return score


def _spoilt(readings: Readings, spoil: Spoil, random: Random) -> Readings:
    odometry = None if readings.odometry is None else spoil.odometry(readings.odometry, random)
    sightings = [spoil.sighting(sighting, random) for sighting in readings.sightings]
    return readings.model_copy(update={"odometry": odometry, "sightings": sightings})


#: Worlds of a field, over the one that its robots take theirs for: how many times as noisy their wheels are.
WHEELS = {"wheels as told": 1.0, "wheels x3": 3.0, "wheels /3": 1 / 3}


def fields(seeds: Iterable[int], seconds: float) -> Iterable[tuple[str, Score, float]]:
    """Robots and ball of fields: how far off, and the RMSE over that of a filter with all readings and the true model."""
    for name, by in WHEELS.items():
        for source in ("by nobody", "in the scenario"):
            totals = {(who, group): Score() for who in ("team", "central") for group in ("robots", "ball")}
            for seed in seeds:
                usual = Truth()
                truth = replace(usual, along=by * usual.along, turn=by * usual.turn)
                chosen = new_scenario(usual, told=source != "by nobody")
                team = Field(World(seed, truth), chosen, False, {"r2": 0.03, "r3": 0.06})
                for who, scores in team.play(seconds).items():
                    for subject, score in scores.items():
                        group = "ball" if subject == "ball" else "robots"
                        if (who, group) in totals and subject != "velocity":
                            totals[who, group].take(score)
            for group in ("robots", "ball"):
                total = totals["team", group]
                yield f"{name}, told {source}: {group}", total, total.rmse / totals["central", group].rmse


def demos(seeds: Iterable[int], seconds: float) -> "Iterable[tuple[str, Judged, float]]":
    """Teams of `blackboard demo` with right models, and with each robot's models wrong by factors from 1/3 to 3."""
    right: dict[str, Judged] = {}
    for name in ("right", "wrong"):
        judged = {"robots": Judged(), "objects": Judged()}
        for seed in seeds:
            chosen = load("demo").changed("world", seed=seed).changed("time", seconds=seconds)
            if name == "wrong":
                chosen = _wrong(chosen, np.random.default_rng(seed))
            samples: list[Sample] = []
            InProcessTeam(chosen, record=samples.append).run()
            for sample in samples:
                if (
                    sample.level == "agreed"
                    and sample.time >= seconds / 6
                    and sample.sub_team == chosen.team.of(sample.robot)[0]
                ):
                    group = "robots" if sample.subject == f"robot/{sample.robot}" else "objects"
                    if group == "objects" or sample.subject.startswith("robot/"):
                        judged[group].samples.append(sample)
        for group, score in judged.items():
            right.setdefault(group, score)
            yield f"{name} models: {group}", score, score.rmse / right[group].rmse


@dataclass
class Judged:
    """Beliefs on a grid, by their own regions: the ellipse of their moments is wider, for the share of an outlier."""

    samples: list[Sample] = field(default_factory=list)

    @property
    def rmse(self) -> float:
        return rms_error(self.samples)

    @property
    def log_score(self) -> float:
        return float(np.mean([sample.log_score for sample in self.samples]))

    def coverage(self, level: float = 0.95) -> float:
        return float(held_by(self.samples, round(100 * level)).mean())


def _wrong(chosen: Scenario, random: Random) -> Scenario:
    """Each robot's sigmas of odometry and vision times a factor of their own, log-uniform from 1/3 to 3."""
    robot = chosen.section("robot", RobotSection)
    tables = {}
    for name in chosen.team.robots:
        wheels, camera = 3.0 ** random.uniform(-1, 1, size=2)
        odometry = {key: float(wheels * getattr(robot.odometry, key)) for key in ("along", "turning")}
        tables[name] = {"odometry": odometry, "vision": {"gain": float(camera * robot.vision.gain)}}
    return chosen.changed("robots", **tables)


def shown(name: str, score: Score | Judged, ratio: float) -> str:
    """A row: RMSE, by how many times that is more than without the spoil, coverage of the 50 and 95 % regions, mean log score."""
    return f"{name:40} {score.rmse:7.3f} {ratio:6.2f} {score.coverage(0.5):6.2f} {score.coverage():6.3f} {score.log_score:8.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("team", choices=("recording", "field", "demo"))
    parser.add_argument("--mrclam")
    parser.add_argument("--start", type=float, default=1248446200.0)
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--after", type=float, default=SETTLED)
    parser.add_argument("--protocols", nargs="+", default=["A_all", "D_one3"])
    parser.add_argument("--spoils", nargs="+", default=list(SPOILS), choices=list(SPOILS))
    parser.add_argument(
        "--draws", nargs=2, type=int, default=(7, 8), metavar=("FIRST", "END"), help="of a recording's noise"
    )
    parser.add_argument(
        "--seeds", nargs=2, type=int, default=(1, 4), metavar=("FIRST", "END"), help="of field and demo"
    )
    args = parser.parse_args()
    print(f"{args.team:40} {'RMSE':>7} {'ratio':>6} {'50 %':>6} {'95 %':>6} {'nats':>8}", flush=True)
    if args.team == "recording":
        for protocol in args.protocols:
            usual = math.nan
            chosen = RecordingFlags(args.mrclam, args.start, protocol).scenario()
            for name in args.spoils:
                score = Score()
                for draw in range(*args.draws):
                    timed = chosen.changed("time", seconds=args.seconds or 300.0)
                    score.take(recorded(timed, SPOILS[name], draw, args.after))
                usual = score.rmse if math.isnan(usual) else usual
                print(shown(f"{protocol}, {name}", score, score.rmse / usual), flush=True)
        return
    rows, usually = (fields, 90.0) if args.team == "field" else (demos, 60.0)
    for row in rows(range(*args.seeds), args.seconds or usually):
        print(shown(*row), flush=True)


if __name__ == "__main__":
    main()
