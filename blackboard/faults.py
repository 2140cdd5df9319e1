"""[[fault]]: what is wrong with some robots of a scenario, and when. The world and the robots concerned each read their part.

Faults of sensors (`is_of_sensors`) change what the world measures, the others what the robot says. All times are team time in seconds.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from blackboard.config import Name, Scenario, Section, first_fault
from blackboard.errors import UserError

Finite = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Offset = tuple[Finite, Finite]


class _Fault(Section):
    """Whom it concerns (`robot`, or several `robots`), and from when until when."""

    robot: Name | None = None
    robots: list[Name] = Field(default_factory=list, max_length=64)
    start: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    end: Annotated[float, Field(gt=0)] = math.inf
    active: bool = True  # False: nothing is wrong, and the robots are scored as `faulty` all the same, to compare with

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


class Lie(_Fault):
    """Every place that it tells is off by `offset` (unit): of itself, of what it sees, in beliefs and in evidence."""

    kind: Literal["lie"]
    offset: Offset


class Collude(_Fault):
    """Several robots tell the same lie."""

    kind: Literal["collude"]
    offset: Offset

    @model_validator(mode="after")
    def _are_several(self) -> Self:
        if len(self.names) < 2:
            raise ValueError("give at least two robots; one alone has the fault lie")
        return self


class Overconfident(_Fault):
    """The sigmas that it claims are smaller by `factor`."""

    kind: Literal["overconfident"]
    factor: Annotated[float, Field(gt=1, le=100)]


class Skew(_Fault):
    """Its stamps are `seconds` ahead of team time; behind, where negative."""

    kind: Literal["skew"]
    seconds: Annotated[float, Field(ge=-1e4, le=1e4, allow_inf_nan=False)]


class Lose(_Fault):
    """A share of its reports never arrives."""

    kind: Literal["lose"]
    share: Annotated[float, Field(gt=0, le=1)]


class Drift(_Fault):
    """A sensor creeps: its error grows by `rate` per second.

    odometry: the distance, as a share of itself; compass: radians; range: of sightings, unit; fix: unit, along x.
    """

    kind: Literal["drift"]
    sensor: Literal["odometry", "compass", "range", "fix"] = "odometry"
    rate: Annotated[float, Field(ge=-1e3, le=1e3, allow_inf_nan=False)]


class Freeze(_Fault):
    """`sensors` repeat what they measured last, or the `process` says nothing, and holds its liveliness token."""

    kind: Literal["freeze"]
    what: Literal["sensors", "process"] = "sensors"


Fault = Annotated[Lie | Collude | Overconfident | Skew | Lose | Drift | Freeze, Field(discriminator="kind")]
AnyFault = Lie | Collude | Overconfident | Skew | Lose | Drift | Freeze
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
        first = error.errors()[0]
        if first["type"].startswith("union_tag"):
            where = f"{scenario.where}: fault.{first['loc'][0]}.kind"
            raise UserError(f"{where}: no fault of this kind; use one of {', '.join(KINDS)}") from error
        raise UserError(f"{scenario.where}: {first_fault(error, 'fault')}") from error
    known = scenario.team.robots if found else ()
    for number, fault in enumerate(found):
        strangers = [name for name in fault.names if name not in known]
        if strangers:
            where, those = f"{scenario.where}: fault.{number}.{fault.kind}", ", ".join(known)
            raise UserError(f"{where}: no robot of the team has the name {strangers[0]}; use one of {those}")
    return found


def faulty_robots(scenario: Scenario) -> frozenset[str]:
    """The robots under some fault, also one that is not `active`: they are scored by themselves."""
    return frozenset(name for fault in faults_of(scenario) for name in fault.names)


def without_faults(scenario: Scenario) -> Scenario:
    """The scenario with nothing wrong, in which the same robots are scored by themselves. UserError as in `faults_of`."""
    faults_of(scenario)
    tables = [{**table, "active": False} for table in scenario.tables.get("fault", [])]
    return Scenario({**scenario.tables, "fault": tables}, scenario.where) if tables else scenario
