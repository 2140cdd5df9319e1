"""Bytes as a bounded msgpack map and back: the only place that uses msgpack.

It knows no message and loads neither NumPy nor pydantic, so that a health check and a link start quickly.
"""

import struct
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgpack

from blackboard.errors import Refused

VERSION = 1
MAX_BYTES = 1 << 20  # a 200 x 200 belief as float32 is 160 kB; anything near this bound is a mistake or an attack
MAX_TOTAL = 1 << 17  # items of all arrays and maps together
MAX_ITEMS = 1024  # the longest array or map, known or not, before any field is looked at
MAX_TEXT = 4096  # bytes of the longest text

WHOLE = 1 << 31  # a whole number from here on is no shorter as an integer
_SINGLE = struct.Struct(">f")
LARGEST_SINGLE = 3.4e38  # nearly the largest float32


def pack_map(fields: Mapping[str, Any], *, shortest: bool = False) -> bytes:
    """One msgpack map, with the version first.

    `shortest`: floats stand in the fewest bytes that read back as the same number, as integer, float32 or float64 (-0.0 as 0).
    """
    whole = {"version": VERSION, **fields}
    packed: bytes = _shortest(whole) if shortest else msgpack.packb(whole)
    return packed


def _shortest(value: Any) -> bytes:
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, dict):
        items = [_text(key) + _shortest(item) for key, item in value.items()]
        return _head(len(value), 0x80, 0xDE) + b"".join(items)
    if isinstance(value, (list, tuple)):
        return _head(len(value), 0x90, 0xDC) + b"".join(map(_shortest, value))
    packed: bytes = msgpack.packb(value)
    return packed


@lru_cache(maxsize=1024)  # the names of fields come again and again
def _text(key: str) -> bytes:
    packed: bytes = msgpack.packb(key)
    return packed


def _head(size: int, small: int, large: int) -> bytes:
    """The beginning of a map or an array; no message has one of more than 65535 items."""
    return bytes([small | size]) if size < 16 else struct.pack(">BH", large, size)


def _number(value: float) -> bytes:
    if value.is_integer() and abs(value) < WHOLE:  # an infinity and a NaN are no integers
        packed: bytes = msgpack.packb(int(value))
        return packed
    if abs(value) < LARGEST_SINGLE and _SINGLE.unpack(single := _SINGLE.pack(value))[0] == value:
        return b"\xca" + single
    return struct.pack(">Bd", 0xCB, value)


def unpack_map(payload: bytes) -> dict[str, Any]:
    """The fields of a message of this version, not yet looked at. Refused: "too-large", "not-msgpack", "version"."""
    if len(payload) > MAX_BYTES:
        raise Refused("too-large", f"{len(payload)} bytes; at most {MAX_BYTES} are taken")
    fields = _unpack(payload)
    version = fields.get("version")
    if type(version) is not int or version != VERSION:
        # it may be nested deeply
        told = str(version) if isinstance(version, int) else f"of type {type(version).__name__}"
        raise Refused("version", f"version {told:.40}; this process speaks {VERSION}")
    return fields


def _unpack(payload: bytes) -> dict[str, Any]:
    """One msgpack map with text keys, each once, and nothing behind it; bounded before anything is allocated."""
    # Each item takes a byte at least, so that a short payload cannot have too many.
    count = None if len(payload) <= MAX_TOTAL else _Counter()
    try:
        fields = msgpack.unpackb(
            payload,
            strict_map_key=True,
            object_pairs_hook=_map if count is None else lambda pairs: _map(count(pairs)),
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


class _Counter:
    """Counts the items of a payload, and raises ValueError where they are more than `MAX_TOTAL`."""

    def __init__(self) -> None:
        self.left = MAX_TOTAL

    def __call__(self, items: list[Any]) -> list[Any]:
        self.left -= 1 + len(items)
        if self.left < 0:
            raise ValueError(f"more than {MAX_TOTAL} items in all")
        return items


def _map(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    fields: dict[Any, Any] = dict(pairs)
    if len(fields) != len(pairs) or bytes in map(type, fields):  # a strict key of msgpack's is text or bytes
        raise ValueError("a key of a map is no text, or comes twice")
    return fields


def _no_extension(code: int, _: bytes) -> None:
    raise ValueError(f"extension type {code}")
