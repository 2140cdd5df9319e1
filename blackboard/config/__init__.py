"""A scenario file, and the sections of it that more than one process reads.

A scenario is one TOML file (or the same as JSON, which the launcher writes). Every process reads it whole and validates
the sections it uses: [team] [grid] [time] [board] here, [robot] in `robot_agent.config`, [world] in `blackboard.config.world`,
[[fault]] in `blackboard.faults`.
"""

import itertools
import json
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from blackboard.errors import RuleError, UnknownKeyError, UserError
from blackboard.opinion.grid import Anchor, Grid
from blackboard.opinion.rules import Rule, find, merged, read_rule
from blackboard.tables import read_tables
from blackboard.wire.mistakes import KEY, SHOWN, first_mistake, nearest
from blackboard.wire.names import MAX_FRAME, NAME, SUBJECT_KINDS

SECTIONS = ("name", "team", "grid", "time", "board", "robot", "robots", "world", "fault")
Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
#: Of a random walk. With 1e6 the covariance of a joint is no longer positive definite in floating point, and the joint begins anew.
Drift = Annotated[float, Field(ge=0, le=1000)]
#: A subject, or several: each of the two chunks may be `*`, as in a key expression.
Subjects = Annotated[str, Field(pattern=rf"^({SUBJECT_KINDS}|\*)/({NAME}|\*)$")]


class Section(BaseModel):
    """A table of the scenario; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class TeamSection(Section):
    """Who is in the team."""

    name: Name = "demo"
    "Name of the team; a chunk of every key."
    sub_teams: dict[Name, list[Name]] = Field(default_factory=lambda: {"a": ["r1", "r2", "r3"]}, min_length=1)
    "Sub-teams with the names of their robots; a robot may be in several."
    boards: Annotated[int, Field(ge=1, le=9)] = 1
    "Boards of each sub-team: one leads, the others take over when it dies."
    guests: Literal["none", "watch", "vote"] = "watch"
    "Robots that sub_teams does not name: shut out, or only listen, or are heard; until a named one has seen them they share one vote."

    @field_validator("sub_teams")
    @classmethod
    def _each_once(cls, sub_teams: dict[str, list[str]]) -> dict[str, list[str]]:
        for name, robots in sub_teams.items():
            for robot in robots:
                if robots.count(robot) > 1:
                    raise ValueError(f"{robot} is in sub-team {name} more than once")
        return sub_teams

    def boards_of(self, sub_team: str) -> list[str]:
        """The names of a sub-team's boards, as `board-a`, `board-a2`; the first one leads from the beginning of a run."""
        return [f"board-{sub_team}" + (str(n) if n > 1 else "") for n in range(1, self.boards + 1)]

    @property
    def robots(self) -> tuple[str, ...]:
        """All robots, each once, in the order of the file."""
        return tuple(dict.fromkeys(robot for robots in self.sub_teams.values() for robot in robots))

    def is_guest(self, robot: str) -> bool:
        """Whether a file that names robots does not name this one."""
        return "sub_teams" in self.model_fields_set and not any(robot in robots for robots in self.sub_teams.values())

    def of(self, robot: str) -> list[str]:
        """The sub-teams of a robot; one that the file does not name is spread over them by its name."""
        named = [sub_team for sub_team, robots in self.sub_teams.items() if robot in robots]
        return named or [list(self.sub_teams)[zlib.crc32(robot.encode()) % len(self.sub_teams)]]


class AnchorSection(Section):
    """The place and direction of the coordinate frame on Earth."""

    latitude: Annotated[float, Field(ge=-90, le=90)]
    "[degrees] Latitude (WGS 84) of the point (0, 0)."
    longitude: Annotated[float, Field(ge=-180, le=180)]
    "[degrees] Longitude of the point (0, 0)."
    bearing: Annotated[float, Field(ge=-360, le=360)] = 90.0
    "[degrees] Direction of the x axis, clockwise from north."


class GridSection(Section):
    """The cells that all beliefs are made of."""

    shape: tuple[Annotated[int, Field(ge=2, le=1000)], Annotated[int, Field(ge=2, le=1000)]] = (50, 50)
    "Cells along x and along y."
    cell: Positive = 1.0
    "[unit] Edge of a cell."
    origin: tuple[float, float] = (0.0, 0.0)
    "[unit] The corner with the smallest x and y."
    unit: Literal["cell", "m"] = "cell"
    "Unit of all lengths of the scenario."
    frame: Annotated[str, Field(max_length=MAX_FRAME)] = ""
    "Name of the coordinate frame, as in ROS; beliefs in another one are refused."
    anchor: AnchorSection | None = None
    "Where the frame is on Earth."

    def grid(self) -> Grid:
        at = self.anchor
        anchor = None if at is None else Anchor(at.latitude, at.longitude, at.bearing)
        return Grid(self.shape, self.cell, self.origin, self.unit, self.frame, anchor)


class TimeSection(Section):
    """How long a run is, and how it is paced."""

    tick: Positive = 0.2
    "[s] Length of a tick, of team time."
    seconds: Annotated[float, Field(gt=0)] = 60.0
    "[s] Length of a run, of team time; inf: until the world is stopped, and then judged."
    mode: Literal["lockstep", "realtime"] = "lockstep"
    "Whether the world waits for everybody in each tick, or goes by the wall clock."

    @property
    def ticks(self) -> int:
        """How many ticks follow the first one, tick 0. UserError: the run has no end."""
        if math.isinf(self.seconds):
            raise UserError("time.seconds is inf: only a world process (sim-world) runs until it is stopped")
        return max(1, round(self.seconds / self.tick))


class BoardSection(Section):
    """How boards pool: the rule, whose parameters stand beside it (also by subject), and a board's own keys."""

    model_config = ConfigDict(extra="allow", frozen=True)

    rule: str = "coalition"
    "How opinions are pooled; its parameters stand beside it."
    subjects: dict[Subjects, dict[str, Any]] = Field(default_factory=dict)
    "Another rule or other parameters for some subjects."
    feedback: Literal["paper", "guarded", "off"] = "guarded"
    "How robots take the team's beliefs back: as in the paper's Table I, guarded against counting anything twice, or not at all."
    fusion: Literal["opinions", "joint"] = "opinions"
    "Whether beliefs are pooled, or what robots send as evidence goes into one joint Gaussian of the team."
    objects_drift: Drift = 0.5
    "[unit/sqrt(s)] How objects in the joint move before their own sightings show it: a random walk."
    objects_drifts: dict[Name, Drift] = Field(default_factory=dict)
    "[unit/sqrt(s)] The same of single objects, by name, in place of objects_drift: { can = 0.0 } stands still, until it is kicked."
    objects_motion: Literal["learn", "walk", "roll"] = "learn"
    "How objects in the joint move on: at random (walk), at a velocity that changes (roll), or as their sightings show (learn)."
    objects_motions: dict[Name, Literal["learn", "walk", "roll"]] = Field(default_factory=dict)
    "The same of single objects, by name, in place of objects_motion: { ball = 'roll' }."
    sharpest: Positive | None = None
    "[unit] The least sigma of a place that a robot's sensors can have: who claims less counts as that; a cell / 8."
    max_age: Positive = 10.0
    "[s] Age, in team time, beyond which a source that fell silent is left out."
    drift: Annotated[float, Field(ge=0)] = 1.0
    "[unit/sqrt(s)] How an old report spreads with age."
    future: Positive = 1.0
    "[s] How far a stamp may be ahead of team time."
    skew: Annotated[float, Field(ge=0)] = 30.0
    "[s] How far a clock may be off and is corrected, where there is no world."
    patience: Positive = 8.0
    "[s] How long it waits, in wall time, for a robot in one tick, a quarter longer for boards."
    period: Positive = 0.2
    "[s] Longest time between settlements where no world gives the clock; as robots step, up to four fall into it."
    coding: Literal["log8", "log16"] = "log8"
    "How boards write beliefs: log16 once every member and viewer of the team reads it (docs/bytes.md)."

    @model_validator(mode="after")
    def _rules_are_sound(self) -> Self:
        """Read the rule of every possible subject, so that a mistake in any table is found here.

        Subjects that no pattern names all have the same rule, so one name is tried for them.
        """
        names = {pattern.split("/")[1] for pattern in self.subjects} - {"*"}
        for kind, name in itertools.product(SUBJECT_KINDS.split("|"), sorted(names | {"any-other"})):
            self.of(f"{kind}/{name}")
        return self

    def of(self, subject: str) -> Rule:
        """The rule for a subject: the board's, changed by every table of `subjects` that matches, the most exact one last.

        A table that names another rule begins anew with that rule's defaults; any other keeps what it does not set.
        """
        return self._rule(self._matching(subject))

    def in_force(self) -> dict[str, str | float]:
        """The rule with its parameters, then the same for each table of `subjects`, as `object/ball.rule`."""
        parameters = self._rule([]).in_force()
        for pattern in sorted(self.subjects):
            parameters |= {f"{pattern}.{name}": value for name, value in self.of(pattern).in_force().items()}
        return parameters

    @property
    def learns(self) -> bool:
        """Whether the rule of any subject has the independence "learn"."""
        return any(
            name.split(".")[-1] == "independence" and value == "learn" for name, value in self.in_force().items()
        )

    def subjects_under(self, rule: str) -> dict[str, dict[str, Any]]:
        """`subjects` for a board with another rule: tables that name no rule lose the parameters that they would not have there."""
        subjects: dict[str, dict[str, Any]] = {}
        for pattern in _general_first(self.subjects):
            table, general = self.subjects[pattern], {"rule": rule}
            for other in _general_first(subjects):
                general = merged(general, subjects[other]) if _matches(other, pattern) else general
            known = {"rule", *find(general["rule"]).keys({**general, **table})}
            subjects[pattern] = table if "rule" in table else {k: v for k, v in table.items() if k in known}
        return subjects

    def _matching(self, subject: str) -> list[str]:
        return [pattern for pattern in _general_first(self.subjects) if _matches(pattern, subject)]

    def _rule(self, patterns: Sequence[str]) -> Rule:
        """The board's rule as changed by some tables of `subjects`; RuleError names the table and the key that is wrong."""
        table: dict[str, Any] = {"rule": self.rule, **(self.model_extra or {})}
        place = dict.fromkeys(table, "")
        try:
            for pattern in patterns:
                place |= dict.fromkeys(self.subjects[pattern], f"subjects.{pattern}.")
                table = merged(table, self.subjects[pattern])
            return read_rule(table)
        except RuleError as error:
            where, cure = place.get(error.key, ""), error.cure
            if isinstance(error, UnknownKeyError) and not where:  # perhaps one of the board's own keys, misspelt
                own = sorted(type(self).model_fields)
                cure += f"; a board has {', '.join(own)}" + nearest(error.key, own)
            raise RuleError(where + error.key, cure, error.value) from None


def _general_first(patterns: Iterable[str]) -> list[str]:
    return sorted(patterns, key=lambda pattern: (-pattern.count("*"), pattern))


def _matches(pattern: str, subject: str) -> bool:
    return all(a in ("*", b) for a, b in zip(pattern.split("/"), subject.split("/"), strict=True))


S = TypeVar("S", bound=Section)


class Scenario:
    """A scenario file as read; `where` it came from stands in error messages."""

    def __init__(self, tables: Mapping[str, Any], where: str = "the defaults") -> None:
        unknown = sorted(set(tables) - set(SECTIONS))
        if unknown:
            near = nearest(unknown[0], SECTIONS)
            raise UserError(f"{where}: unknown section or key '{unknown[0]}'{near}; known are {', '.join(SECTIONS)}")
        self.tables = dict(tables)
        self.where = where

    @property
    def name(self) -> str:
        """What it is called; without a name of its own as its team, where that has one."""
        team = self.team.name if "name" in self.team.model_fields_set else "scenario"
        return str(self.tables.get("name", team))

    def unknown_sub_teams(self, sub_teams: Iterable[str]) -> list[str]:
        """For each of some sub-teams that the file does not have, a sentence: it may be a misspelling, or joined on purpose."""
        known = sorted(self.team.sub_teams)
        return [
            f"{self.where} has no sub-team {sub_team}{nearest(sub_team, known)}; it has {', '.join(known)}"
            for sub_team in sub_teams
            if sub_team not in known
        ]

    def section(self, name: str, model: type[S]) -> S:
        """One table, validated; the first thing wrong with it is a `UserError` with file, field and cure."""
        try:
            return model.model_validate(self.tables.get(name, {}))
        except ValidationError as error:
            raise UserError(f"{self.where}: {first_fault(error, name, model)}") from error

    @property
    def team(self) -> TeamSection:
        return self.section("team", TeamSection)

    @property
    def grid(self) -> Grid:
        return self.section("grid", GridSection).grid()

    @property
    def time(self) -> TimeSection:
        return self.section("time", TimeSection)

    @property
    def board(self) -> BoardSection:
        return self.section("board", BoardSection)

    def changed(self, section: str, **values: object) -> "Scenario":
        """The scenario with some keys of one section set (those that are not None)."""
        table = {**self.tables.get(section, {}), **{k: v for k, v in values.items() if v is not None}}
        return Scenario({**self.tables, section: table}, self.where)

    def with_rule(self, name: str | None) -> "Scenario":
        """The scenario with another rule for its boards, without the parameters of the rule it had; None: unchanged."""
        board = self.board
        if name is None or name == board.rule:
            return self
        kept = {key: value for key, value in self.tables.get("board", {}).items() if key in BoardSection.model_fields}
        try:
            find(name)
            kept["subjects"] = board.subjects_under(name)
        except RuleError as error:
            raise UserError(f"{self.where}: board.{error}") from None
        return Scenario({**self.tables, "board": {**kept, "rule": name}}, self.where)

    def to_json(self) -> str:
        return json.dumps(self.tables)


def first_fault(error: ValidationError, where: str, model: type[BaseModel], below: int = 0) -> str:
    """The first fault of a validation as 'section.field: what to give instead'; `where` stands for so many steps to the model."""
    fault = error.errors(include_url=False)[0]
    cause, place = fault.get("ctx", {}).get("error"), tuple(fault["loc"][below:])
    if isinstance(cause, RuleError):
        place, cure = (*place, cause.key), cause.cure + ("" if cause.value is None else f" (got {cause.value})")
    else:
        place, cure = first_mistake(error, model, below)
    parts = [str(part) for part in (where, *place) if part != KEY]
    return f"{'.'.join(part if len(part) <= SHOWN else f'{part[:SHOWN]}...' for part in parts)}: {cure}"


def load(name: str | Path) -> Scenario:
    """A scenario from a file, or by the name of one that comes with the package (`demo`, `mrclam`, ...)."""
    return Scenario(*read_tables(name))
