"""The [robot] tables of a scenario: how a robot believes that it moves and sees. The defaults fit the paper's world.

Positions and ranges are in the grid's unit, angles in radians, times in seconds. The world's physics has keys of its own
in [world], so that a robot with a wrong model can be tested. How far team-mates' beliefs are taken back is
`[board] feedback`, one setting for robots and boards.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from blackboard.config import Positive, Section

Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, lt=1)]


class VisionSection(Section):
    """What a sighting (range and bearing) says, by the robot's own model.

    "position": the seen position has an isotropic error of gain * sigma(d), (VI-.1) at the distance d, at least `floor`;
    gain 1 is the paper's sensor, about 0.05 a camera's.
    "range-bearing": sigma_r = hypot(range_floor, range_share * r) and sigma_b = `bearing`, both for one frame; frames that
    follow each other share their error, as if only one in `frames` were new.
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
    mates: bool = True  # a mate with an agreed position serves as an uncertain landmark


class OdometrySection(Section):
    """How the wheels' word relates to the motion: true = scale * told, `lag` seconds later, then a random walk.

    Sigmas are per square root of a second in motion; a robot that stands has `standing` of them.
    """

    distance_scale: Positive = 1.0
    turn_scale: Positive = 1.0
    lag: Sigma = 0.0  # seconds by which the odometry runs ahead of the motion
    along: Sigma = 0.2  # unit / sqrt(s)
    across: Sigma = 0.05  # unit / sqrt(s)
    turn: Sigma = 0.02  # radians / sqrt(s)
    standing: Annotated[float, Field(ge=0, le=1)] = 0.3


class ObjectsSection(Section):
    """The motion model of what is neither robot nor landmark: a random walk."""

    drift: Sigma = 0.5  # unit / sqrt(s)
    fresh: Annotated[float, Field(ge=0, le=1)] = 0.04  # of a sighting that is new to a sharper tracked belief
    forget: Annotated[float, Field(gt=0, le=1)] = 0.97  # dropped once its entropy exceeds this share of ln m


class RobotSection(Section):
    """[robot] with its tables [robot.vision], [robot.odometry], [robot.objects]."""

    localizer: Literal["position", "pose"] = "position"
    headings: Annotated[int, Field(ge=8, le=720)] = 90  # bins of the pose grid
    patience: Positive = 2.0  # wall seconds to wait for the agreed beliefs of the tick before
    vision: VisionSection = Field(default_factory=VisionSection)
    odometry: OdometrySection = Field(default_factory=OdometrySection)
    objects: ObjectsSection = Field(default_factory=ObjectsSection)
