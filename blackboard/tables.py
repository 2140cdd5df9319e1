"""The tables of a scenario file, as they stand in it. Loads no pydantic, so that a health check starts quickly."""

import json
import tomllib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

from blackboard.errors import UserError, plain

DEEPEST = 16  # tables and arrays within each other; a scenario needs five


def read_tables(name: str | Path) -> tuple[dict[str, Any], str]:
    """The tables of a file (TOML or JSON), or of a scenario of the package by its name (`demo`), and where they came from.

    UserError: no such scenario, or a file that cannot be read or parsed.
    """
    path = Path(name)
    if not path.suffix:
        shipped = resources.files("sim_world") / "scenarios" / f"{path}.toml"
        if not shipped.is_file():
            raise UserError(f"{name}: no scenario of this name comes with the package; give a file that ends in .toml")
        return tomllib.loads(shipped.read_text(encoding="utf-8")), f"{name} (shipped)"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({plain(error)}); give an existing TOML file") from error
    try:
        tables = parse(text, json.loads if path.suffix == ".json" else tomllib.loads)
    except ValueError as error:
        raise UserError(f"{path}: not valid TOML ({error})") from error
    if not isinstance(tables, dict):  # JSON may hold anything
        raise UserError(f"{path}: holds no sections; give a scenario, as `blackboard scenario` describes it")
    return tables, str(path)


def parse(text: str, loads: Callable[[str], Any]) -> Any:
    """What `loads` reads in a text. ValueError: nothing, or it is nested deeper than any scenario."""
    try:
        found = loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    level = [found]
    for _ in range(DEEPEST + 1):
        level = [
            part
            for value in level
            if isinstance(value, dict | list)
            for part in (value.values() if isinstance(value, dict) else value)
        ]
    if level:
        raise ValueError("nested too deeply")
    return found
