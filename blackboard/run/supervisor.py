"""A small supervisor of operating-system processes: starts them, shows their lines, restarts those that die, stops them all.

Each process gets a session of its own (setsid), so that Ctrl-C in a terminal reaches the supervisor alone. It also dies with the
supervisor (`blackboard.run.lifeline`), so that nothing is left behind even when the supervisor is killed with -9.
"""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

from blackboard.errors import UserError
from blackboard.run.door import ERROR, PARENT, USER_ERROR

STOP_SECONDS = 4.0  # from SIGTERM to SIGKILL
BACK_OFF = (0.2, 0.5, 1.0, 2.0, 5.0)  # seconds before each restart, the last one for all that follow
LIVED = 10.0  # seconds after which a process is taken to have been well, so that the pauses begin anew
CHUNK = 1 << 16  # bytes; a longer line is broken


@dataclass(frozen=True)
class ProcessRow:
    """A row of a process table: the command, and the liveliness tokens that it holds once it is ready."""

    name: str
    arguments: Sequence[str]
    tokens: frozenset[str] = frozenset()


def print_line(name: str, line: str) -> None:
    """Print a line of a process on standard error, behind the name of the process."""
    print(f"{name:>8} | {line}", file=sys.stderr, flush=True)  # noqa: T201


class Supervisor:
    """An asynchronous context; when it is left, normally or by an exception, everything that was started is stopped.

    Where a process ends with the exit status of a user error, the body is cancelled and the context raises `UserError` with
    the last line of the process. So that a person sees this line alone, the output of all processes is held back until
    `release` is called, a process dies, or the context is left for another reason.
    """

    def __init__(self, show: Callable[[str, str], None] = print_line, stop_seconds: float = STOP_SECONDS) -> None:
        self._show, self._stop_seconds = show, stop_seconds
        self._held: list[tuple[str, str]] | None = []
        self._group = asyncio.TaskGroup()
        self._restarting: list[asyncio.Task[None]] = []
        self.pids: dict[str, int] = {}  # of those that run, by name
        self.last_lines: dict[str, str] = {}  # of the log of each process that was started, by name

    async def __aenter__(self) -> "Supervisor":
        await self._group.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        for task in self._restarting:
            task.cancel()
        try:
            await self._group.__aexit__(kind, error, at)
        except BaseExceptionGroup as group:
            cause = group.exceptions[0]  # the first one; it cancelled the other tasks
            if isinstance(cause, UserError):
                self._held = []
            raise cause from None
        finally:
            self.release()

    def keep_running(self, process: ProcessRow) -> None:
        """Start a process, and start it again whenever it dies, after a pause that grows while it dies soon (`BACK_OFF`)."""
        self._restarting.append(self._group.create_task(self._restart_forever(process)))

    async def run(self, process: ProcessRow) -> tuple[int, str]:
        """Run a process once: its exit status (negative: the signal that killed it) and its standard output."""
        output: list[str] = []
        status = await self._run_once(process, output.append)
        return status, "\n".join(output)

    def terminate(self, name: str) -> bool:
        """Send SIGTERM to a process by its name; whether it runs."""
        pid = self.pids.get(name)
        if pid is None:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
        return True

    def release(self) -> None:
        """Show what was held back, and from now on everything at once."""
        held, self._held = self._held or [], None
        for name, line in held:
            self._show(name, line)

    def _show_or_hold(self, name: str, line: str) -> None:
        if self._held is None:
            self._show(name, line)
        else:
            self._held.append((name, line))

    async def _restart_forever(self, process: ProcessRow) -> None:
        now, deaths = asyncio.get_running_loop().time, 0
        while True:
            began = now()
            status = await self._run_once(process, lambda line: self._show_or_hold(process.name, line))
            self.release()
            deaths = 0 if now() - began >= LIVED else deaths
            pause, deaths = BACK_OFF[min(deaths, len(BACK_OFF) - 1)], deaths + 1
            self._show_or_hold(process.name, f"ended with status {status}; starting it again in {pause:g} s")
            await asyncio.sleep(pause)

    async def _run_once(self, process: ProcessRow, take: Callable[[str], None]) -> int:
        """Run a process to its end and return its exit status; stop it if this is cancelled.

        `take` is called with each line of its standard output. UserError: it ended with the status of one.
        """
        running = await self._start(process)
        self.pids[process.name] = running.pid
        self.last_lines[process.name] = ""

        async def copy_output() -> None:
            async for line in _lines(running.stdout):
                take(line)

        async def copy_log() -> None:
            async for line in _lines(running.stderr):
                self.last_lines[process.name] = line
                self._show_or_hold(process.name, line)

        try:
            await asyncio.gather(copy_output(), copy_log())
            status = await running.wait()
        finally:
            await self._stop(running)
            self.pids.pop(process.name, None)
        if status == USER_ERROR:
            last = self.last_lines[process.name].removeprefix(ERROR)
            raise UserError(last or f"{process.name} ended with status {USER_ERROR} and printed nothing")
        return status

    async def _start(self, process: ProcessRow) -> asyncio.subprocess.Process:
        """Start a process. Where this is cancelled the process is stopped in order; asyncio would kill one that it is starting."""
        starting = asyncio.create_task(
            asyncio.create_subprocess_exec(
                *process.arguments,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                start_new_session=True,
                env=_environment(),
            )
        )
        try:
            return await asyncio.shield(starting)
        except asyncio.CancelledError:
            await self._stop(await starting)
            raise

    async def _stop(self, running: asyncio.subprocess.Process) -> None:
        """Send SIGTERM; after `stop_seconds`, or if even this is cancelled, SIGKILL to the process and its children."""
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
    """The environment of the processes: whom to die with, and one thread each for numpy, because there are many of them.

    A session of Zenoh has some eight threads. Where glibc gives each of them a heap of its own, a process that runs for long keeps
    growing, because what one heap has free helps no other (docs/network.md, "A soak").
    """
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    heaps = {"MALLOC_ARENA_MAX": "2"}
    return {**heaps, **os.environ, **threads, PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"}


async def _lines(stream: asyncio.StreamReader | None) -> AsyncIterator[str]:
    """The lines of a stream as text; one that is longer than `CHUNK` bytes comes in pieces, bytes that are no UTF-8 as U+FFFD."""
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
