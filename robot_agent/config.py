"""The [robot] tables of a scenario: the robot's models of its motion and its sensors. The defaults fit the paper's world.

Positions and ranges are in the grid's unit, angles in radians, times in seconds. The world's physics has keys of its own
in [world], so that a robot with a wrong model can be tested. How far team-mates' beliefs are taken back is
`[board] feedback`, one setting for robots and boards.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from blackboard.config import Positive, Section
from robot_agent.localizers import known_localizers

Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, lt=1)]


class VisionSection(Section):
    """The robot's model of the noise of a sighting (range and bearing).

    "position": the seen position has isotropic Gaussian noise of max(floor, gain * sigma(d)), sigma(d) by (VI-.1) at the
    distance d; gain 1 is the paper's sensor, about 0.05 a camera's.
    "range-bearing": the range has sigma hypot(range_floor, range_share * r), the bearing has sigma `bearing`, both for one
    frame. Frames that follow each other share their error, so both variances are multiplied by `frames`. The localizer
    "pose" has this model only.
    """

    kind: Literal["position", "range-bearing"] = "position"
    gain: Positive = 0.05
    floor: Positive = 0.5  # unit; the printed sigma is 0 at d = 7.5
    range_floor: Sigma = 0.03  # unit
    range_share: Sigma = 0.07  # of the range
    bearing: Positive = 0.015  # radians
    frames: Annotated[float, Field(ge=1)] = 5.0
    misread: Positive = 7.0  # nats: no reading lowers a pose's likelihood by more, so a misread barcode does no harm
    outlier: Share = 0.01  # uniform share of a belief that comes from a sighting
    mates: bool = True  # a team-mate with an agreed position serves as an uncertain landmark


class OdometrySection(Section):
    """The robot's model of its odometry: true motion = scale * measured motion + Gaussian noise.

    Sigmas are per square root of a second in motion; a robot that stands has the share `standing` of them.
    """

    distance_scale: Positive = 1.0
    turn_scale: Positive = 1.0
    along: Sigma = 0.2  # unit / sqrt(s)
    across: Sigma = 0.05  # unit / sqrt(s)
    turn: Sigma = 0.02  # radians / sqrt(s)
    standing: Annotated[float, Field(ge=0, le=1)] = 0.3


class ObjectsSection(Section):
    """How a robot tracks what is neither robot nor landmark. The motion model is a random walk."""

    drift: Sigma = 0.5  # unit / sqrt(s)
    fresh: Annotated[float, Field(ge=0, le=1)] = 0.04  # share of a sighting that is new to a sharper tracked belief
    #: A belief is dropped once its entropy exceeds this share of ln m, the entropy of a uniform one.
    forget: Annotated[float, Field(gt=0, le=1)] = 0.97


class RobotSection(Section):
    """[robot] with its tables [robot.vision], [robot.odometry], [robot.objects]."""

    localizer: str = "position"  # see `robot_agent.localizers`
    headings: Annotated[int, Field(ge=8, le=720)] = 90  # heading bins of the localizer "pose"
    patience: Positive = 2.0  # wall seconds to wait for the agreed beliefs of the tick before
    vision: VisionSection = Field(default_factory=VisionSection)
    odometry: OdometrySection = Field(default_factory=OdometrySection)
    objects: ObjectsSection = Field(default_factory=ObjectsSection)

    @field_validator("localizer")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in known_localizers():
            raise ValueError(f"no localizer of this name; known are {', '.join(known_localizers())}")
        return name
