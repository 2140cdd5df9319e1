"""Rows as text: in columns, or as a table of Markdown; and numbers that may be missing. Pure."""

from collections.abc import Container, Sequence

LEAST_LAST = 12  # characters that the last column keeps before another one falls away


def columns(
    rows: Sequence[Sequence[str]], width: int | None = None, fall: Sequence[str] = (), numbers: Container[int] = ()
) -> list[str]:
    """A line for each row, the cells of each column under each other; the first row has their names.

    The columns of the indices `numbers` end under each other, all others begin there. Where lines are longer than `width`,
    columns fall away in the order of `fall`, and then lines are cut. The last column is the one that is cut first: it counts
    as LEAST_LAST characters at most.
    """
    kept, falling = list(range(len(rows[0]))), list(fall)
    widths = [max(len(row[i]) for row in rows) for i in kept]
    while width is not None and falling:
        *shown, last = (widths[i] for i in kept)
        if sum(shown) + 2 * len(shown) + min(last, LEAST_LAST) <= width:
            break
        name = falling.pop(0)
        kept = [i for i in kept if rows[0][i] != name]
    lines = [
        "  ".join(row[i].rjust(widths[i]) if i in numbers else row[i].ljust(widths[i]) for i in kept).rstrip()
        for row in rows
    ]
    return lines if width is None else [shortened(line, width) for line in lines]


def markdown_table(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table of Markdown; the first row has the names of the columns."""
    head, *others = (f"| {' | '.join(row)} |" for row in rows)
    return [head, "|---" * len(rows[0]) + "|", *others]


def cell(value: float | None, form: str) -> str:
    """A number in the form of `str.format`; "-" for none."""
    return "-" if value is None else form.format(value)


def shortened(line: str, width: int) -> str:
    """A line of at most `width` characters; dots stand for what was cut."""
    return line if len(line) <= width else line[: max(0, width - 3)] + "..."[:width]
