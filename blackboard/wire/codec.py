"""Messages as msgpack and back: the only place that uses msgpack. Bytes are a message or raise `Refused`, never anything else."""

from __future__ import annotations

from typing import Any, TypeVar

import msgpack
from pydantic import ValidationError

from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import MAX_BYTES, MAX_TOTAL, MODELS, VERSION
from blackboard.wire.mistakes import first_mistake
from blackboard.wire.types import MAX_ITEMS, Message

MAX_TEXT = 4096  # bytes of the longest text

M = TypeVar("M", bound=Message)


TEXT = frozenset({str})


def encode(message: Message) -> bytes:
    """A message as one msgpack map: the version first, fields in the order of the model, defaults left out."""
    fields = message.model_dump(exclude_defaults=True, exclude_none=True)
    packed: bytes = msgpack.packb({"version": message.version, **fields})
    return packed


def decode(model: type[M], payload: bytes) -> M:
    """The message in some bytes; raises `Refused` with the first of REASONS that applies.

    Numbers, text and bytes must come as such (an integer may stand for a float); unknown fields are ignored.
    """
    if len(payload) > MAX_BYTES:
        raise Refused("too-large", f"{len(payload)} bytes; at most {MAX_BYTES} are taken")
    fields = _unpack(payload)
    version = fields.get("version")
    if type(version) is not int or version != VERSION:
        raise Refused("version", f"version {version!r:.40}; this process speaks {VERSION}")
    try:
        return model.model_validate(fields, strict=True)
    except ValidationError as error:
        place, cure = first_mistake(error, model)
        field = ".".join(str(part) for part in (model.__name__, *place))
        raise Refused("fields", f"{field[:200]}: {cure[:200]}") from None


def open_envelope(envelope: Envelope) -> tuple[keys.Topic, dict[str, str], Message]:
    """The message in an envelope of kind PUT, with its topic and the parts of its key.

    Refused: "wild-key", what `decode` refuses, and "impostor" where the message names another sender or subject than its key.
    """
    found = keys.parse(envelope.key)
    model = MODELS.get(found[0].message) if found else None
    if found is None or model is None:
        raise Refused("wild-key", f"no message belongs on {envelope.key!r:.200}")
    topic, parts = found
    message = decode(model, envelope.payload)
    for name, in_key in {**parts, "level": topic.name}.items():
        in_message = getattr(message, name, in_key)
        if in_message != in_key:
            raise Refused("impostor", f"{name} {in_message!r} on the key {envelope.key}")
    return topic, parts, message


def _unpack(payload: bytes) -> dict[str, Any]:
    """One msgpack map with text keys, each once, and nothing behind it; bounded before anything is allocated."""
    left = MAX_TOTAL

    def count(items: list[Any]) -> list[Any]:
        nonlocal left
        left -= 1 + len(items)
        if left < 0:
            raise ValueError(f"more than {MAX_TOTAL} items in all")
        return items

    try:
        fields = msgpack.unpackb(
            payload,
            strict_map_key=True,
            object_pairs_hook=lambda pairs: _map(count(pairs)),
            list_hook=count,
            ext_hook=_no_extension,
            max_str_len=MAX_TEXT,
            max_bin_len=MAX_BYTES,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_ext_len=0,
        )
    except ValueError as error:  # every fault that msgpack finds, bad UTF-8 among them
        raise Refused("not-msgpack", str(error)[:200] or type(error).__name__) from None
    if not isinstance(fields, dict):
        raise Refused("not-msgpack", f"a {type(fields).__name__}, not a map")
    return fields


def _map(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    found: dict[Any, Any] = dict(pairs)
    if len(found) != len(pairs) or not set(map(type, found)) <= TEXT:
        raise ValueError("a key of a map is no text, or comes twice")
    return found


def _no_extension(code: int, _: bytes) -> None:
    raise ValueError(f"extension type {code}")
