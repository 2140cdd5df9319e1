"""The table of a tape as a file: CSV, JSON lines, or Parquet (extra `table`, which is loaded when it is asked for)."""

from __future__ import annotations

import csv
import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import asdict, astuple, fields
from itertools import islice
from pathlib import Path
from typing import Any

from blackboard.errors import UserError
from blackboard.tape.table import COLUMNS, Row

ENDINGS = (".csv", ".jsonl", ".parquet")
GROUP = 50_000  # rows that are written to a Parquet file at once
TYPES = {"str": "string", "int": "int64", "float": "float64", "float | None": "float64"}  # of Row -> of Parquet


def write_table(rows: Iterable[Row], out: Path | None) -> None:
    """Write rows by the ending of `out`, or as CSV on standard output. UserError: another ending, or it cannot be written."""
    if out is not None and out.suffix not in ENDINGS:
        raise UserError(f"--out {out}: tables are written as {', '.join(ENDINGS)}; choose one of these endings")
    try:
        if out is not None and out.suffix == ".parquet":
            _write_parquet(rows, out)
            return
        with nullcontext(sys.stdout) if out is None else out.open("w", encoding="utf-8", newline="") as stream:
            if out is not None and out.suffix == ".jsonl":
                stream.writelines(json.dumps(asdict(row)) + "\n" for row in rows)
            else:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(COLUMNS)
                writer.writerows(astuple(row) for row in rows)
    except BrokenPipeError:  # whoever reads it has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror}); choose another place") from error


def _write_parquet(rows: Iterable[Row], out: Path) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise UserError(f"--out {out}: Parquet needs the extra `table`: pip install 'cop-blackboard[table]'") from None
    schema = pyarrow.schema([(field.name, TYPES[str(field.type)]) for field in fields(Row)])
    with parquet.ParquetWriter(out, schema) as writer:
        for group in _groups(rows):
            writer.write_table(pyarrow.Table.from_pylist(group, schema))


def _groups(rows: Iterable[Row]) -> Iterator[list[dict[str, Any]]]:
    left = iter(rows)
    while group := [asdict(row) for row in islice(left, GROUP)]:
        yield group
