"""The tables of a scenario file, as they stand in it. Loads no pydantic, so that a health check starts quickly."""

from __future__ import annotations

import json
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from blackboard.errors import UserError


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
        raise UserError(f"{path}: cannot be read ({error}); give an existing TOML file") from error
    try:
        tables = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:
        raise UserError(f"{path}: not valid TOML ({error})") from error
    if not isinstance(tables, dict):  # JSON may hold anything
        raise UserError(f"{path}: holds no sections; give a scenario, as `blackboard scenario` describes it")
    return tables, str(path)
