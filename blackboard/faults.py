"""[[fault]]: what is wrong with some robots of a scenario, and when. The world and the robots concerned each read their part.

Faults of sensors (`is_of_sensors`) change what the world measures, the others what the robot says. All times are team time in seconds.
"""

import math
from typing import Annotated, Literal, Self, get_args

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from blackboard.config import Name, Scenario, Section, first_fault
from blackboard.errors import UserError
from blackboard.wire.mistakes import nearest

Finite = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Offset = tuple[Finite, Finite]


class _Fault(Section):
    """Whom it concerns (`robot`, or several `robots`), and from when until when."""

    robot: Name | None = None
    "The robot that it concerns; this or `robots`."
    robots: list[Name] = Field(default_factory=list, max_length=64)
    "Several robots that it concerns."
    start: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    "[s] From when on."
    end: Annotated[float, Field(gt=0)] = math.inf
    "[s] Until when."
    active: bool = True
    "false: nothing is wrong, and the robots are scored as `faulty` all the same, to compare with."

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        if (self.robot is None) == (not self.robots):
            raise ValueError("give either robot or robots")
        if self.end <= self.start:
            raise ValueError(f"it ends at {self.end:g} s, before its start at {self.start:g} s; give a later end")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The robots that it concerns, each once."""
        return tuple(dict.fromkeys(self.robots or [self.robot or ""]))

    def concerns(self, robot: str, time: float) -> bool:
        """Whether something is wrong with a robot at a team time: from `start` on, and no longer at `end`."""
        return self.active and robot in self.names and self.start <= time < self.end


class LieFault(_Fault):
    """Every place that it tells is off by `offset` (unit): of itself, of what it sees, in beliefs and in evidence."""

    kind: Literal["lie"]
    "Every place that it tells is off."
    offset: Offset
    "[unit] By how much, along x and y."


class Collude(_Fault):
    """Several robots tell the same lie."""

    kind: Literal["collude"]
    "Several robots tell the same lie."
    offset: Offset
    "[unit] By how much, along x and y."

    @model_validator(mode="after")
    def _are_several(self) -> Self:
        if len(self.names) < 2:
            raise ValueError("give at least two robots; one alone has the fault lie")
        return self


class Overconfident(_Fault):
    """The sigmas that it claims are smaller by `factor`."""

    kind: Literal["overconfident"]
    "The sigmas that it claims are too small."
    factor: Annotated[float, Field(gt=1, le=100)]
    "[factor] How many times too small."


class Skew(_Fault):
    """Its stamps are `seconds` ahead of team time; behind, where negative."""

    kind: Literal["skew"]
    "Its stamps are off."
    seconds: Annotated[float, Field(ge=-1e4, le=1e4, allow_inf_nan=False)]
    "[s] How far ahead of team time; behind, where negative."


class Lose(_Fault):
    """A share of its reports never arrives."""

    kind: Literal["lose"]
    "Reports are lost."
    share: Annotated[float, Field(gt=0, le=1)]
    "[share] Share of its reports that never arrives."


class Drift(_Fault):
    """A sensor creeps: its error grows by `rate` per second.

    odometry: the distance, as a share of itself; compass: radians; range: of sightings, unit; fix: unit, along x.
    """

    kind: Literal["drift"]
    "A sensor creeps: its error grows."
    sensor: Literal["odometry", "compass", "range", "fix"] = "odometry"
    "Which: the distance of the odometry, the compass, the range of sightings, or fixes along x."
    rate: Annotated[float, Field(ge=-1e3, le=1e3, allow_inf_nan=False)]
    "[per s] By how much a second: odometry as a share of the distance, compass in rad, range and fix in the grid's unit."


class Freeze(_Fault):
    """`sensors` repeat what they measured last, or the `process` says nothing, and holds its liveliness token."""

    kind: Literal["freeze"]
    "Something stops."
    what: Literal["sensors", "process"] = "sensors"
    "The sensors repeat what they measured last, or the process says nothing and holds its liveliness token."


Fault = Annotated[LieFault | Collude | Overconfident | Skew | Lose | Drift | Freeze, Field(discriminator="kind")]
AnyFault = LieFault | Collude | Overconfident | Skew | Lose | Drift | Freeze
KINDS = ("lie", "collude", "overconfident", "skew", "lose", "drift", "freeze")
_FAULTS: TypeAdapter[list[AnyFault]] = TypeAdapter(list[Fault])


def is_of_sensors(fault: AnyFault) -> bool:
    """Whether a fault changes what the world measures, and not what the robot says."""
    return isinstance(fault, Drift) or (isinstance(fault, Freeze) and fault.what == "sensors")


def faults_of(scenario: Scenario) -> list[AnyFault]:
    """The faults of a scenario, in the order of the file. UserError: a table that is wrong, or a robot that is in no sub-team."""
    try:
        found = _FAULTS.validate_python(scenario.tables.get("fault", []))
    except ValidationError as error:
        raise UserError(f"{scenario.where}: {_first_fault(error)}") from error
    known = scenario.team.robots if found else ()
    for number, fault in enumerate(found):
        strangers = [name for name in fault.names if name not in known]
        if strangers:
            where, those = f"{scenario.where}: fault.{number}.{fault.kind}", ", ".join(known)
            raise UserError(f"{where}: no robot of the team has the name {strangers[0]}; use one of {those}")
    return found


def _first_fault(error: ValidationError) -> str:
    """The first fault of a validation, as 'fault.0.lie.offset: what to give instead'."""
    first = error.errors(include_url=False)[0]
    if first["type"].startswith("union_tag"):
        given = first["input"].get("kind") if isinstance(first["input"], dict) else None
        number = first["loc"][0]
        return f"fault.{number}.kind: no fault of this kind{nearest(given, KINDS)}; use one of {', '.join(KINDS)}"
    if len(first["loc"]) < 2:
        return "fault: give tables, each as [[fault]] with kind, robot and what the kind needs"
    number, kind = first["loc"][:2]
    models = dict(zip(KINDS, get_args(AnyFault), strict=True))
    return first_fault(error, f"fault.{number}.{kind}", models[str(kind)], below=2)


def faulty_robots(scenario: Scenario) -> frozenset[str]:
    """The robots under some fault, also one that is not `active`: they are scored by themselves."""
    return frozenset(name for fault in faults_of(scenario) for name in fault.names)


def without_faults(scenario: Scenario) -> Scenario:
    """The scenario with nothing wrong, in which the same robots are scored by themselves. UserError as in `faults_of`."""
    faults_of(scenario)
    tables = [{**table, "active": False} for table in scenario.tables.get("fault", [])]
    return Scenario({**scenario.tables, "fault": tables}, scenario.where) if tables else scenario
