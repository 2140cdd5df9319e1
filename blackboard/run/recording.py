"""The recorder beside the processes of a run: started before them, stopped after the world has ended."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from blackboard.errors import RunFailed
from blackboard.run.door import ERROR, FAILED
from blackboard.run.supervisor import STOP_SECONDS, ProcessRow, Supervisor


@dataclass
class TapeResult:
    """What became of the tape of a run, once the context of `recording` is left."""

    trouble: str = ""
    "What is missing on it, in one line; empty where nothing is, and where nothing was recorded."


@asynccontextmanager
async def recording(
    supervisor: Supervisor, recorder: ProcessRow | None, tape: Path | None, ready_seconds: float
) -> AsyncIterator[TapeResult]:
    """Record while this context lasts: it is entered once the recorder listens, which the first bytes of the tape show.

    RunFailed, UserError: the recorder ended before that, or does not listen after `ready_seconds`. The team does not depend on
    one that ends later, or that could not write everything: then the Recording has the trouble.
    """
    recorded = TapeResult()
    if recorder is None or tape is None:
        yield recorded
        return
    running = asyncio.create_task(supervisor.run(recorder))
    try:
        try:
            async with asyncio.timeout(ready_seconds):
                # The tape may be there before the supervisor knows the process, which then could not be stopped.
                while not running.done() and not (
                    recorder.name in supervisor.pids and tape.is_file() and tape.stat().st_size
                ):
                    await asyncio.wait([running], timeout=0.02)
        except TimeoutError:
            raise RunFailed(f"the recorder does not listen after {ready_seconds:g} s; its output is above") from None
        if running.done():
            raise RunFailed(f"the recorder ended with status {running.result()[0]}; its output is above")
        yield recorded
        early = running.done()
        supervisor.terminate(recorder.name)
        await asyncio.wait([running], timeout=STOP_SECONDS)
        recorded.trouble = _trouble(tape, running, early, supervisor.last_lines.get(recorder.name, ""))
    finally:
        running.cancel()
        await asyncio.wait([running])


def _trouble(tape: Path, running: asyncio.Task[tuple[int, str]], early: bool, last_line: str) -> str:
    """What is missing on a tape, by how its recorder ended and what it said last."""
    rest = f"{tape} has what came until then; `blackboard tape recover {tape}` saves that"
    if not running.done():
        return f"the recorder did not end within {STOP_SECONDS:g} s; {rest}"
    status = FAILED if running.exception() is not None else running.result()[0]
    if status == FAILED and last_line.startswith(ERROR):
        return last_line.removeprefix(ERROR)
    if status or early:
        return f"the recorder ended {'before the run ' if early else ''}with status {status}; {rest}"
    return ""
