"""What is wrong with the fields of a model, in words for people: what may be given, and the nearest name. Pure.

The words come from the model's own schema, so they are those of docs/scenario.md too. pydantic's messages are never shown.
"""

import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from blackboard.errors import nearest as nearest  # noqa: PLC0414  # where those look for it who tell mistakes of models
from blackboard.wire.names import NAME, SUBJECT_KINDS

Schema = Mapping[str, Any]
KEY = "[key]"  # how pydantic calls the name of an entry in the place of a fault
SHOWN = 80  # characters of a value that is wrong
OWN = ("value_error", "assertion_error")  # faults that our own validators name, in their own words


@cache
def schema_of(model: type[BaseModel]) -> Schema:
    """A model's JSON schema; made once, so that garbage costs little."""
    return model.model_json_schema()


def first_mistake(error: ValidationError, model: type[BaseModel], below: int = 0) -> tuple[tuple[str | int, ...], str]:
    """Where in a model the first fault of a validation is, and what to do about it, with the value that was given.

    The model's fields begin after so many steps of the place that the error names.
    """
    fault = error.errors(include_url=False)[0]
    place, root = tuple(fault["loc"][below:]), schema_of(model)
    if fault["type"] == "extra_forbidden":
        return place, no_such_key(str(place[-1]), properties(_at(root, place[:-1]), root))
    if fault["type"] in OWN:
        return place, f"{fault['ctx']['error']} (got {_shown(fault['input'])})"
    schema = _at(root, place)
    if fault["type"] == "missing":
        return place, f"is missing; give {allowed(schema, root)}"
    near = nearest(fault["input"], _choices(schema, root))
    return place, f"give {allowed(schema, root)}{near} (got {_shown(fault['input'])})"


def no_such_key(key: str, known: Iterable[str]) -> str:
    """What is said of an unknown key: the nearest one, and all that there are."""
    names = sorted(known)
    return f"no such key{nearest(key, names)}; known are {', '.join(names)}"


def allowed(schema: Schema, root: Schema) -> str:
    """What a schema takes, as `a number above 0`; `root` is the schema that has its definitions."""
    schema = resolved(schema, root)
    if "const" in schema or "enum" in schema:
        return _one_of([_quoted(value) for value in schema.get("enum", [schema.get("const")])])
    if "anyOf" in schema or "oneOf" in schema:
        some = [one for one in schema.get("anyOf", schema.get("oneOf")) if one.get("type") != "null"]
        return _one_of(list(dict.fromkeys(allowed(one, root) for one in some)))
    kind = schema.get("type")
    if kind in ("number", "integer"):
        return " ".join(["a whole number" if kind == "integer" else "a number", *_bounds(schema)])
    if kind == "array":
        return _array(schema, root)
    most = f" of at most {schema['maxProperties']} keys" if "maxProperties" in schema else ""
    words = {"string": _text(schema), "boolean": "true or false", "object": f"a table{most}"}
    return words.get(str(kind), "another value")


def properties(schema: Schema, root: Schema) -> Mapping[str, Schema]:
    """The keys of a table."""
    properties: Mapping[str, Schema] = resolved(schema, root).get("properties", {})
    return properties


def resolved(schema: Schema, root: Schema) -> Schema:
    """A schema that is not a reference, and not merely optional."""
    if "$ref" in schema:
        return resolved(root["$defs"][schema["$ref"].rsplit("/", 1)[1]], root)
    some = [one for one in schema.get("anyOf", []) if one.get("type") != "null"]
    return resolved(some[0], root) if len(some) == 1 else schema


def _at(root: Schema, place: Sequence[str | int]) -> Schema:
    """The schema of the field at a place. What is below a choice of several is not followed: the choice itself is reported."""
    if place[-1:] == (KEY,):  # the name of an entry, which stands before it
        names = list(resolved(_at(root, place[:-2]), root).get("patternProperties", {}))
        return {"type": "string", "pattern": names[0]} if names else {"type": "string"}
    schema: Schema = root
    for part in place:
        schema = resolved(schema, root)
        if isinstance(part, int):
            inner = [*schema.get("prefixItems", []), *([schema["items"]] if "items" in schema else [])]
            schema = inner[min(part, len(inner) - 1)] if inner else schema
        else:
            schema = _entry(schema, part)
    return schema


def _entry(schema: Schema, name: str) -> Schema:
    """The schema of a table's entry; the table's own where it has none of this name."""
    if name in schema.get("properties", {}):
        return schema["properties"][name]  # type: ignore[no-any-return]
    others = [*schema.get("patternProperties", {}).values(), schema.get("additionalProperties")]
    return next((other for other in others if isinstance(other, dict)), schema)


def _choices(schema: Schema, root: Schema) -> list[str]:
    return [value for value in resolved(schema, root).get("enum", []) if isinstance(value, str)]


def _bounds(schema: Schema) -> list[str]:
    limits = {"exclusiveMinimum": "above", "minimum": "of at least", "exclusiveMaximum": "below", "maximum": "at most"}
    told = [f"{word} {schema[key]:g}" for key, word in limits.items() if key in schema]
    if "minimum" in schema and "maximum" in schema:
        return [f"from {schema['minimum']:g} to {schema['maximum']:g}"]
    return [" and ".join(told)] if told else []


def _array(schema: Schema, root: Schema) -> str:
    if "prefixItems" in schema:
        each = list(dict.fromkeys(allowed(one, root) for one in schema["prefixItems"]))
        return f"a list of {len(schema['prefixItems'])}, each {_one_of(each)}"
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    size = "" if most is None else f" of at most {most}"
    if least and most is not None:
        size = f" of {most}" if least == most else f" of {least} to {most}"
    return f"a list{size}, each {allowed(schema['items'], root)}" if schema.get("items") else f"a list{size}"


def _text(schema: Schema) -> str:
    pattern = str(schema.get("pattern", "")).strip("^$")
    if pattern == NAME:
        return "a name of up to 64 letters, digits, '.', '_' and '-'"
    if SUBJECT_KINDS in pattern:
        wild = ', or with * as "object/*"' if "*" in pattern.replace(NAME, "") else ""
        return f'a subject as "robot/r1" ({SUBJECT_KINDS.replace("|", ", ")}){wild}'
    return f"a text of at most {schema['maxLength']} characters" if "maxLength" in schema else "a text"


def _quoted(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


def _one_of(some: Sequence[str]) -> str:
    return some[0] if len(some) == 1 else f"{', '.join(some[:-1])} or {some[-1]}"


class _Short(reprlib.Repr):
    """A value as text, made of its first parts only, so that much garbage costs little."""

    def repr_bytes(self, value: bytes, level: int) -> str:
        return f"{len(value)} bytes"


def _shown(value: object) -> str:
    short = _Short()
    short.maxstring = short.maxother = SHOWN
    text = re.sub(r"\s+", " ", short.repr(value))
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
