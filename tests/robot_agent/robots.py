"""What tests of a robot are made of: its readings, what its team agreed on, and its reports by subject."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Fix, Odometry, Readings, Report, Sighting
from robot_agent.agent import TeamBelief
from robot_agent.config import RobotSection
from robot_agent.position import PositionLocalizer
from robot_agent.sensing import TickMotion
from tests.wire.envelopes import consensus

GRID = Grid((30, 30))
BALL = Sighting(subject="object/ball", range=5.0, bearing=0.3)

#: A grid whose cell is not 1 and whose origin is not 0, and a camera whose noise is easily written down.
FINE = Grid((24, 18), 0.5, (-3.0, 2.0), "m")
CAMERA: Mapping[str, object] = {
    "kind": "range-bearing",
    "outlier": 0.0,
    "frames": 2.0,
    "range_floor": 0.3,
    "range_share": 0.1,
    "bearing": 0.2,
}
STILL = TickMotion(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def position_localizer(
    belief: Belief, *, heading: float = 0.0, vision: Mapping[str, object] = CAMERA, **more: object
) -> PositionLocalizer:
    """A position grid that holds a belief."""
    begun = PositionLocalizer.unknown(RobotSection.model_validate({"vision": vision}), belief.grid)
    return replace(begun, p=belief.p, heading=heading, **more)  # type: ignore[arg-type]


def readings(
    tick: int,
    *sightings: Sighting,
    fix: Fix | tuple[float, float] | None = None,
    distance: float | None = 0.5,
    dt: float = 0.5,
    compass: float = 0.0,
) -> Readings:
    """Those of r1 that looks along x and has driven since the tick before; a `fix` that is a place has a sigma of 1."""
    moved = bool(tick) and distance is not None
    return Readings(
        run="x",
        robot="r1",
        tick=tick,
        time=0.5 * tick,
        odometry=Odometry(distance=distance, turn=0.0, dt=dt) if moved else None,
        compass=compass,
        fix=Fix(position=fix, sigma=1.0) if isinstance(fix, tuple) else fix,
        sightings=list(sightings),
    )


def measured(tick: int, **what: object) -> Readings:
    """What r1 measures in a tick of a second, or at the `time` that is given."""
    return Readings.model_validate({"run": "x", "robot": "r1", "tick": tick, "time": float(tick), **what})


def agreed(
    tick: int, belief: Belief, subject: str = "robot/r1", ancestors: Iterable[str] = ("r1", "r2")
) -> dict[str, TeamBelief]:
    """What a team agreed on about a subject in a tick."""
    time = 0.5 * tick
    said = consensus(belief, subject, tick=tick, time=time, ancestors=dict.fromkeys(ancestors, time))
    return {subject: TeamBelief.unpacked(said, belief.grid)}


def by_subject(reports: Iterable[Report]) -> dict[str, Report]:
    return {report.subject: report for report in reports}


Pose = tuple[float, float, float]


def sight_of(pose: Pose, name: str, place: tuple[float, float], landmark: bool = True, age: float = 0.0) -> Sighting:
    """What a robot at a pose measures of a place."""
    dx, dy = place[0] - pose[0], place[1] - pose[1]
    bearing = math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
    known = place if landmark else None
    return Sighting(subject=name, range=math.hypot(dx, dy), bearing=bearing, landmark=known, age=age)


def standing(tick: int, pose: Pose, landmarks: Mapping[str, tuple[float, float]], **what: object) -> Readings:
    """What r1 measures in a second in which it stands at a pose and sees these landmarks."""
    sightings = [sight_of(pose, name, place) for name, place in landmarks.items()]
    return measured(tick, odometry=Odometry(distance=0.0, turn=0.0, dt=1.0), sightings=sightings, **what)
