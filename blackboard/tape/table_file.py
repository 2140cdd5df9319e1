"""The table of a tape as a file, or on standard output."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path

from blackboard.tape.table import Row
from sim_world.table import csv_writer, table_file


def write_table(rows: Iterable[Row], out: Path | None) -> None:
    """Write rows by the ending of `out`, or as CSV on standard output. UserError: another ending, or it cannot be written."""
    if out is not None:
        with table_file(out, Row, "--out") as write:
            for row in rows:
                write(row)
        return
    try:
        write = csv_writer(sys.stdout, Row)
        for row in rows:
            write(row)
    except BrokenPipeError:  # whoever reads it has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
