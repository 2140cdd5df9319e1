"""A TCP proxy between a process and its router, which delays what passes, holds it, and goes on."""

from __future__ import annotations

import asyncio
import contextlib

import numpy as np

from blackboard.chaos.trouble import OneDirection, Trouble

PIECE = 1 << 16  # bytes that are read at once
WAITING = 256  # pieces of one direction that are on their way; more are not read, as with a full window of TCP


class Lane:
    """Listens on a port of 127.0.0.1 and passes each connection on to another one; an asynchronous context.

    `trouble` may be changed at any time. While it is cut, nothing passes in either direction and nothing is lost. Data and new
    connections wait, as on a cable that is put in again before TCP gives up. Zenoh gives up after its lease.
    """

    def __init__(self, name: str, port: int, target: int, rng: np.random.Generator) -> None:
        self.name, self.port, self.target = name, port, target
        self.trouble = Trouble()
        self.passed = 0  # bytes, both directions
        self._rng = rng
        self._whole = asyncio.Event()
        self._whole.set()
        self._server: asyncio.Server | None = None
        self._connections: set[asyncio.Task[None]] = set()

    @property
    def endpoint(self) -> str:
        """Where a process connects instead of to its router."""
        return f"tcp/127.0.0.1:{self.port}"

    def cut(self) -> None:
        """Let nothing pass any more."""
        self._whole.clear()

    def mend(self) -> None:
        """Let pass what waits, and everything from now on."""
        self._whole.set()

    async def __aenter__(self) -> Lane:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        self._server.close()
        for task in tuple(self._connections):
            task.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._connections.add(task)
        try:
            with contextlib.suppress(OSError):
                await self._serve(reader, writer)
        except asyncio.CancelledError:
            pass  # asyncio logs a cancelled connection as an error
        finally:
            self._connections.discard(task)
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._whole.wait()
        there, back = await asyncio.open_connection("127.0.0.1", self.target)
        try:
            ways = [asyncio.create_task(self._pass(*way)) for way in ((reader, back), (there, writer))]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)  # where one side ends, both do
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        finally:
            back.close()

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One direction: read all the time, write each piece when it arrives."""
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(WAITING)
        now, line = asyncio.get_running_loop().time, OneDirection(self._rng)

        async def read() -> None:
            while piece := await reader.read(PIECE):
                await waiting.put((line.arrives(now(), len(piece), self.trouble), piece))
            await waiting.put((0.0, b""))

        reading = asyncio.create_task(read())
        try:
            while True:
                at, piece = await waiting.get()
                await asyncio.sleep(max(0.0, at - now()))
                await self._whole.wait()
                if not piece:
                    break
                writer.write(piece)
                await writer.drain()
                self.passed += len(piece)
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)
