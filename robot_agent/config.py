"""The [robot] tables of a scenario: the robot's models of its motion and its sensors. The defaults fit the paper's world.

Positions and ranges are in the grid's unit, angles in radians, times in seconds. The world's physics has keys of its own
in [world], so that a robot with a wrong model can be tested. How far team-mates' beliefs are taken back is
`[board] feedback`, one setting for robots and boards.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from blackboard.config import Name, Positive, Scenario, Section
from blackboard.errors import UserError
from blackboard.process.peer import WHOLE
from blackboard.wire.mistakes import nearest
from blackboard.wire.types import Finite
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
    'The model of the noise of a sighting: of the seen position, or of range and bearing. The localizer "pose" has the latter only.'
    gain: Positive = 0.05
    """[factor] "position": gain of (VI-.1); 1 is the paper's sensor, about 0.05 a camera's."""
    floor: Positive = 0.5
    '[unit] "position": least sigma; the printed one is 0 at a distance of 7.5.'
    range_floor: Sigma = 0.03
    '[unit] "range-bearing": least sigma of the range.'
    range_share: Sigma = 0.07
    '[share] "range-bearing": sigma of the range as a share of it.'
    bearing: Positive = 0.015
    '[rad] "range-bearing": sigma of the bearing.'
    range_scale: Positive = 1.0
    '[factor] "range-bearing": true range over the measured one, without its bias; in a joint.'
    range_bias: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    '[unit] "range-bearing": what a range reads too much; in a joint.'
    bearing_bias: Annotated[float, Field(ge=-4, le=4)] = 0.0
    '[rad] "range-bearing": what a bearing reads too much; in a joint.'
    frames: Annotated[float, Field(ge=1)] = 5.0
    "[factor] Frames that follow each other share their error: both variances are multiplied by this."
    misread: Positive = 7.0
    "[nats] No reading lowers a pose's likelihood by more, so a misread barcode does no harm."
    outlier: Share = 0.01
    "[share] Uniform share of a belief that comes from a sighting."
    mates: bool = True
    "Whether a team-mate with an agreed position serves as an uncertain landmark."


class OdometrySection(Section):
    """The robot's model of its odometry: true motion = scale * measured motion + Gaussian noise.

    Sigmas are per square root of a second in motion; a robot that stands has the share `standing` of them.
    """

    distance_scale: Positive = 1.0
    "[factor] True distance over the measured one."
    turn_scale: Positive = 1.0
    "[factor] True turn over the measured one."
    along: Sigma = 0.3
    "[unit/sqrt(s)] Sigma of the motion along the way, in motion."
    across: Sigma = 0.05
    "[unit/sqrt(s)] Sigma of the motion across the way, in motion."
    turn: Sigma = 0.02
    "[rad/sqrt(s)] Sigma of the turn, in motion."
    turning: Sigma = 0.0
    "[sqrt(rad)] Sigma of the turn per square root of what is turned, in a joint, beside that of the time."
    compass: Annotated[float, Field(gt=0, le=3.1416)] = 0.03
    "[rad] Sigma of a compass, in a joint, where a reading does not say it."
    standing: Annotated[float, Field(ge=0, le=1)] = 0.3
    "[share] Share of these sigmas that a robot that stands has."
    distance_lasting: Share = 0.0
    "[share] Sigma of the error of the distance's scale, which lasts; a robot in a joint estimates it."
    turn_lasting: Share = 0.0
    "[share] The same of the turn's scale."
    curve_distance_scale: Positive | None = None
    "[factor] True distance over the measured one on a curve, in a joint; none: as straight ahead."
    curve_turn_scale: Positive | None = None
    "[factor] True turn over the measured one while it drives, in a joint; none: as on the spot."
    lag: Annotated[float, Field(ge=-5, le=5)] = 0.0
    "[s] How much later than the odometry says it moves, in a joint."
    drift: Annotated[float, Field(ge=-1, le=1)] | None = None
    "[rad/s] How much more it turns than the odometry says while it moves, in a joint; none: not known."
    measured: bool = False
    "Whether these numbers are this robot's own (`blackboard calibrate`), so that in a joint it begins with them; else it begins wide."


class RangingSection(Section):
    """The robot's model of ranges that are measured without a bearing, as by UWB radios, in a joint."""

    bias: Sigma = 0.0
    "[unit] Sigma of an error that lasts, of each pair."
    seconds: Positive = 1000.0
    "[s] How long it lasts."
    scale: Share = 0.0
    "[share] Sigma of an error of all ranges of a robot as a share of them."


class ObjectsSection(Section):
    """How a robot tracks what is neither robot nor landmark. The motion model is a random walk."""

    drift: Sigma = 0.5
    "[unit/sqrt(s)] How an object moves: a random walk."
    fresh: Annotated[float, Field(ge=0, le=1)] = 0.04
    "[share] Share of a sighting that is new to a sharper tracked belief."
    forget: Annotated[float, Field(gt=0, le=1)] = 0.97
    "[share] A belief is dropped once its entropy exceeds this share of ln m, the entropy of a uniform one."


class SendSection(Section):
    """How much a robot says on a poor link (docs/network.md, "A poor link")."""

    budget: Annotated[float, Field(gt=0)] | None = None
    "[B/s] Bytes a second of team time for reports, keys included, over all its sub-teams; none: everything in every tick."
    rate: Annotated[float, Field(gt=0)] | None = None
    "[Hz] Messages a second of the whole team's robots, of which each has the same share; none: they are not counted."
    burst: Positive = 2.0
    "[s] How many seconds of the budget may be saved up."
    longest: Positive = 4.0
    "[s] About what it believes it says something at least so often, as far as the budget allows; less than `[board] max_age`."

    def pace(self, robots: int, sub_teams: int = 1) -> float:
        """Reports a second of one of so many robots in each of its sub-teams: its share of `rate`, less the statuses.

        UserError: fewer than `longest` asks for.
        """
        assert self.rate is not None
        pace = self.rate / robots / sub_teams - 1 / WHOLE
        least = 1 / self.longest
        if pace < least * (1 - 1e-6):
            raise UserError(
                f"robot.send.rate: {self.rate:g} messages a second of {robots} robots are less than one of each "
                f"in robot.send.longest, {self.longest:g} s; give at least {robots * sub_teams * (least + 1 / WHOLE):.3g}"
            )
        return pace


class RobotSection(Section):
    """What the robots believe about themselves and their sensors; the tables of [robots.NAME] are for one robot, in their place."""

    localizer: str = "position"
    'How it finds its place: "position", "pose", or one of a plug-in (docs/rules.md).'
    headings: Annotated[int, Field(ge=8, le=720)] = 90
    'Heading bins of the localizer "pose".'
    patience: Positive = 8.0
    "[s] How long it waits, in wall time, for the agreed beliefs of the tick before."
    vision: VisionSection = Field(default_factory=VisionSection)
    "Its model of the camera."
    odometry: OdometrySection = Field(default_factory=OdometrySection)
    "Its model of the odometry."
    ranging: RangingSection = Field(default_factory=RangingSection)
    "Its model of ranges alone."
    landmarks: dict[Name, tuple[Finite, Finite]] = Field(default_factory=dict, max_length=1000)
    "[unit] The map: where landmarks stand, by name, for sightings of `landmark/?`; in a joint."
    objects: ObjectsSection = Field(default_factory=ObjectsSection)
    "How it tracks what is neither robot nor landmark."
    coding: Literal["log8", "log16"] = "log8"
    "How it writes beliefs: log16 once every member and viewer of the team reads it (docs/bytes.md)."
    send: SendSection = Field(default_factory=SendSection)
    "What it says on a poor link."

    @field_validator("localizer")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in known_localizers():
            raise ValueError(f"no localizer of this name; known are {', '.join(known_localizers())}")
        return name


def settings_of(scenario: Scenario, robot: str) -> RobotSection:
    """What a robot of a scenario believes: [robot], and over it [robots.NAME]. UserError: a mistake in either."""
    if robot not in _own_tables(scenario):
        return scenario.section("robot", RobotSection)
    one = Scenario({}, scenario.where)
    one.tables[f"robots.{robot}"] = table_of(scenario, robot)
    return one.section(f"robots.{robot}", RobotSection)


def table_of(scenario: Scenario, robot: str) -> dict[str, Any]:
    """What a scenario says of a robot, without defaults: [robot], and over it [robots.NAME]. UserError: these are no tables."""
    return _over(scenario.tables.get("robot", {}), _own_tables(scenario).get(robot, {}))


def check_robots(scenario: Scenario) -> None:
    """UserError: a mistake in [robot] or in [robots], which is about robots of the team."""
    known = scenario.team.robots
    for name in _own_tables(scenario):
        if name not in known:
            cure = f"{nearest(name, known)}; use one of {', '.join(known)}"
            raise UserError(f"{scenario.where}: robots.{name}: no robot of the team has this name{cure}")
        settings_of(scenario, name)
    scenario.section("robot", RobotSection)
    for name in known:
        if (send := settings_of(scenario, name).send).rate is not None:
            try:
                send.pace(len(known), len(scenario.team.of(name)))
            except UserError as error:
                raise UserError(f"{scenario.where}: {error}") from None


def _own_tables(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Robot -> its table in [robots]. UserError: something in it is no table."""
    tables = scenario.tables.get("robots", {})
    if not isinstance(tables, dict):
        raise UserError(f"{scenario.where}: robots: give tables, as [robots.r1.odometry]")
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise UserError(f"{scenario.where}: robots.{name}: give tables, as [robots.{name}.odometry]")
    return tables


def _over(table: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """A table with values of another in place of its own, table by table."""
    tables = {key: value for key, value in own.items() if isinstance(value, dict) and isinstance(table.get(key), dict)}
    return {**table, **own, **{key: _over(table[key], value) for key, value in tables.items()}}
