"""The belief coding: its error bound, its fixed point, and everything hostile that can stand in its fields."""

import math
import tracemalloc
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import OpinionError, Refused
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.arrays import SCALES, STEP, pack, unpack
from blackboard.wire.levels import KIND, Coding, read, written
from blackboard.wire.messages import MAX_CELLS, PackedBelief, PackedGrid
from tests.wire.beliefs import KINDS, belief_of, beliefs

GRID = Grid((6, 4))
CODINGS = st.sampled_from(["log8", "log16"])


def slow_reader(packed: PackedBelief) -> Array:
    """What docs/wire.md says, cell by cell: the oracle of `unpack` for levels."""
    levels = (slow_levels if packed.coding == "log8" else slow_fine_levels)(zlib.decompress(packed.data), packed.box)
    weights = np.zeros(packed.grid.shape)
    for cell, level in zip(np.ndindex(*packed.box), levels, strict=True):
        weights[tuple(np.add(packed.lo, cell))] = math.exp((level - max(levels)) * packed.step) if level else 0.0
    total, left = math.fsum(weights.ravel()), int((weights == 0).sum())
    return np.where(weights > 0, weights / total * (1 - packed.rest), packed.rest / left if left else 0.0)


def slow_levels(differences: bytes, box: tuple[int, ...]) -> list[int]:
    assert len(differences) == math.prod(box)
    return [sum(differences[: i + 1]) % 256 for i in range(len(differences))]


def slow_fine_levels(numbers: bytes, box: tuple[int, ...]) -> list[int]:
    size = math.prod(box)
    assert len(numbers) in (size, 2 * size)
    levels, difference, level = [], 0, 0
    for i in range(size):
        n = numbers[i] + (256 * numbers[size + i] if len(numbers) > size else 0)
        difference += n // 2 if n % 2 == 0 else -(n + 1) // 2
        level = (level + difference) % 65536
        levels.append(level)
    return levels


def f32(mass: Array, rest: float = 0.0) -> PackedBelief:
    """What the simplest client sends: the whole grid as float32."""
    grid = PackedGrid(shape=mass.shape, origin=(0.0,) * mass.ndim, cell=1.0)
    data = mass.astype("<f4").tobytes()
    return PackedBelief(grid=grid, lo=(0,) * mass.ndim, box=mass.shape, coding="f32", rest=rest, data=data)


# --- laws --------------------------------------------------------------------------------------------------------------


@given(belief=beliefs(), coding=CODINGS)
def test_the_stated_error_bound_holds(belief: Belief, coding: Coding) -> None:
    scale = SCALES[coding]
    p, least = unpack(pack(belief, coding), belief.grid).p, math.exp((0.5 - scale.top) * scale.step)
    out = belief.p < belief.p.max() * least * (1 - 1e-12)
    kept = belief.p > belief.p.max() * least * (1 + 1e-12)
    assert least < 3.1e-6
    assert np.abs(np.log(p[kept] / belief.p[kept])).max() <= scale.step + 1e-6
    assert 0.5 * np.abs(p - belief.p).sum() <= scale.step / 4 + belief.p[~kept].sum() + 1e-6
    assert np.unique(p[out]).size <= 1  # one even floor
    assert p.min() >= 0
    assert math.fsum(p.ravel()) == pytest.approx(1.0, abs=1e-14)
    if not belief.p[~kept].any():
        assert not p[~kept].any()  # true zeros stay


@given(belief=beliefs(), coding=CODINGS)
def test_a_belief_that_came_from_pack_comes_back_to_the_bit(belief: Belief, coding: Coding) -> None:
    once = pack(belief, coding)
    read = unpack(once, belief.grid)
    assert pack(read, coding) == once
    np.testing.assert_array_equal(unpack(pack(read, coding)).p, read.p)


@given(belief=beliefs(), coding=CODINGS)
def test_unpack_does_what_the_document_says(belief: Belief, coding: Coding) -> None:
    packed = pack(belief, coding)
    np.testing.assert_allclose(unpack(packed).p, slow_reader(packed), rtol=1e-12, atol=0)


@given(
    sigma=st.floats(1.0, 20.0),
    ratio=st.floats(0.3, 1.0),
    turn=st.floats(0.0, math.pi),
    place=st.tuples(st.floats(20.0, 80.0), st.floats(20.0, 80.0)),
)
def test_of_any_gaussian_fine_levels_lose_less_than_a_ten_thousandth_of_a_nat(
    sigma: float, ratio: float, turn: float, place: tuple[float, float]
) -> None:
    c, s = math.cos(turn), math.sin(turn)
    axes = np.array([[c, -s], [s, c]])
    belief = Belief.from_gaussian(Grid((100, 100)), place, axes @ np.diag([sigma**2, (ratio * sigma) ** 2]) @ axes.T)
    assert kullback_leibler(belief.p, unpack(pack(belief, "log16")).p) < 1e-4


@given(st.data())
def test_any_levels_come_back(data: st.DataObject) -> None:
    coding: Coding = data.draw(CODINGS)
    kind = KIND[coding]
    level = st.integers(0, int(np.iinfo(kind).max)) | st.sampled_from([0, 1, 255])
    levels = np.array(data.draw(st.lists(level, min_size=1, max_size=60)), dtype=kind)
    np.testing.assert_array_equal(read(written(levels), len(levels), coding), levels)


@pytest.mark.parametrize("kind", KINDS)
def test_float32_is_read_as_well(kind: str) -> None:
    belief = belief_of(kind, Grid((9, 11)), np.random.default_rng(5))
    p = unpack(f32(belief.p), belief.grid).p
    np.testing.assert_allclose(p, belief.p, rtol=1e-6, atol=1e-37)
    assert math.fsum(p.ravel()) == pytest.approx(1.0, abs=1e-14)


# --- single cases ------------------------------------------------------------------------------------------------------


def test_the_box_is_cropped_to_the_support_and_the_grid_travels_along() -> None:
    grid = Grid((200, 100, 3), 0.5, (-3.0, 4.0, 0.25), "m")
    packed = pack(gaussian(grid, (10.0, 20.0, 1.0), (1.0, 2.0, 0.3)))
    assert all(n < m for n, m in zip(packed.box[:2], grid.shape[:2], strict=True))
    assert unpack(packed).grid == grid


def test_a_flat_belief_is_flat_again_to_the_bit() -> None:
    np.testing.assert_array_equal(unpack(pack(uniform(Grid((50, 50))))).p, np.full((50, 50), 1 / 2500))


def test_float32_need_not_be_normalised_and_its_zeros_share_the_rest() -> None:
    p = unpack(f32(np.array([[0.0, 3.0], [9.0, 0.0]]), rest=0.2)).p
    np.testing.assert_allclose(p, [[0.1, 0.2], [0.6, 0.1]], rtol=1e-15)


@pytest.mark.parametrize("rest", [1.0, 0.5])
def test_nothing_kept_means_that_nothing_is_known(rest: float) -> None:
    np.testing.assert_allclose(unpack(f32(np.zeros((2, 4)), rest=rest)).p, np.full((2, 4), 1 / 8))


@pytest.mark.parametrize("value", [math.nan, math.inf, -1e-9])
def test_a_belief_of_ours_that_is_none_is_our_fault(value: float) -> None:
    p = np.full(GRID.shape, 1 / 24)
    p[2, 1] = value
    with pytest.raises(OpinionError, match="a belief to pack"):
        pack(Belief(GRID, p))


# --- hostile -----------------------------------------------------------------------------------------------------------

GOOD = pack(gaussian(GRID, (2.0, 2.0), 0.4))  # with a rest
DATA = np.diff(np.arange(1, 25, dtype=np.uint8), prepend=np.uint8(0)).tobytes()  # levels 1 to 24 on the whole grid
WHOLE: dict[str, Any] = {"lo": (0, 0), "box": (6, 4), "rest": 0.0, "data": zlib.compress(DATA)}
FINE: dict[str, Any] = {**WHOLE, "coding": "log16", "data": written(np.arange(1, 25, dtype=np.uint16) ** 3)}
BOMB = zlib.compress(bytes(1 << 25), 9)
NAN, INF = math.nan, math.inf


def grid_of(**changes: Any) -> dict[str, Any]:
    return {"grid": PackedGrid(**{**GOOD.grid.model_dump(), **changes})}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        *[({"step": step}, "fields") for step in (NAN, INF, -INF, -0.05, 0.0, 1e300, 1.1)],
        *[({"rest": rest}, "mass") for rest in (NAN, INF, -INF, -1e-9, 1.0 + 1e-9, 1e300)],
        ({**WHOLE, "rest": 0.1}, "mass"),  # nowhere to spread it
        ({**WHOLE, "data": zlib.compress(bytes(24))}, "mass"),  # nothing at all
        ({"lo": (0,)}, "fields"),
        ({"box": (1, 1, 1)}, "fields"),
        ({"lo": (-1, 0)}, "fields"),
        ({**WHOLE, "lo": (1, 0)}, "fields"),
        ({**WHOLE, "box": (6, 1 << 62)}, "fields"),
        ({**WHOLE, "lo": (1 << 62, 0)}, "fields"),
        ({**WHOLE, "data": b""}, "fields"),
        ({**WHOLE, "data": DATA}, "fields"),  # not compressed
        ({**WHOLE, "data": WHOLE["data"][:-1]}, "fields"),  # cut off
        ({**WHOLE, "data": WHOLE["data"] + b"x"}, "fields"),  # trailing garbage
        ({**WHOLE, "data": zlib.compress(DATA[:-1])}, "fields"),
        ({**WHOLE, "data": zlib.compress(DATA + b"x")}, "fields"),
        ({**WHOLE, "data": BOMB}, "fields"),
        (grid_of(origin=(0.0,)), "fields"),
        (grid_of(shape=(6,)), "fields"),
        (grid_of(shape=(MAX_CELLS, MAX_CELLS, MAX_CELLS)), "fields"),
        (grid_of(shape=(MAX_CELLS, 4)), "fields"),
        (grid_of(shape=(7, 4)), "grid"),
        (grid_of(cell=2.0), "grid"),
        (grid_of(origin=(0.0, 1e-9)), "grid"),
        (grid_of(unit="m"), "grid"),
        *[({"coding": "log16", "step": step}, "fields") for step in (NAN, INF, -0.05, 0.0, 1.1)],
        *[({**FINE, "data": zlib.compress(bytes(size))}, "fields") for size in (0, 23, 25, 47, 49, 1 << 20)],
        ({**FINE, "data": zlib.compress(bytes(48))}, "mass"),  # nothing at all
        ({**FINE, "data": BOMB}, "fields"),
        ({**FINE, "data": FINE["data"][:-1]}, "fields"),  # cut off
        ({**FINE, "rest": 0.1}, "mass"),  # nowhere to spread it
        ({"coding": "f32", "data": b"1234"}, "fields"),
        ({**WHOLE, "coding": "f32", "data": np.full(24, NAN, "<f4").tobytes()}, "mass"),
        ({**WHOLE, "coding": "f32", "data": np.full(24, INF, "<f4").tobytes()}, "mass"),
        ({**WHOLE, "coding": "f32", "data": np.full(24, -1e-40, "<f4").tobytes()}, "mass"),
        ({**WHOLE, "coding": "f32", "data": bytes(96)}, "mass"),
        ({**WHOLE, "coding": "f32", "data": b"\1\0\x80\x7f" * 24}, "mass"),  # signalling NaN
    ],
)
def test_hostile_numbers_are_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(Refused, match=f"^{reason}:"):
        unpack(GOOD.model_copy(update=changes), GRID)


@pytest.mark.parametrize("coding", ["log8", "log16"])
def test_a_bomb_is_never_inflated(coding: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(Refused, match="inflate"):
            unpack(GOOD.model_copy(update={**WHOLE, "coding": coding, "data": BOMB}), GRID)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("step", [1e-9, 1.0])
def test_the_widest_range_of_levels_is_still_a_belief(step: float) -> None:
    levels = np.where(np.arange(24) % 2, 65535, 1).astype(np.uint16)
    p = unpack(GOOD.model_copy(update={**FINE, "step": step, "data": written(levels)}), GRID).p
    assert math.fsum(p.ravel()) == pytest.approx(1.0, abs=1e-14)
    assert p.min() >= 0


def test_the_largest_grid_costs_a_few_times_its_own_size() -> None:
    packed = PackedBelief(
        grid=PackedGrid(shape=(MAX_CELLS,), cell=1.0, origin=(0.0,)),
        lo=(0,),
        box=(MAX_CELLS,),
        step=STEP,
        data=zlib.compress(b"\x07" * MAX_CELLS),
    )
    tracemalloc.start()
    try:
        assert unpack(packed).p.size == MAX_CELLS
        assert tracemalloc.get_traced_memory()[1] < 4 * 8 * MAX_CELLS
    finally:
        tracemalloc.stop()


numbers = st.floats() | st.floats(0, 1)
corners = st.tuples(st.integers(-1, 6), st.integers(-1, 4)) | st.tuples(st.integers(0, 1 << 62))


@given(
    lo=corners,
    box=st.just((6, 4)) | corners,
    coding=st.sampled_from(["log8", "log16", "f32"]),
    step=numbers,
    rest=numbers | st.just(0.0),
    data=st.binary(max_size=120) | st.binary(min_size=24, max_size=24).map(zlib.compress) | st.binary(min_size=96),
)
def test_any_fields_are_a_belief_or_refused(**fields: Any) -> None:
    try:
        belief = unpack(GOOD.model_copy(update=fields), GRID)
    except Refused:
        return
    assert belief.p.shape == GRID.shape
    assert belief.p.min() >= 0
    assert math.fsum(belief.p.ravel()) == pytest.approx(1.0, abs=1e-13)
