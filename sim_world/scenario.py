"""The [world] tables of a scenario: what is true, how the sensors measure, and what the referee asks for a PASS.

Positions, distances and sigmas are in the grid's unit (cells in the paper's world), angles in radians, seconds;
the robots' own models have keys of their own in [robot], on purpose: a robot with a wrong model can be tested.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from blackboard.config import Name, Positive, Section
from sim_world.mrclam.protocols import FAMILIES, PROTOCOLS, protocol_of

Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Coordinate = Annotated[float, Field(allow_inf_nan=False)]

#: The gain of (VI-.1): 1 is the paper's sensor (sigma up to 37 cells), 0.05 a camera (up to 1.9 cells).
GAINS = {"paper": 1.0, "camera": 0.05}


class VisionSection(Section):
    """The physics of the cameras: (VI-.1) times a gain, seen ahead only."""

    preset: Literal["paper", "camera"] = "camera"
    gain: Positive | None = None  # None: the preset's
    floor: Positive = 0.5  # the printed sigma is 0 at d = 7.5
    half_angle: Annotated[float, Field(gt=0, le=3.1416)] = 1.5708  # "ahead": 90 degrees to each side of the heading

    @property
    def scale(self) -> float:
        return GAINS[self.preset] if self.gain is None else self.gain


class OdometrySection(Section):
    """The physics of odometry and compass, and of the position fixes that bound the odometry's error."""

    along: Sigma = 0.3  # error of the distance, per square root of the distance
    turn: Sigma = 0.01  # error of the turn, radians per square root of a radian
    compass: Sigma = 0.01  # error of the compass, radians
    reset_after: Positive = 5.0  # a Fix arrives each time this distance is exceeded (the paper: 5 cells)
    fix: Positive = 0.7  # error of a Fix in each coordinate


class ObjectSection(Section):
    """An object does a random walk, reflected at the walls: the motion that a robot's model can match exactly."""

    start: tuple[Coordinate, Coordinate] | None = None  # None: drawn from the seed
    drift: Sigma = 0.0  # per square root of a second, in each coordinate; 0 is an object that stands


class CheckSection(Section):
    """What a run must show to PASS, of robots and objects alike unless it says otherwise."""

    robots: Positive = 0.9  # agreed RMSE of the robots' positions, at most this share of solo
    objects: Positive = 0.9  # the same of the objects
    entropy: Positive = 1.0  # agreed entropy, at most this share of solo
    coverage: Annotated[float, Field(ge=0, le=1)] = 0.8  # of the agreed 95 % regions, at least
    #: how far the share of agreed regions that hold the truth may be, beyond doubt, from 50, 90 and 95 %, to both sides
    calibration: Annotated[float, Field(ge=0, le=1)] = 0.2
    missing: Annotated[float, Field(ge=0, le=1)] = 0.2  # share of the samples of a robot or object that may be missing
    claim: Positive = 2.0  # solo RMSE of the robots, and of each one, at most so many times what its beliefs claim
    solo: Positive | None = None  # solo RMSE of the robots, at most (unit); None: anything


class WorldSection(Section):
    """[world], with [world.vision], [world.odometry], [world.objects.*] and [world.check]."""

    kind: Literal["simulated", "mrclam"] = "simulated"
    seed: Annotated[int, Field(ge=0, lt=1 << 63)] = 1

    # simulated
    speed: Positive = 1.0  # of the robots
    turn_rate: Positive = 1.0  # at most, radians per second
    lost: list[Name] = Field(default_factory=list)  # robots that get no fix at the start
    objects: dict[Name, ObjectSection] = Field(
        default_factory=lambda: {"ball": ObjectSection(drift=0.2), "can": ObjectSection()}
    )
    vision: VisionSection = Field(default_factory=VisionSection)
    odometry: OdometrySection = Field(default_factory=OdometrySection)

    # mrclam
    dir: str | None = None
    start: Coordinate | None = None  # Unix time; None: the first whole second that all files cover
    protocol: str = "A_all"
    odometry_lag: Sigma = 0.22  # seconds by which the commands lead the motion (measured: 0.2 to 0.25)
    sighting_latency: Sigma = 0.04  # seconds by which sightings are stamped late (measured: 0.03 to 0.05)

    check: CheckSection = Field(default_factory=CheckSection)

    linger: Positive = 1.0  # wall seconds that a tick may still be answered in real time
    # wall seconds that the world waits in lockstep
    gather: Positive = 60.0  # for everybody to come, at the start or after everybody went
    patience: Positive = (
        0.5  # until a tick is sent again: before boards and robots lose theirs, so that one lost message costs no bit
    )
    give_up: Positive = 20.0  # until a process that is alive but sends nothing is no longer waited for
    grace: Positive = 0.5  # until a token that vanished means a death, and not that the router went
    comeback: Positive = 5.0  # for the others to return when the router is back

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
