"""A scenario file, and the sections of it that more than one process reads.

A scenario is one TOML file (or the same as JSON, which the launcher writes). Every process reads it whole and validates
the sections it uses: [team] [grid] [time] [board] here, [robot] in `robot_agent.config`, [world] in `sim_world.scenario`.
"""

from __future__ import annotations

import json
import tomllib
import zlib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from blackboard.errors import Mistake
from blackboard.opinion.grid import Grid

SECTIONS = ("name", "team", "grid", "time", "board", "robot", "world")
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
#: A subject, or several: each of the two chunks may be `*`, as in a key expression.
Subjects = Annotated[str, Field(pattern=r"^(robot|object|landmark|\*)/([A-Za-z0-9_.-]{1,64}|\*)$")]


class Section(BaseModel):
    """A table of the scenario; an unknown key is a mistake."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class TeamSection(Section):
    name: Name = "demo"
    sub_teams: dict[Name, list[Name]] = Field(default_factory=lambda: {"a": ["r1", "r2", "r3"]}, min_length=1)

    @property
    def robots(self) -> tuple[str, ...]:
        """All robots, each once, in the order of the file."""
        return tuple(dict.fromkeys(robot for robots in self.sub_teams.values() for robot in robots))

    def of(self, robot: str) -> list[str]:
        """The sub-teams of a robot; one that the file does not name is spread over them by its name."""
        named = [sub_team for sub_team, robots in self.sub_teams.items() if robot in robots]
        return named or [list(self.sub_teams)[zlib.crc32(robot.encode()) % len(self.sub_teams)]]


class GridSection(Section):
    shape: tuple[Annotated[int, Field(ge=2, le=1000)], Annotated[int, Field(ge=2, le=1000)]] = (50, 50)
    cell: Positive = 1.0
    origin: tuple[float, float] = (0.0, 0.0)
    unit: Literal["cell", "m"] = "cell"

    def grid(self) -> Grid:
        return Grid(self.shape, self.cell, self.origin, self.unit)


class TimeSection(Section):
    tick: Positive = 0.2  # seconds of team time
    seconds: Positive = 60.0
    mode: Literal["lockstep", "realtime"] = "lockstep"


class RuleSection(Section):
    """A rule for pooling first-hand beliefs, and its parameters; those that the rule does not have are not looked at.

    The defaults are argued in docs/paper.md. The paper's own are `rule = "cooperative"`, `k = 2`, `gamma = 0.5`.
    """

    rule: str = "coalition"
    k: Annotated[float, Field(ge=0, le=10)] = 2.0  # weights 1 / H^k (III-A.1)
    gamma: Annotated[float, Field(gt=0, le=1)] | None = None  # ratio of the alphas (V-C); None: 1/2, or by `gate`
    gate: Positive = 4.0  # nats, of "coalition", where gamma is not given: what costs more to agree with is left out
    reference_cell: Positive | None = None  # edge in the grid's unit; None: the grid's own cell, the paper's formula
    independence: Share = 0.2  # within a coalition: 0 the mean of its members, 1 their product
    power: Positive | None = None  # of "calibrated"; None: alpha_N
    a: Annotated[float, Field(ge=-20, le=20)] = 0.5  # exponent of "hoelder"
    inner: str = "logarithmic"  # the rule behind the gate of "clique"
    xi: Positive = 2.0  # nats, the gate of "clique" (II-A.1)

    @model_validator(mode="after")
    def _known_rules(self) -> RuleSection:
        from blackboard.opinion.pools import POOLS

        for field, rule in (("rule", self.rule), ("inner", self.inner)):
            if rule not in POOLS:
                raise ValueError(f"{field} {rule!r} is none of {', '.join(sorted(POOLS))}")
        if self.inner == "clique":
            raise ValueError("inner: a gate behind a gate gains nothing; name another rule")
        return self


class BoardSection(RuleSection):
    """[board]: the rule, also per subject ([board.subjects."object/ball"], "object/*"), and how a board keeps time."""

    subjects: dict[Subjects, RuleSection] = Field(default_factory=dict)
    feedback: Literal["paper", "guarded", "off"] = "guarded"
    max_age: Positive = 10.0  # seconds of team time after which a source that fell silent is left out
    drift: Annotated[float, Field(ge=0)] = 1.0  # unit per square root of a second: how an old report spreads
    future: Positive = 1.0  # seconds that a stamp may be ahead of team time
    patience: Positive = 2.0  # wall seconds to wait for a registered robot or another board in one tick
    period: Positive = 0.2  # seconds between settlements where no world gives the clock

    def of(self, subject: str) -> RuleSection:
        """The rule for a subject: the board's, with what the matching tables set instead, the most exact one last."""
        own = {name: getattr(self, name) for name in RuleSection.model_fields}
        for pattern in sorted(self.subjects, key=lambda p: (-p.count("*"), p)):
            if all(a in ("*", b) for a, b in zip(pattern.split("/"), subject.split("/"), strict=False)):
                table = self.subjects[pattern]
                own |= {name: getattr(table, name) for name in table.model_fields_set}
        return RuleSection(**own)


S = TypeVar("S", bound=Section)


class Scenario:
    """A scenario file as read, and where it came from (for messages)."""

    def __init__(self, tables: Mapping[str, Any], source: str = "the defaults") -> None:
        unknown = sorted(set(tables) - set(SECTIONS))
        if unknown:
            raise Mistake(f"{source}: unknown section or key '{unknown[0]}'; known are {', '.join(SECTIONS)}")
        self.tables = dict(tables)
        self.source = source

    @property
    def name(self) -> str:
        return str(self.tables.get("name", "scenario"))

    def section(self, name: str, model: type[S]) -> S:
        """One table, validated; the first thing wrong with it is a `Mistake` with file, field and cure."""
        try:
            return model.model_validate(self.tables.get(name, {}))
        except ValidationError as error:
            raise Mistake(f"{self.source}: {first_fault(error, name)}") from error

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

    def changed(self, section: str, **values: object) -> Scenario:
        """The same with some keys of one section set (those that are not None)."""
        table = {**self.tables.get(section, {}), **{k: v for k, v in values.items() if v is not None}}
        return Scenario({**self.tables, section: table}, self.source)

    def to_json(self) -> str:
        return json.dumps(self.tables)


def first_fault(error: ValidationError, where: str) -> str:
    """The first fault of a validation as 'section.field: what is wrong'."""
    fault = error.errors()[0]
    field = ".".join(str(part) for part in (where, *fault["loc"]))
    if fault["type"] == "extra_forbidden":
        return f"{field}: no such key; remove it or mend its spelling"
    return f"{field}: {fault['msg']} (got {fault['input']!r:.80})"


def load(name: str | Path) -> Scenario:
    """A scenario from a file, or by the name of one that comes with the package (`demo`, `mrclam`, ...)."""
    path = Path(name)
    if not path.suffix:
        shipped = resources.files("sim_world") / "scenarios" / f"{path}.toml"
        if not shipped.is_file():
            raise Mistake(f"{name}: no scenario of this name comes with the package; give a file that ends in .toml")
        return Scenario(tomllib.loads(shipped.read_text(encoding="utf-8")), f"{name} (shipped)")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise Mistake(f"{path}: cannot be read ({error}); give an existing TOML file") from error
    try:
        tables = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:
        raise Mistake(f"{path}: not valid TOML ({error})") from error
    return Scenario(tables, str(path))
