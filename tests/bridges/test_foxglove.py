"""The export for Foxglove, read back with another library than the one that wrote it."""

import struct
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from blackboard.bridges.foxglove import CELL
from blackboard.errors import UserError
from blackboard.tape.file import copy
from blackboard.wire.arrays import unpack
from tests.commands import call
from tests.files import GOLDEN
from tests.view.recorded import golden_team

pytest.importorskip("foxglove", reason="no foxglove-sdk: pip install '.[foxglove]'")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fox") / "x.mcap"
    assert call("tape", "export", GOLDEN, out, "--to", "foxglove") == 0
    return out


def parts(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """The fields of a protobuf message: number and value."""
    at = 0

    def varint() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = message[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(message):
        tag = varint()
        kind = tag & 7
        length = {0: 0, 1: 8, 5: 4}.get(kind, -1)
        if kind == 0:
            yield tag >> 3, varint()
            continue
        length = varint() if length < 0 else length
        yield tag >> 3, message[at : at + length]
        at += length


def double(message: bytes, number: int) -> float:
    """A double of a message; 0 where it is left out."""
    value = next((value for n, value in parts(message) if n == number), bytes(8))
    assert isinstance(value, bytes)
    return float(struct.unpack("<d", value)[0])


def part(message: bytes, number: int) -> bytes:
    value = next(value for n, value in parts(message) if n == number)
    assert isinstance(value, bytes)
    return value


def test_the_schemas_are_the_well_known_ones(exported: Path) -> None:
    with exported.open("rb") as file:
        schemas = Counter(schema.name for schema, _, _ in make_reader(file).iter_messages() if schema is not None)
    moments = list(golden_team().moments)
    assert schemas["foxglove.Grid"] >= sum(
        about.best is not None for moment in moments for about in moment.subjects.values()
    )
    assert schemas["foxglove.PosesInFrame"] >= 2 * len(moments)
    assert schemas["foxglove.Log"] == len(golden_team().events)
    assert set(schemas) == {"foxglove.Grid", "foxglove.PoseInFrame", "foxglove.PosesInFrame", "foxglove.Log"}


def test_a_grid_is_the_agreed_belief_where_it_is(exported: Path) -> None:
    about = golden_team().moments.newest.subjects["robot/r1"]  # type: ignore[union-attr]
    assert about.best is not None
    belief = unpack(about.best.message.belief)
    with exported.open("rb") as file:
        message = [logged.data for _, _, logged in make_reader(file).iter_messages(topics=["/belief/robot/r1"])][-1]
    cells = np.frombuffer(part(message, 9), CELL)
    columns = struct.unpack("<I", part(message, 4))[0]
    p = cells["probability"].reshape(-1, columns)  # rows of y
    position = part(part(message, 3), 1)
    row, column = (int(k) for k in np.unravel_index(int(p.argmax()), p.shape))
    x, y = double(position, 1) + column + 0.5, double(position, 2) + row + 0.5
    i, j = (int(k) for k in np.unravel_index(int(belief.p.argmax()), belief.p.shape))
    assert (x, y) == (i + 0.5, j + 0.5)
    assert p.max() == pytest.approx(belief.p.max(), rel=0.03)
    assert cells["alpha"].max() == 230


def test_a_tape_of_a_time_that_no_schema_can_say_is_exported(tmp_path: Path) -> None:
    later = tmp_path / "later.mcap"
    assert copy(GOLDEN, later, lambda envelopes: ((at + 2.0**32, envelope) for at, envelope in envelopes))
    assert call("tape", "export", later, tmp_path / "x.mcap") == 0


def test_a_mistake_is_one_line(exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="is there already"):
        call("tape", "export", GOLDEN, exported)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(UserError, match="needs the extra `foxglove`"):
        call("tape", "export", GOLDEN, tmp_path / "x.mcap")
