"""docs/wire.md says what the code does: every key, message, field, default, reason and limit, and its worked example."""

from __future__ import annotations

import re
import runpy
import zlib

import numpy as np
import pytest
from pydantic import BaseModel

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.wire import evidence, keys, memory, messages
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import MAX_CELLS, REASONS, Report
from blackboard.wire.raw import MAX_BYTES, MAX_ITEMS, MAX_TEXT, MAX_TOTAL, VERSION
from blackboard.wire.types import LARGEST, LEAST, MAX_NAME, MAX_OPINIONS, Message, Part
from tests.files import page

PAGE = page("wire.md")
MODELS = [
    model
    for model in {**vars(messages), **vars(evidence), **vars(memory)}.values()
    if isinstance(model, type) and issubclass(model, Part) and model not in (Part, Message)
]


def section(title: str) -> str:
    found = re.search(rf"^#+ {re.escape(title)}$(.*?)(?=^#+ |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"no section {title}"
    return found[1]


def rows(text: str) -> list[list[str]]:
    """The cells of the one table in a text, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def default(model: type[BaseModel], name: str) -> str:
    """How the page writes the default of a field."""
    field = model.model_fields[name]
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    value = list(value) if isinstance(value, tuple) else value
    if isinstance(value, bool | list | dict | bytes):
        return {"False": "false"}.get(repr(value), f"`{value!r}`")
    return f'`"{value}"`' if isinstance(value, str) else f"{value:g}"


def test_the_key_table_is_the_one_that_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(keys.__file__), run_name="__main__")
    assert capsys.readouterr().out.strip() in PAGE


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_field_of_every_message_stands_there_with_its_default(model: type[BaseModel]) -> None:
    told = {name.strip("`"): value for name, _, value, _ in rows(section(model.__name__))}
    known = {name: default(model, name) for name in model.model_fields}
    assert {n: v.strip("`") for n, v in told.items()} == {n: v.strip("`") for n, v in known.items()}


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_choice_and_bound_of_a_field_stands_there(model: type[BaseModel]) -> None:
    told = {name.strip("`"): kind for name, kind, _, _ in rows(section(model.__name__))}
    for name, schema in model.model_json_schema()["properties"].items():
        assert all(f'`"{choice}"`' in told[name] for choice in schema.get("enum", []))
        if schema.get("maxItems") != schema.get("minItems"):
            assert f" {schema['maxItems']}" in told[name]
        if schema.get("type") == "number":
            bound = {LEAST: "> 0", 0: ">= 0", -LARGEST: ""}[schema["minimum"]]
            assert schema["maximum"] == LARGEST
            assert f"float {bound}".strip() in told[name]


def test_the_reasons_are_the_code_s_own_and_in_their_order() -> None:
    assert [(name.strip("`"), text) for name, text in rows(section("What is refused"))] == list(REASONS.items())


def test_the_limits_are_the_code_s_own() -> None:
    limits = section("Limits")
    for limit in (MAX_BYTES, MAX_CELLS, MAX_OPINIONS, MAX_ITEMS, MAX_TEXT, MAX_TOTAL, MAX_NAME):
        assert f" {limit}" in limits
    assert f"version {VERSION}" in section("Versions")


def test_the_worked_example_of_fine_levels_is_true() -> None:
    text = section('Coding `"log16"`')
    (dump,) = re.findall(r"^ {4}((?:[0-9a-f]{2} ?)+)$", text, re.MULTILINE)
    p = np.array([[0, 0, 0, 0], [0, 0.5, 0.25, 0], [0, 0.125, 0.124999, 0.000001]])
    packed = pack(Belief(Grid((3, 4), 0.5, (0.0, 0.0), "m"), p), "log16")
    assert packed.data == bytes.fromhex(dump)
    assert zlib.decompress(packed.data) == bytes.fromhex("fc33023603040000")
    found = unpack(packed).p[1:3, 1:3].ravel()
    told = [1, 0.496585, 0.252840, 0.252840]
    np.testing.assert_allclose(found, np.array(told) / 2.002264 * (1 - packed.rest), rtol=3e-6)


def test_the_worked_example_is_true() -> None:
    text = section('Coding `"log8"`')
    dumps = [bytes.fromhex(dump) for dump in re.findall(r"((?:^ {4}(?:[0-9a-f]{2} ?)+\n)+)", text, re.MULTILINE)]
    data, payload = dumps
    assert zlib.decompress(data) == bytes.fromhex("fff2f200")
    assert f"{len(payload)} bytes" in text
    report = decode(Report, payload)
    assert (report.source, report.subject, report.tick, report.time) == ("r1", "object/ball", 7, 1.5)
    assert report.belief.data == data
    p = np.array([[0, 0, 0, 0], [0, 0.5, 0.25, 0], [0, 0.125, 0.124999, 0.000001]])
    grid = Grid((3, 4), 0.5, (0.0, 0.0), "m")
    found = unpack(report.belief, grid)
    np.testing.assert_array_equal(found.p, unpack(pack(Belief(grid, p))).p)
    told = re.findall(r"^ {4}(1\.25e-07.*)$", text, re.MULTILINE)
    np.testing.assert_allclose([[float(x) for x in line.split()] for line in told], found.p, atol=5.1e-9)
