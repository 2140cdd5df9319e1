"""The reference of the wire: the keys, every message with its fields, and why one is refused, made from the models.

docs/messages.md is what `python -m blackboard.run.messages` prints. A field's own docstring says what it means, and its type stands in
the model's schema.
"""

import inspect
from collections.abc import Iterator
from typing import Any

from blackboard.run.reference import cell, meaning_of
from blackboard.wire import keys
from blackboard.wire.messages import MODELS, REASONS
from blackboard.wire.mistakes import Schema, schema_of
from blackboard.wire.names import SUBJECT_KINDS
from blackboard.wire.types import LARGEST, LEAST, Part

HEAD = """# Messages

Made by `python -m blackboard.run.messages`. [wire.md](wire.md) says how messages travel, what the types mean, and how a tick goes.

## Keys

[wire.md](wire.md#keys) says what the columns mean.

"""
COLUMNS = "| field | type | default | meaning |\n|---|---|---|---|"
REFUSED = "## What is refused\n\n| reason | why |\n|---|---|"
TICKS = 1 << 53  # the bound of `types.Tick`, by which its schema is known


def page() -> str:
    """The whole reference: the keys, each message with the parts that it is first to have, and the reasons."""
    done = set[str]()
    parts = [HEAD + keys.table() + "\n"]
    for model in MODELS.values():
        parts += _sections(model, "##", done)
    return "\n".join([*parts, REFUSED, *(f"| `{name}` | {text} |" for name, text in REASONS.items())]) + "\n"


def _sections(model: type[Part], level: str, done: set[str]) -> Iterator[str]:
    if model.__name__ in done:
        return
    done.add(model.__name__)
    rows = [f"| {' | '.join(_cells(model, name))} |" for name in model.model_fields]
    yield "\n".join([f"{level} {model.__name__}\n\n{inspect.cleandoc(model.__doc__ or '')}\n\n{COLUMNS}", *rows, ""])
    for part in _parts(model):
        yield from _sections(part, "###", done)


def _cells(model: type[Part], name: str) -> list[str]:
    _, meaning = meaning_of(model, name)
    kind = _kind(schema_of(model)["properties"][name])
    return [f"`{name}`", cell(kind), _default(model, name), cell(" ".join(meaning.split()))]


def _parts(model: type[Part]) -> Iterator[type[Part]]:
    """The models that its fields are made of."""
    waiting: list[Any] = [field.annotation for field in model.model_fields.values()]
    while waiting:
        one = waiting.pop(0)
        if isinstance(one, type) and issubclass(one, Part):
            yield one
        waiting += getattr(one, "__args__", ())


def _default(model: type[Part], name: str) -> str:
    field = model.model_fields[name]
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"{value:g}" if isinstance(value, int | float) else f"`{value!r}`".replace("()", "[]")


def _kind(schema: Schema) -> str:
    """What a schema takes, in the words of docs/wire.md."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(_kind(one) for one in schema["anyOf"] if one.get("type") != "null"))
    if "const" in schema:
        return f"{schema['type']} {schema['const']}"
    if "enum" in schema:
        return " or ".join(f'`"{one}"`' for one in schema["enum"])
    makers = {"number": _number, "integer": _whole, "string": _text, "array": _array, "object": _map}
    return makers[schema["type"]](schema) if schema["type"] in makers else str(schema["type"])


def _number(schema: Schema) -> str:
    if schema["maximum"] < LARGEST:
        return "float" + _span(schema, "minimum", "maximum")
    return "float" + {LEAST: " > 0", 0: " >= 0"}.get(schema.get("minimum", LEAST), "")


def _whole(schema: Schema) -> str:
    if schema.get("exclusiveMaximum") == TICKS:
        return "tick"
    return "integer" + _span(schema, "minimum", "maximum")


def _text(schema: Schema) -> str:
    if "pattern" in schema:
        return _name(schema["pattern"])
    return ("bytes" if schema.get("format") == "binary" else "text") + _span(schema, "minLength", "maxLength")


def _array(schema: Schema) -> str:
    if "prefixItems" in schema:
        return f"({', '.join(_kind(one) for one in schema['prefixItems'])})"
    return f"array{_span(schema, 'minItems', 'maxItems')} of {_kind(schema['items'])}"


def _map(schema: Schema) -> str:
    patterns = schema.get("patternProperties", {})
    key = "text" if not patterns else _name(next(iter(patterns)))
    inner = next(iter(patterns.values()), schema.get("additionalProperties", {}))
    return f"map{_span(schema, 'minProperties', 'maxProperties')} of {key} to {_kind(inner)}"


def _name(pattern: str) -> str:
    return "subject" if SUBJECT_KINDS in pattern else "name"


def _span(schema: Schema, least: str, most: str) -> str:
    """The bounds of a length or a whole number, in brackets; empty where there is none."""
    low, high = schema.get(least), schema.get(most)
    if high is None:
        return "" if low is None else f" >= {low}"
    return f" ({f'{low} to' if low is not None else 'at most'} {high})" if low != high else f" ({high})"


if __name__ == "__main__":
    print(page(), end="")
