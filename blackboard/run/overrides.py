"""`--set`: keys of a scenario and the values that a command gives them. Pure."""

import tomllib
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from blackboard.config import Scenario
from blackboard.errors import UserError

Settings = Mapping[str, Any]  # key of a scenario, as "board.rule" -> its value


def parse_set(text: str) -> tuple[str, list[Any]]:
    """A key and its values of KEY=VALUE,VALUE, each as in TOML or a bare word. UserError: no key of a section, or no value."""
    key, equals, values = text.partition("=")
    parts = [part.strip() for part in _split(values)]
    if not equals or "" in (key.strip(), *parts):
        raise UserError(f"--set {text}: say KEY=VALUE,VALUE, as board.rule=cooperative,coalition")
    path_of(key)
    return key.strip(), [_value(part) for part in parts]


def path_of(key: str) -> list[str]:
    """The parts of a key, of which one may be quoted: board.subjects."object/ball".gate. UserError: it is no key of a section."""
    try:
        table: Any = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:
        table = {}
    path = []
    while isinstance(table, dict) and len(table) == 1:
        (name,) = table
        path.append(name)
        table = table[name]
    if len(path) < 2:
        raise UserError(f"--set {key.strip()}: no key of a section; say it as board.gate or world.vision.gain")
    return path


def with_settings(scenario: Scenario, settings: Settings) -> Scenario:
    """The scenario with some keys set. Another rule comes first and without the parameters of the rule it replaces."""
    if "board.rule" in settings:
        scenario = scenario.with_rule(str(settings["board.rule"]))
    tables = deepcopy(scenario.tables)
    for key, value in settings.items():
        *way, last = path_of(key)
        table = tables
        for name in way:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise UserError(f"--set {key}: {name} is no table in {scenario.where}")
        table[last] = value
    return Scenario(tables, scenario.where)


def _split(text: str) -> list[str]:
    """The parts between the commas that are in no bracket and no quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        depth += (character in "[{") - (character in "]}") if not quote else 0
        if character == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
