"""A progress bar on a terminal, with the time left; elsewhere nothing, or a line after the first and each tenth."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from blackboard.process.clock import UnixClock
from blackboard.process.printable import printable

FEW = 100  # a smaller share of all than one of so many does not tell how long the rest takes

Show = Callable[[int, int], None]  # to be called with what is done and the total


@contextmanager
def progress(name: str, lines: bool = True) -> Iterator[Show | None]:
    """A function that moves the bar. Where standard error is no terminal: one that prints `lines`, or None."""
    if not sys.stderr.isatty():
        yield _line_by_line(name) if lines else None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(escape(printable(name))),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _line_by_line(name: str) -> Show:
    """A function that prints a line on standard error after the first, and whenever another tenth of all is done."""
    told, clock = -1, UnixClock()
    began = clock.now()

    def show(done: int, total: int) -> None:
        nonlocal told
        if done * 10 // total > told:
            told = done * 10 // total
            minutes = (clock.now() - began) / done * (total - done) / 60
            left = f" ({minutes:.1f} min left)" if done * FEW >= total else ""
            print(f"{name}: {done} of {total}{left}", file=sys.stderr, flush=True)  # noqa: T201

    return show
