"""The runs of a sweep: every combination of some settings with every seed, as scenarios. Pure."""

import hashlib
import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.run.overrides import Settings, parse_set, path_of, with_settings

MOST = 100_000  # runs


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
    for key, values in choices:
        if path_of(key) == ["world", "seed"]:  # each run has one of --seeds
            given = ",".join(map(str, values))
            raise UserError(f"--set {key}={given}: the seeds are --seeds, as --seeds {given}")
    twice = [key for number, (key, _) in enumerate(choices) if key in [other for other, _ in choices[:number]]]
    if twice:
        raise UserError(f"--set {twice[0]}: given twice; give all values at once, as {twice[0]}=A,B")
    planned = [
        dict(zip([key for key, _ in choices], values, strict=True))
        for values in itertools.product(*(values for _, values in choices))
    ]
    if len(planned) * len(seeds) > MOST:
        raise UserError(f"--set, --seeds: {len(planned) * len(seeds)} runs; at most {MOST}")
    scenarios = [with_settings(scenario, settings) for settings in planned]
    return [
        Planned(number, settings, seed, one.changed("world", seed=seed))
        for seed in seeds
        for number, (settings, one) in enumerate(zip(planned, scenarios, strict=True))
    ]


def parse_seeds(text: str) -> list[int]:
    """Seeds as `1..20`, `3`, or several of these with commas, each once and sorted. UserError: something else."""
    seeds = set[int]()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:\.\.(\d{1,9}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first or last - first >= MOST:
            raise UserError(f"--seeds {text}: give numbers and ranges, as 1..20 or 1,5,9")
        seeds |= set(range(first, last + 1))
    return sorted(seeds)


def label(settings: Settings) -> str:
    """A combination as text; "as it is" where nothing is set."""
    return " ".join(f"{key}={value}" for key, value in settings.items()) or "as it is"
