"""A small supervisor of operating-system processes: start, pass on their lines, start again when they die, stop.

Each process is a session of its own, so that Ctrl-C in a terminal reaches the supervisor alone, and follows it into death
(`door`), so that nothing is left behind, also when the supervisor is killed with -9.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

from blackboard.door import MISTAKE, PARENT
from blackboard.errors import Mistake

STOP_SECONDS = 4.0  # from SIGTERM to SIGKILL
BACK_OFF = (0.2, 0.5, 1.0, 2.0, 5.0)  # seconds before each restart, the last one for all that follow
CHUNK = 1 << 16  # bytes; a longer line is broken


@dataclass(frozen=True)
class Process:
    """A row of a process table: what to run, and the liveliness tokens that say it is ready."""

    name: str
    arguments: Sequence[str]
    tokens: frozenset[str] = frozenset()


def say(name: str, line: str) -> None:
    """A process's line on standard error, behind its name."""
    print(f"{name:>8} | {line}", file=sys.stderr, flush=True)  # noqa: T201


class Supervisor:
    """An asynchronous context; on leaving it, however that comes about, everything that was started is stopped.

    Where a process ends with the exit status of a person's mistake, the body is cancelled and `Mistake` leaves the context
    with the process's last line. So that this line stands alone, what processes say is held back until `release`, a death,
    or an end for another reason.
    """

    def __init__(self, show: Callable[[str, str], None] = say, stop_seconds: float = STOP_SECONDS) -> None:
        self._show, self._stop_seconds = show, stop_seconds
        self._held: list[tuple[str, str]] | None = []
        self._group = asyncio.TaskGroup()
        self._kept: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Supervisor:
        await self._group.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        for task in self._kept:
            task.cancel()
        try:
            await self._group.__aexit__(kind, error, at)
        except BaseExceptionGroup as group:
            cause = group.exceptions[0]  # the one that cancelled the others
            if isinstance(cause, Mistake):
                self._held = []
            raise cause from None
        finally:
            self.release()

    def keep(self, process: Process) -> None:
        """Start a process, and again whenever it dies, later each time."""
        self._kept.append(self._group.create_task(self._keep(process)))

    async def run(self, process: Process) -> tuple[int, str]:
        """Run a process once: its exit status (negative: the signal that killed it) and its standard output."""
        output: list[str] = []
        status = await self._once(process, output.append)
        return status, "\n".join(output)

    def release(self) -> None:
        """Show what was held back, and from now on everything at once."""
        held, self._held = self._held or [], None
        for name, line in held:
            self._show(name, line)

    def _tell(self, name: str, line: str) -> None:
        if self._held is None:
            self._show(name, line)
        else:
            self._held.append((name, line))

    async def _keep(self, process: Process) -> None:
        for pause in itertools.chain(BACK_OFF, itertools.repeat(BACK_OFF[-1])):
            status = await self._once(process, lambda line: self._tell(process.name, line))
            self.release()
            self._tell(process.name, f"ended with status {status}; starting it again in {pause:g} s")
            await asyncio.sleep(pause)

    async def _once(self, process: Process, take: Callable[[str], None]) -> int:
        """Run a process to its end, its standard output to `take`; stop it where this is cancelled."""
        running = await asyncio.create_subprocess_exec(
            *process.arguments,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
            env=_environment(),
        )
        last = ""

        async def copy_output() -> None:
            async for line in _lines(running.stdout):
                take(line)

        async def copy_log() -> None:
            nonlocal last
            async for last in _lines(running.stderr):
                self._tell(process.name, last)

        try:
            await asyncio.gather(copy_output(), copy_log())
            status = await running.wait()
        finally:
            await self._end(running)
        if status == MISTAKE:
            raise Mistake(
                last.removeprefix("error: ") or f"{process.name} ended with status {MISTAKE} and said nothing"
            )
        return status

    async def _end(self, running: asyncio.subprocess.Process) -> None:
        """SIGTERM; after a grace, or where even this is cancelled, SIGKILL to it and its children."""
        if running.returncode is not None:
            return
        try:
            with contextlib.suppress(TimeoutError, ProcessLookupError):
                running.terminate()
                await asyncio.wait_for(running.wait(), self._stop_seconds)
        finally:
            if running.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(running.pid, signal.SIGKILL)
                await running.wait()


def _environment() -> dict[str, str]:
    """What processes are started with: whom to follow, and one thread each for numpy, because there are many."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**os.environ, **threads, PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"}


async def _lines(stream: asyncio.StreamReader | None) -> AsyncIterator[str]:
    assert stream is not None
    rest = b""
    while chunk := await stream.read(CHUNK):
        *lines, rest = (rest + chunk).split(b"\n")
        if len(rest) > CHUNK:
            lines, rest = [*lines, rest], b""
        for line in lines:
            yield line.decode("utf-8", "replace").rstrip()
    if rest:
        yield rest.decode("utf-8", "replace").rstrip()
