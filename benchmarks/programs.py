"""Programs as processes of their own, from when they are ready until a block ends, and what they use meanwhile."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ratios import ROOT

LONG = 60.0  # seconds, in which a program ends that was asked to


@dataclass(frozen=True)
class Program:
    """One that runs."""

    process: subprocess.Popen[str]
    said: str  # the line by which it was ready

    def processor_seconds(self) -> float:
        """What it has used, user and system."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def mebibytes(self) -> float:
        """Its memory now."""
        match = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text())
        assert match is not None
        return int(match[1]) / 1024


@contextmanager
def program(*arguments: str, says: str = "ready", **environment: str) -> Iterator[Program]:
    """Python with some arguments, as `-m MODULE`: it has said a line with `says`, and is ended with the block.

    RuntimeError: it ended before that.
    """
    command, variables = [sys.executable, *arguments], {**os.environ, **environment}
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=variables
    )
    try:
        said = next((line for line in process.stderr or () if says in line), None)
        if said is None:
            raise RuntimeError(f"{' '.join(arguments)} ended without a line with {says!r}")
        yield Program(process, said)
    finally:
        process.terminate()
        process.communicate(timeout=LONG)
