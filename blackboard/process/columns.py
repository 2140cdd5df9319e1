"""Rows as text, in columns. Pure."""

from __future__ import annotations

from collections.abc import Sequence

LEAST_LAST = 12  # characters that the last column keeps before another one falls away


def columns(rows: Sequence[Sequence[str]], width: int | None = None, fall: Sequence[str] = ()) -> list[str]:
    """A line for each row, the cells of each column under each other; the first row has their names.

    Where lines are longer than `width`, columns fall away in the order of `fall`, and then lines are cut. The last column
    is the one that is cut first: it counts as LEAST_LAST characters at most.
    """
    table = [list(row) for row in rows]
    falling = list(fall)
    while True:
        widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
        least = sum(widths[:-1]) + 2 * (len(widths) - 1) + min(widths[-1], LEAST_LAST)
        if width is None or least <= width or not falling:
            break
        name = falling.pop(0)
        if name in table[0]:
            at = table[0].index(name)
            table = [row[:at] + row[at + 1 :] for row in table]
    lines = ["  ".join(cell.ljust(room) for cell, room in zip(row, widths, strict=True)).rstrip() for row in table]
    return lines if width is None else [shortened(line, width) for line in lines]


def shortened(line: str, width: int) -> str:
    """A line of at most `width` characters; what was cut is told by dots."""
    return line if len(line) <= width else line[: max(0, width - 3)] + "..."[:width]
