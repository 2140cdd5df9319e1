"""Whatever is wrong with a scenario or a message, a person is told what may be given, and never in pydantic's words."""

import re
from collections.abc import Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from blackboard.config import BoardSection, GridSection, Scenario, Section, TeamSection, TimeSection
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.faults import KINDS, AnyFault, faults_of
from blackboard.wire.messages import Report, Status
from blackboard.wire.mistakes import allowed, first_mistake, nearest, schema_of
from robot_agent.config import RobotSection

SECTIONS: dict[str, type[Section]] = {
    "team": TeamSection,
    "grid": GridSection,
    "time": TimeSection,
    "board": BoardSection,
    "robot": RobotSection,
    "world": WorldSection,
}
WRONG: tuple[object, ...] = (
    None, "?!", -1e99, 1e99, float("nan"), [], ["x"], [1, 2, 3], {"x y": 1}, {"x": {"y": 2}}, True, b"bytes",
)  # fmt: skip
PYDANTIC = re.compile(
    r"should|Extra inputs|Field required|Value error|validation error|type=|pydantic|unable to|another value", re.I
)


def fields(model: type[BaseModel], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The path of every key of a section, also in its tables."""
    for name, field in model.model_fields.items():
        yield (*path, name)
        inner = [field.annotation, *get_args(field.annotation)]
        for kind in inner:
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from fields(kind, (*path, name))


def nested(path: tuple[str, ...], value: object) -> Any:
    return value if not path else {path[0]: nested(path[1:], value)}


@pytest.mark.parametrize("name", SECTIONS)
def test_no_wrong_value_of_any_key_is_told_in_pydantics_words(name: str) -> None:
    model, mistakes = SECTIONS[name], 0
    for path in fields(model):
        for value in WRONG:
            try:
                Scenario({name: nested(path, value)}, "it.toml").section(name, model)
            except UserError as error:
                text = str(error)
                assert text.startswith(f"it.toml: {name}."), text
                assert not PYDANTIC.search(text), text
                assert "\n" not in text
                mistakes += 1
    assert mistakes > 3 * len(list(fields(model)))


@pytest.mark.parametrize("kind", KINDS)
def test_no_wrong_fault_is_told_in_pydantics_words(kind: str) -> None:
    model = dict(zip(KINDS, get_args(AnyFault), strict=True))[kind]
    good: dict[str, Any] = {"kind": kind, "robots": ["r1", "r2"]}
    for key in model.model_fields:
        for value in WRONG:
            try:
                faults_of(Scenario({"fault": [{**good, key: value}]}, "it.toml"))
            except UserError as error:
                assert str(error).startswith("it.toml: fault.0."), error
                assert not PYDANTIC.search(str(error)), error


@pytest.mark.parametrize("tables", [3, "lie", [3], {"kind": "lie"}, [[]]])
def test_faults_that_are_no_tables_are_told_too(tables: object) -> None:
    with pytest.raises(UserError, match=r"^it\.toml: fault"):
        faults_of(Scenario({"fault": tables}, "it.toml"))


@pytest.mark.parametrize(
    ("section", "cure"),
    [
        ({"grid": {"shap": [5, 5]}}, "grid.shap: no such key; did you mean shape?; known are anchor, cell, frame"),
        ({"grid": {"shape": [5, 1]}}, "grid.shape.1: give a whole number from 2 to 1000 (got 1)"),
        ({"grid": {"shape": [5]}}, "grid.shape.1: is missing; give a whole number from 2 to 1000"),
        ({"grid": {"anchor": {"latitude": 1}}}, "grid.anchor.longitude: is missing; give a number from -180 to 180"),
        ({"grid": {"frame": "x" * 99}}, "grid.frame: give a text of at most 64 characters (got 'xxx"),
        ({"time": {"mode": "locksetp"}}, 'give "lockstep" or "realtime"; did you mean lockstep? (got \'locksetp\')'),
        ({"team": {"sub_teams": {"a": "r1"}}}, "team.sub_teams.a: give a list, each a name of up to 64 letters"),
        ({"team": {"boards": 2.5}}, "team.boards: give a whole number from 1 to 9 (got 2.5)"),
        (
            {"robot": {"landmarks": {"a": [1e300, 0]}}},
            "robot.landmarks.a.0: give a number from -1e+12 to 1e+12 (got 1e+300)",
        ),
        (
            {"robot": {"landmarks": {f"l{k}": [k, 0] for k in range(1001)}}},
            "give a table of at most 1000 keys (got {'l0'",
        ),
        (
            {"robot": {"landmarks": {"x" * 999: [0, 0]}}},
            f"robot.landmarks.{'x' * 80}...: give a name of up to 64 letters",
        ),
        ({"tame": {}}, "unknown section or key 'tame'; did you mean "),
    ],
)
def test_the_cure_names_what_may_be_given(section: dict[str, Any], cure: str) -> None:
    (name,) = section
    with pytest.raises(UserError) as error:
        Scenario(section, "it.toml").section(name, SECTIONS.get(name, TeamSection))
    assert cure in str(error.value)


def test_a_name_that_is_near_nothing_has_no_nearest() -> None:
    assert nearest("zzz", ["seed", "speed"]) == ""
    assert nearest(7, ["seed"]) == ""
    assert nearest("sped", ["seed", "speed"]) == "; did you mean speed?"


def test_a_long_value_is_cut_and_costs_little() -> None:
    with pytest.raises(ValidationError) as error:
        Status.model_validate({"process": b"x" * 1_000_000, "kind": "robot", "tick": 0, "time": 0.0})
    place, cure = first_mistake(error.value, Status)
    assert place == ("process",)
    assert cure.endswith("(got 1000000 bytes)")
    with pytest.raises(ValidationError) as error:
        Report.model_validate({"source": "x" * 1_000_000})
    assert len(first_mistake(error.value, Report)[1]) < 300


def test_what_is_allowed_is_said_of_every_key() -> None:
    for model in SECTIONS.values():
        root = schema_of(model)
        assert not [name for name, schema in root["properties"].items() if PYDANTIC.search(allowed(schema, root))]
