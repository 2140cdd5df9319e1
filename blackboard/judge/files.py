"""Rows as a file, by the ending of its name: CSV, JSON lines, or Parquet (extra `table`, loaded when it is asked for).

A row has a value, which may be None, for each column, and every row is written as it comes. Floats are exact in each format; what
is not finite is null in JSON lines, which have no other word for it.
"""

import csv
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from blackboard.errors import UserError, extra

ENDINGS = (".csv", ".jsonl", ".parquet")
GROUP = 50_000  # rows that are written to a Parquet file at once
PARQUET = {"str": "string", "int": "int64", "float": "float64"}  # type of a column -> of Parquet
Columns = Mapping[str, str]  # name -> "str", "int" or "float"
Write = Callable[[Mapping[str, Any]], None]  # takes a row, which may have more than the columns


def check_table(file: Path, flag: str) -> None:
    """Check that a table can be written by this name. UserError: another ending, no place for it, or Parquet without its extra."""
    if file.suffix not in ENDINGS:
        raise UserError(f"{flag} {file}: tables are written as {', '.join(ENDINGS)}; choose one of these endings")
    if file.suffix == ".parquet":
        with extra("table", f"{flag} {file}: Parquet"):
            import pyarrow  # noqa: F401
    if file.is_dir():
        raise UserError(f"{flag} {file}: is a folder; give the name of a file")
    if not file.parent.is_dir():
        raise UserError(f"{flag} {file}: there is no folder {file.parent}; make it, or choose another place")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise UserError(f"{flag} {file}: cannot be written (Permission denied); choose another place")


def check_folder(folder: Path, flag: str) -> None:
    """Check that files can be written into a folder, which may still have to be made. UserError: they cannot; names the flag."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        what = "is no folder" if there == folder else f"{there} is no folder"
        raise UserError(f"{flag} {folder}: {what}; choose another place")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UserError(f"{flag} {folder}: cannot be written (Permission denied); choose another place")


@contextmanager
def table_file(file: Path | None, columns: Columns, flag: str) -> Iterator[Write]:
    """A function that writes a row into a new file, or as CSV on standard output. UserError: it cannot be written."""
    if file is None:
        try:
            yield csv_writer(sys.stdout, columns)
        except BrokenPipeError:  # the reader of the pipe has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return
    check_table(file, flag)
    try:
        if file.suffix == ".parquet":
            with _parquet(file, columns) as write:
                yield write
            return
        with file.open("w", encoding="utf-8", newline="") as stream:
            yield jsonl_writer(stream, columns) if file.suffix == ".jsonl" else csv_writer(stream, columns)
    except OSError as error:
        raise UserError(f"{flag} {file}: cannot be written ({error.strerror}); choose another place") from error


def csv_writer(stream: TextIO, columns: Columns) -> Write:
    """A function that writes a row as a line of CSV; the names of the columns are written at once."""
    writer = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    return writer.writerow


def jsonl_writer(stream: TextIO, columns: Columns) -> Write:
    """A function that writes a row as a line with a JSON object."""

    def finite(value: Any) -> Any:
        return None if isinstance(value, float) and not math.isfinite(value) else value

    def write(row: Mapping[str, Any]) -> None:
        stream.write(json.dumps({name: finite(row[name]) for name in columns}) + "\n")

    return write


@contextmanager
def _parquet(file: Path, columns: Columns) -> Iterator[Write]:
    import pyarrow
    from pyarrow import parquet

    schema = pyarrow.schema([(name, PARQUET[kind]) for name, kind in columns.items()])
    waiting: list[Mapping[str, Any]] = []
    with parquet.ParquetWriter(file, schema) as writer:

        def flush() -> None:
            writer.write_table(pyarrow.Table.from_pylist(waiting, schema))
            waiting.clear()

        def write(row: Mapping[str, Any]) -> None:
            waiting.append(row)
            if len(waiting) >= GROUP:
                flush()

        try:
            yield write
        finally:
            flush()
