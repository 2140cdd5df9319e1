"""The [world] tables of a scenario: what is true, how the sensors measure, and what the referee asks for a PASS.

Positions, distances and sigmas are in the grid's unit (cells in the paper's world), angles in radians, times in seconds. The
robots' models have keys of their own in [robot], so that a robot with a wrong model can be tested.
"""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from blackboard.config import Name, Positive, Scenario, Section
from blackboard.config.mrclam import recording_folder
from blackboard.config.protocols import FAMILIES, PROTOCOLS, protocol_of
from blackboard.errors import UserError
from blackboard.wire.mistakes import nearest
from blackboard.wire.types import Finite

Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]

#: The gain of (VI-.1): 1 is the paper's sensor (sigma up to 37 cells), 0.05 a camera (up to 1.9 cells).
GAINS = {"paper": 1.0, "camera": 0.05}


class WorldVisionSection(Section):
    """The physics of the cameras: (VI-.1) times a gain, seen ahead only."""

    preset: Literal["paper", "camera"] = "camera"
    "A gain by name: 1 is the paper's sensor (sigma up to 37 cells), 0.05 a camera (up to 1.9 cells)."
    gain: Positive | None = None
    "[factor] Gain of (VI-.1), instead of the preset's: at distance d of 8 abs(d - 7.5), below 3 and above 11 of 20 ln abs(d - 7.5)."
    floor: Positive = 0.5
    "[unit] Least sigma of a seen position; the printed sigma is 0 at a distance of 7.5."
    half_angle: Annotated[float, Field(gt=0, le=3.1416)] = 1.5708
    "[rad] What is seen ahead: so far to each side of the heading."

    @property
    def scale(self) -> float:
        return GAINS[self.preset] if self.gain is None else self.gain


class WorldOdometrySection(Section):
    """The physics of odometry and compass, and of the position fixes that bound the odometry's error."""

    along: Sigma = 0.3
    "[sqrt(unit)] Error of the distance, per square root of the distance."
    turn: Sigma = 0.01
    "[sqrt(rad)] Error of the turn, per square root of the turn."
    compass: Sigma = 0.01
    "[rad] Error of the compass."
    reset_after: Positive = 5.0
    "[unit] A fix of the position comes each time this distance is exceeded (the paper: 5 cells)."
    fix: Positive = 0.7
    "[unit] Error of a fix in each coordinate."


class ObjectSection(Section):
    """An object does a random walk, or rolls, or both, and the walls reflect it."""

    start: tuple[Finite, Finite] | None = None
    "[unit] Where it is at the beginning; drawn from the seed where it is not given."
    drift: Sigma = 0.0
    "[unit/sqrt(s)] How it moves in each coordinate; 0 is an object that stands."
    rolls: Sigma = 0.0
    "[unit/s] How fast it rolls, in a direction drawn from the seed; the walls throw it back."


class PeopleSection(Section):
    """People, or whatever else walks about as robots do and is in no team: `person/p1`, `person/p2`, ..."""

    count: Annotated[int, Field(ge=0, le=64)] = 0
    "How many there are."
    speed: Positive = 1.0
    "[unit/s] How fast they walk, from one random place to the next; they turn as fast as robots."


class DetectorSection(Section):
    """What a detector makes of what the sensors see. Each robot's is independent of the others'."""

    anonymous: tuple[Literal["robot", "object", "person", "landmark"], ...] = ("person",)
    "Kinds of which only the class is told: `robot/?` instead of `robot/r2`, `object/ball?` instead of `object/ball1`."
    missed: Annotated[float, Field(ge=0, lt=1)] = 0.0
    "[share] Of the sightings, but for those of landmarks, so many are lost."
    exchanged: Annotated[float, Field(ge=0, le=1)] = 0.0
    "[share] In so many of the ticks in which a robot sees several mates by name, two of them have each other's."
    clutter: Annotated[float, Field(ge=0, le=16)] = 0.0
    "[sightings] Of nothing, by each robot in each tick in the mean; anywhere in the camera's field, of any unnamed class (simulated)."
    body: Sigma = 0.0
    "[unit] Radius of robots and people, who hide what is behind them; 0 hides nothing (simulated)."


class CheckSection(Section):
    """What a run must show to PASS, of robots and objects alike unless it says otherwise."""

    robots: Positive = 0.9
    "[factor] Agreed RMSE of the robots' positions, at most so much of solo."
    objects: Positive = 0.9
    "[factor] Agreed RMSE of the objects, at most so much of solo."
    entropy: Positive = 1.0
    "[factor] Agreed entropy, at most so much of solo."
    coverage: Annotated[float, Field(ge=0, le=1)] = 0.8
    "[share] Share of the agreed 95 % regions that hold the truth, at least."
    calibration: Annotated[float, Field(ge=0, le=1)] = 0.2
    "[share] How far the coverage of agreed regions may be, beyond doubt, from 50, 90 and 95 %, to both sides."
    missing: Annotated[float, Field(ge=0, le=1)] = 0.2
    "[share] Share of the samples of a robot or object that may be missing."
    claim: Positive = 2.0
    "[factor] Solo RMSE of the robots, and of each one, at most so many times what its beliefs claim."
    solo: Positive | None = None
    "[unit] Solo RMSE of the robots, at most; anything where it is not given."
    track: Positive = 3.0
    "[unit] A track farther than this from a thing is not of it: the cut-off of GOSPA."


class WorldSection(Section):
    """What is true, how the sensors measure, what is asked for a PASS, and for how long the world waits."""

    kind: Literal["simulated", "mrclam", "pyfg"] = "simulated"
    "A simulated team, or a recorded one (UTIAS MRCLAM, or a factor graph in PyFG format)."
    seed: Annotated[int, Field(ge=0, lt=1 << 63)] = 1
    "Seed of all random numbers of the world."

    # simulated
    speed: Positive = 1.0
    "[unit/s] Speed of the robots (simulated)."
    turn_rate: Positive = 1.0
    "[rad/s] How fast they turn, at most (simulated)."
    lost: list[Name] = Field(default_factory=list)
    "Robots that get no fix at the start (simulated)."
    objects: dict[Name, ObjectSection] = Field(
        default_factory=lambda: {"ball": ObjectSection(drift=0.2), "can": ObjectSection()}
    )
    "What the team looks for, by name (simulated)."
    vision: WorldVisionSection = Field(default_factory=WorldVisionSection)
    "The physics of the cameras (simulated)."
    odometry: WorldOdometrySection = Field(default_factory=WorldOdometrySection)
    "The physics of odometry, compass and fixes (simulated)."
    people: PeopleSection = Field(default_factory=PeopleSection)
    "Who walks about and is in no team (simulated)."
    detector: DetectorSection = Field(default_factory=DetectorSection)
    "What readings contain of what the sensors see."

    # mrclam
    dir: str | None = None
    "Folder of the recording (mrclam), or its file (pyfg)."
    start: Finite | None = None
    "[s] Where the replay begins, Unix time; the first whole second that all files cover where it is not given (mrclam, pyfg)."
    protocol: str = "A_all"
    "Which landmark sightings may be used (mrclam; docs/real-robots.md)."
    odometry_lag: Sigma = 0.22
    "[s] By how much commands lead the motion (mrclam; measured: 0.2 to 0.25)."
    sighting_latency: Sigma = 0.04
    "[s] By how much sightings are stamped late (mrclam; measured: 0.03 to 0.05)."

    # pyfg
    start_sigma: Positive = 0.5
    "[unit] How well a robot is told where it starts; the error is drawn from the seed (pyfg)."
    start_heading: Positive = 0.1
    "[rad] How well it is told its heading then (pyfg)."

    check: CheckSection = Field(default_factory=CheckSection)
    "What a run must show to PASS."

    linger: Positive = 1.0
    "[s] How long a tick may still be answered in real time, wall time."
    gather: Positive = 60.0
    "[s] How long the world waits in lockstep for everybody to come, at the start or after everybody went, wall time."
    patience: Positive = 0.5
    "[s] Wall time until a tick is sent again: before boards and robots lose theirs, so that one lost message costs no bit."
    give_up: Positive = 20.0
    "[s] Wall time until a process that is alive and sends nothing is no longer waited for."
    grace: Positive = 0.5
    "[s] Wall time until a token that vanished means a death, and not that the router went."
    comeback: Positive = 5.0
    "[s] Wall time for the others to return when the router is back."

    @field_validator("protocol")
    @classmethod
    def _known(cls, protocol: str) -> str:
        if protocol in FAMILIES:
            raise ValueError(
                f"{protocol} is a family, a run for each object; use one of {', '.join(FAMILIES[protocol])}"
            )
        if protocol_of(protocol) is None:
            families = ", ".join(f"{next(iter(family))}, ..." for family in FAMILIES.values())
            raise ValueError(f"no protocol of this name; use one of {', '.join(PROTOCOLS)}, {families}")
        return protocol


def check_world(scenario: Scenario) -> list[str]:
    """A sentence for each thing in the [world] tables of a scenario that looks like a mistake. UserError: one that is a mistake."""
    world = scenario.section("world", WorldSection)
    if world.kind != "simulated":
        if world.kind == "mrclam":
            recording_folder(world.dir)
        for key in ("clutter", "body"):
            if getattr(world.detector, key):
                raise UserError(f"{scenario.where}: world.detector.{key}: a recording has its own; leave the key out")
        return []
    for robot in world.lost:
        if robot not in scenario.team.robots:
            known = ", ".join(scenario.team.robots)
            cure = nearest(robot, scenario.team.robots)
            raise UserError(
                f"{scenario.where}: world.lost: {robot}: no sub-team has such a robot{cure}; known are {known}"
            )
    if world.detector.clutter and not world.detector.anonymous:
        raise UserError(
            f"{scenario.where}: world.detector.clutter: what is nothing has no name; give a kind in world.detector.anonymous"
        )
    return _unknown_objects(scenario, world)


def _unknown_objects(scenario: Scenario, world: WorldSection) -> list[str]:
    """A sentence for each object that the [board] names and the simulated world does not have.

    It may be misspelt, or be something that a robot reports which is not of this world.
    """
    patterns = (pattern.split("/") for pattern in scenario.board.subjects)
    named = [(f"board.objects_drifts.{name}", name) for name in scenario.board.objects_drifts]
    named += [(f"board.objects_motions.{name}", name) for name in scenario.board.objects_motions]
    named += [(f"board.subjects.object/{name}", name) for kind, name in patterns if kind == "object" and name != "*"]
    known = sorted(world.objects)
    has = f"it has {', '.join(known)}" if known else "it has none"
    return [
        f"{scenario.where}: {key}: the world has no such object{nearest(name, known)}; {has}"
        for key, name in sorted(named)
        if name not in known
    ]
