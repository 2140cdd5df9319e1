"""Whatever the bytes are, they are a message or are refused: random bytes, objects and changes."""

import copy
from typing import Any

import msgpack
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import Refused
from blackboard.wire.codec import decode, encode
from blackboard.wire.messages import MODELS, REASONS
from blackboard.wire.types import Message
from tests.wire.messages import EXAMPLES, as_map

ALL = [message for _, message in EXAMPLES.values()]
models = st.sampled_from(sorted(MODELS.values(), key=lambda model: model.__name__))
scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(1 << 63), (1 << 64) - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=8)
)
names = st.sampled_from(sorted({name for model in MODELS.values() for name in model.model_fields}))
objects = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3), max_leaves=6
)


def a_message_or_refused(model: type[Message], payload: bytes) -> None:
    try:
        result: Message | str = decode(model, payload)
    except Refused as refusal:
        result = refusal.reason
    assert result in REASONS if isinstance(result, str) else decode(model, encode(result)) is not None


@given(model=models, payload=st.binary(max_size=200))
def test_random_bytes(model: type[Message], payload: bytes) -> None:
    a_message_or_refused(model, payload)


@given(model=models, fields=objects, version=st.just({}) | st.just({"version": 1}))
def test_random_objects(model: type[Message], fields: Any, version: dict[str, int]) -> None:
    a_message_or_refused(model, msgpack.packb({**fields, **version} if isinstance(fields, dict) else fields))


@given(message=st.sampled_from(ALL), where=st.integers(0, 1 << 20), byte=st.integers(0, 255))
def test_one_byte_changed(message: Message, where: int, byte: int) -> None:
    payload = bytearray(encode(message))
    payload[where % len(payload)] = byte
    a_message_or_refused(type(message), bytes(payload))


@given(message=st.sampled_from(ALL), path=st.lists(st.integers(0, 30), max_size=4), value=objects)
def test_one_value_changed(message: Message, path: list[int], value: Any) -> None:
    fields = as_map(message)
    place: Any = fields
    for step in path:
        branches = [v for v in (place.values() if isinstance(place, dict) else place) if isinstance(v, dict | list)]
        place = branches[step % len(branches)] if branches else place
    name = None
    if isinstance(place, dict) and place:
        name = sorted(place)[len(path) % len(place)]
    elif place:
        name = len(path) % len(place)
    if name is not None:
        place[name] = copy.deepcopy(value)
    a_message_or_refused(type(message), msgpack.packb(fields))
