"""Programs in Rust, built by cargo into `.cargo-target/` (or CARGO_TARGET_DIR); a first build takes minutes and needs the crates."""

import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import pytest

from tests.files import ROOT

TARGET = os.environ.get("CARGO_TARGET_DIR", str(ROOT / ".cargo-target"))


@pytest.fixture(scope="session")
def built() -> Callable[[Path], str]:
    """Builds the crate in a folder and returns the path of its program, which has the folder's name. Skips where there is no cargo, or no crates."""
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("no cargo here: the tests of programs in Rust are left out")

    @cache
    def build(folder: Path) -> str:
        environment = {"CARGO_BUILD_JOBS": "2", **os.environ, "CARGO_TARGET_DIR": TARGET}
        run = partial(subprocess.run, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        fetched = run([cargo, "fetch"])
        if fetched.returncode != 0:
            pytest.skip(f"the crates cannot be fetched: {fetched.stderr.strip()[-300:]}")
        done = run(["nice", cargo, "build", "--quiet"])
        assert done.returncode == 0, done.stderr
        return str(Path(TARGET, "debug", folder.name))

    return build
