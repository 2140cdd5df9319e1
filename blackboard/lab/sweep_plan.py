"""The runs of a sweep: every combination of some settings with every seed, as scenarios. Pure."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from blackboard.config import Scenario
from blackboard.errors import UserError

MOST = 100_000  # runs
Settings = Mapping[str, Any]  # key of a scenario, as "board.rule" -> its value in one combination


@dataclass(frozen=True)
class Planned:
    """One run: its combination by number, the seed, and the scenario with both."""

    combination: int
    settings: Settings
    seed: int
    scenario: Scenario

    @property
    def key(self) -> str:
        """What makes this run this run: a hash of the whole scenario."""
        return hashlib.sha256(json.dumps(self.scenario.tables, sort_keys=True).encode()).hexdigest()


def plan(scenario: Scenario, seeds: Sequence[int], sets: Sequence[str]) -> list[Planned]:
    """All runs, seed by seed, so that those that are done first compare all combinations. UserError: a setting is wrong."""
    choices = [parse_set(text) for text in sets]
    twice = [key for number, (key, _) in enumerate(choices) if key in [other for other, _ in choices[:number]]]
    if twice:
        raise UserError(f"--set {twice[0]}: given twice; give all values at once, as {twice[0]}=A,B")
    found = [
        dict(zip([key for key, _ in choices], values, strict=True))
        for values in itertools.product(*(values for _, values in choices))
    ]
    if len(found) * len(seeds) > MOST:
        raise UserError(f"--set, --seeds: {len(found) * len(seeds)} runs; at most {MOST}")
    scenarios = [with_settings(scenario, settings) for settings in found]
    return [
        Planned(number, settings, seed, one.changed("world", seed=seed))
        for seed in seeds
        for number, (settings, one) in enumerate(zip(found, scenarios, strict=True))
    ]


def parse_seeds(text: str) -> list[int]:
    """Seeds as `1..20`, `3`, or several of these with commas, each once and sorted. UserError: something else."""
    found = set[int]()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:\.\.(\d{1,9}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first or last - first >= MOST:
            raise UserError(f"--seeds {text}: give numbers and ranges, as 1..20 or 1,5,9")
        found |= set(range(first, last + 1))
    return sorted(found)


def parse_set(text: str) -> tuple[str, list[Any]]:
    """A key and its values of KEY=VALUE,VALUE, each as in TOML or a bare word. UserError: no key, no value, or the seed."""
    key, equals, values = text.partition("=")
    parts = [part.strip() for part in _split(values)]
    if not equals or "" in (key.strip(), *parts):
        raise UserError(f"--set {text}: say KEY=VALUE,VALUE, as board.rule=cooperative,coalition")
    if path_of(key) == ["world", "seed"]:  # each run has one of --seeds
        raise UserError(f"--set {text}: the seeds are --seeds, as --seeds {values.strip()}")
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


def label(settings: Settings) -> str:
    """A combination as text; "as it is" where nothing is set."""
    return " ".join(f"{key}={value}" for key, value in settings.items()) or "as it is"


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
