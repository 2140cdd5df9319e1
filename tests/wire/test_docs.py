"""docs/messages.md is what the models print now; docs/wire.md and docs/bytes.md have the code's limits, and worked examples that are true."""

import re
import subprocess
import sys
import zlib

import numpy as np
import pytest

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.run.reference import meaning_of
from blackboard.wire import evidence, memory, messages
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import MAX_CELLS, Report
from blackboard.wire.raw import MAX_BYTES, MAX_ITEMS, MAX_TEXT, MAX_TOTAL, VERSION
from blackboard.wire.types import MAX_NAME, MAX_OPINIONS, Message, Part
from tests.files import ROOT, page

PAGE = page("wire.md") + page("bytes.md")
MODELS = [
    model
    for model in {**vars(messages), **vars(evidence), **vars(memory)}.values()
    if isinstance(model, type) and issubclass(model, Part) and model not in (Part, Message)
]


def section(title: str) -> str:
    match = re.search(rf"^#+ {re.escape(title)}$(.*?)(?=^#+ |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert match, f"no section {title}"
    return match[1]


def rows(text: str) -> list[list[str]]:
    """The cells of the one table in a text, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_page_of_messages_is_current() -> None:
    """`python -m blackboard.run.messages > docs/messages.md` makes it so."""
    runs = [sys.executable, "-m", "blackboard.run.messages"]
    assert subprocess.run(runs, cwd=ROOT, capture_output=True, text=True, check=True).stdout == page("messages.md")


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_message_and_field_says_what_it_means(model: type[Part]) -> None:
    assert model.__doc__
    assert model.__doc__ != Part.__doc__
    assert [name for name in model.model_fields if not meaning_of(model, name)[1]] == []
    assert f"# {model.__name__}\n" in page("messages.md")


def test_types_defaults_and_bounds_are_those_of_the_models() -> None:
    text = page("messages.md")
    assert "| `samples` | float | required | effective comparisons" in text
    assert "| `power` | float >= 0 | 1 |" in text
    assert "| `dt` | float > 0 | required | seconds |" in text
    assert '| `coding` | `"log8"` or `"log16"` or `"f32"` | `"log8"` |' in text
    assert "| `shape` | array (1 to 3) of integer (1 to 1048576) | required |" in text
    assert "| `grid` | [PackedGrid](#packedgrid) | none |" in text
    assert "| `settled` | map (at most 256) of name to array (at most 256) of subject | `{}` |" in text
    assert "| `follows` | boolean | false |" in text
    assert "| `covariance` | array (at most 36) of float | `[]` |" in text


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
    masses = unpack(packed).p[1:3, 1:3].ravel()
    expected = [1, 0.496585, 0.252840, 0.252840]
    np.testing.assert_allclose(masses, np.array(expected) / 2.002264 * (1 - packed.rest), rtol=3e-6)


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
    belief = unpack(report.belief, grid)
    np.testing.assert_array_equal(belief.p, unpack(pack(Belief(grid, p))).p)
    shown = re.findall(r"^ {4}(1\.25e-07.*)$", text, re.MULTILINE)
    np.testing.assert_allclose([[float(x) for x in line.split()] for line in shown], belief.p, atol=5.1e-9)
