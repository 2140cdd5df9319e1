"""Commands as a person gives them: in this process, or in one of their own."""

import io
import logging
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from typing import Any

import pytest

from blackboard.__main__ import app as blackboard_app
from blackboard.run import door
from tests.files import ROOT


def call(*words: object) -> object:
    """Run `blackboard` with these words in this process; errors are raised."""
    return blackboard_app(
        [str(word) for word in words], exit_on_error=False, print_error=False, result_action="return_value"
    )


class Ran:
    """A command that its door ran in this process, to its end: what it wrote, and its exit status."""

    def __init__(self, *words: str, app: Any = blackboard_app) -> None:
        out, err = io.StringIO(), io.StringIO()
        handlers, level = list(logging.root.handlers), logging.root.level
        try:
            with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as end:
                door.main(partial(app, [*words]))  # type: ignore[arg-type]
        finally:
            logging.root.handlers[:], logging.root.level = handlers, level
        self.status, self.out, self.err = end.value.code, out.getvalue(), err.getvalue()
        self.text = self.out + self.err

    @property
    def is_printable(self) -> bool:
        """Whether nothing but line breaks would move a terminal's cursor, or change what it shows."""
        return all(line.isprintable() for line in self.text.split("\n"))


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
