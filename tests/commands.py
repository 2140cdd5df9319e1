"""Commands as a person gives them: in this process, or in one of their own."""

from __future__ import annotations

import subprocess
import sys

from blackboard.__main__ import app
from tests.files import ROOT


def call(*words: object) -> object:
    """Run `blackboard` with these words in this process; errors are raised."""
    return app([str(word) for word in words], exit_on_error=False, print_error=False, result_action="return_value")


def blackboard(*words: str, timeout: float = 110) -> subprocess.CompletedProcess[str]:
    """Run `blackboard` with these words as a process, to its end."""
    return subprocess.run(
        [sys.executable, "-m", "blackboard", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
