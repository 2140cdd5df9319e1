"""The recorder beside the processes of a run: started before them, stopped after the world has ended."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from blackboard.errors import RunFailed
from blackboard.run.supervisor import Process, Supervisor

log = logging.getLogger(__name__)


@asynccontextmanager
async def recording(
    supervisor: Supervisor, recorder: Process | None, tape: Path | None, ready_seconds: float
) -> AsyncIterator[None]:
    """Record while this context lasts: it is entered once the recorder listens, which the first bytes of the tape show.

    RunFailed, UserError: the recorder ended before that, or does not listen after `ready_seconds`. One that
    ends later is warned of; the team does not depend on it.
    """
    if recorder is None or tape is None:
        yield
        return
    running = asyncio.create_task(supervisor.run(recorder))
    try:
        try:
            async with asyncio.timeout(ready_seconds):
                while not running.done() and not (tape.is_file() and tape.stat().st_size):
                    await asyncio.wait([running], timeout=0.02)
        except TimeoutError:
            raise RunFailed(f"the recorder does not listen after {ready_seconds:g} s; its output is above") from None
        if running.done():
            raise RunFailed(f"the recorder ended with status {running.result()[0]}; its output is above")
        yield
        if running.done():
            log.warning("the recorder ended before the run; %s has what came until then", tape)
    finally:
        running.cancel()
        await asyncio.wait([running])
