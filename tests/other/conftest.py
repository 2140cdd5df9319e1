"""Programs in Rust, built by cargo into `.cargo-target/` (or CARGO_TARGET_DIR); a first build takes minutes and needs the crates."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.processes import ROOT

TARGET = os.environ.get("CARGO_TARGET_DIR", str(ROOT / ".cargo-target"))


@pytest.fixture(scope="session")
def built() -> Callable[[Path], str]:
    """Builds the crate in a folder and returns the path of its program, which has the folder's name. Skips where there is no cargo."""
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("no cargo here: the tests of programs in Rust are left out")

    @cache
    def build(folder: Path) -> str:
        environment = {"CARGO_BUILD_JOBS": "2", **os.environ, "CARGO_TARGET_DIR": TARGET}
        done = subprocess.run(
            ["nice", cargo, "build", "--quiet"],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return str(Path(TARGET, "debug", folder.name))

    return build
