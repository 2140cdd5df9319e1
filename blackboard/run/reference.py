"""The reference of scenario keys: a Markdown table for each section, made from the models. docs/scenario.md is this text.

A field's own docstring says what it means, and begins with its unit in brackets where it has one: "[s] Length of a tick." What
may be given comes from the model's schema, in the words of error messages.
"""

import ast
import dataclasses
import inspect
import json
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from blackboard.opinion import rules
from blackboard.opinion.rules import Rule, bounds_in_words
from blackboard.wire.mistakes import allowed, schema_of

HEAD = """# Scenario keys

Made by `blackboard scenario`, which also takes the name of a section, as `blackboard scenario world`. A scenario is a TOML file; every
table and key may be left out, and then has the default that stands here. A key that is not here is an error. *unit* in the column of
units is `[grid] unit`. Complete examples are in `sim_world/scenarios/`.
"""
COLUMNS = "| key | default | unit | may be | meaning |\n|---|---|---|---|---|"
RULES = """## Rules

The parameters of a rule stand in `[board]` beside `rule`, and in `[board.subjects."object/ball"]` (or `"object/*"`) for some subjects
alone. Rules of your own: [rules.md](rules.md#a-rule-of-your-own).

| rule | key | default | unit | may be | meaning |
|---|---|---|---|---|---|"""


def page(sections: Mapping[str, type[BaseModel]], kinds: Mapping[str, type[BaseModel]]) -> str:
    """The whole reference: `name`, each section by its name with its tables, the rules, and each kind of [[fault]]."""
    parts = [HEAD, "`name` is the name of the scenario, a text.\n"]
    parts += [section(name, model) for name, model in sections.items()]
    parts += [RULES + "\n" + "\n".join(_rules()) + "\n", faults(kinds)]
    return "\n".join(parts)


def section(name: str, model: type[BaseModel]) -> str:
    return "\n".join(_tables(name, model))


def faults(kinds: Mapping[str, type[BaseModel]]) -> str:
    """The tables [[fault]]: what all kinds have, then each kind's own keys."""
    text = "What is wrong with some robots, and when: as many tables [[fault]] as wanted, each of one `kind`. All of them have:"
    models = list(kinds.values())
    shared = [key for key in models[0].model_fields if all(key in model.model_fields for model in models)]
    lines = [f"## fault\n\n{text}\n\n{COLUMNS}", *_rows(models[0], [key for key in shared if key != "kind"]), ""]
    for kind, model in kinds.items():
        own = ["kind", *(key for key in model.model_fields if key not in shared)]
        lines += [f"### fault: {kind}\n\n{_about(model)}\n\n{COLUMNS}", *_rows(model, own), ""]
    return "\n".join(lines)


def _tables(name: str, model: type[BaseModel]) -> Iterator[str]:
    yield f"{'###' if '.' in name else '##'} {name}\n\n{_about(model)}\n\n{COLUMNS}"
    yield from _rows(model, model.model_fields)
    yield ""
    for key, field in model.model_fields.items():
        table = _table_in(field.annotation)
        if table is not None:
            yield from _tables(f"{name}.{key}{'.NAME' if 'dict' in str(field.annotation) else ''}", table)


def _about(model: type[BaseModel]) -> str:
    """The first paragraph of a model's docstring, on one line."""
    return inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].replace("\n", " ")


def _rows(model: type[BaseModel], keys: Iterable[str]) -> Iterator[str]:
    root = schema_of(model)
    for key in keys:
        field = model.model_fields[key]
        unit, meaning = meaning_of(model, key)
        what = "a table, see below" if _table_in(field.annotation) else allowed(root["properties"][key], root)
        yield f"| `{key}` | {_default(field)} | {unit or '-'} | {cell(what)} | {cell(meaning)} |"


def _rules() -> Iterator[str]:
    for name in rules.registered():
        cls = rules.find(name)
        for own in dataclasses.fields(cls):  # type: ignore[arg-type]  # every rule is a dataclass
            unit, meaning = meaning_of(cls, own.name)
            shown = own.default
            if own.default_factory is not dataclasses.MISSING:
                made = own.default_factory()
                shown = made.name if isinstance(made, Rule) else made
            inner = own.type == "Rule"
            what = "a rule" if inner else bounds_in_words(own)
            yield f"| `{name}` | `{own.name}` | {_value(shown)} | {unit or '-'} | {cell(what)} | {cell(meaning)} |"
        if not dataclasses.fields(cls):  # type: ignore[arg-type]
            yield f"| `{name}` | - | - | - | - | no parameters |"


def meaning_of(cls: type, name: str) -> tuple[str, str]:
    """The unit and the meaning of a field, from the docstring below it, in the class or one that it comes from."""
    for one in cls.__mro__:
        text = _docstrings(one).get(name)
        if text is not None:
            unit, bracket, meaning = text[1:].partition("] ") if text.startswith("[") else ("", "", text)
            return (unit, meaning) if bracket else ("", text)
    return "", ""


@cache
def _docstrings(cls: type) -> dict[str, str]:
    """The texts that stand below the fields of a class; empty for one without source."""
    try:
        body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    except (OSError, TypeError):
        return {}
    docstrings = dict[str, str]()
    statements = body.body if isinstance(body, ast.ClassDef) else []
    for field, below in pairwise(statements):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
            text = below.value.value if isinstance(below.value, ast.Constant) else None
            docstrings |= {field.target.id: text} if isinstance(text, str) else {}
    return docstrings


def _table_in(annotation: Any) -> type[BaseModel] | None:
    """The model of a field that is a table, or a dictionary of tables."""
    some = [annotation, *get_args(annotation)]
    return next((one for one in some if isinstance(one, type) and issubclass(one, BaseModel)), None)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return "as below"
    if isinstance(value, dict) and any(isinstance(inner, BaseModel) for inner in value.values()):
        changed = {k: v.model_dump(exclude_defaults=True) if isinstance(v, BaseModel) else v for k, v in value.items()}
        return f"`{_toml(changed)}`"
    return _value(value)


def _value(value: object) -> str:
    return "-" if value is None else f"`{_toml(value)}`"


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_toml(item)}" for key, item in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)


def cell(text: str) -> str:
    """A text as it may stand in a table."""
    return text.replace("|", "\\|")
