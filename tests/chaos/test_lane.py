"""The proxy with real sockets on 127.0.0.1."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import numpy as np

from blackboard.chaos.lane import Lane
from blackboard.chaos.trouble import Trouble
from blackboard.run.launch import free_port
from tests.processes import LONG

Ends = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@asynccontextmanager
async def echo_behind_a_lane() -> AsyncIterator[tuple[Lane, Callable[[], Awaitable[Ends]]]]:
    """A server that sends back what it gets, a lane before it, and what connects to the lane; all closed at the end."""
    opened: list[asyncio.StreamWriter] = []

    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while piece := await reader.read(1000):
            writer.write(piece)
        writer.close()

    server = await asyncio.start_server(echo, "127.0.0.1", 0)
    async with Lane("r1", free_port(), server.sockets[0].getsockname()[1], np.random.default_rng(1)) as lane:

        async def connect() -> Ends:
            reader, writer = await asyncio.open_connection("127.0.0.1", lane.port)
            opened.append(writer)
            return reader, writer

        try:
            yield lane, connect
        finally:
            for writer in opened:
                writer.close()
            server.close()


def test_all_bytes_pass_in_their_order_whatever_the_trouble() -> None:
    async def body() -> None:
        async with echo_behind_a_lane() as (lane, connect):
            lane.trouble = Trouble(delay=0.01, jitter=0.01)
            reader, writer = await connect()
            sent = np.random.default_rng(2).bytes(300_000)
            writer.write(sent)
            assert await asyncio.wait_for(reader.readexactly(len(sent)), LONG) == sent
            assert lane.passed >= 2 * len(sent) - (1 << 16)

    asyncio.run(body())


def test_nothing_passes_while_it_is_cut_and_everything_after() -> None:
    async def body() -> None:
        async with echo_behind_a_lane() as (lane, connect):
            old = await connect()
            old[1].write(b"before")
            assert await asyncio.wait_for(old[0].readexactly(6), LONG) == b"before"
            lane.cut()
            passed, new = lane.passed, await connect()
            waiting = []
            for reader, writer in (old, new):
                writer.write(b"after")
                waiting.append(asyncio.create_task(reader.readexactly(5)))
            done, _ = await asyncio.wait(waiting, timeout=0.1)
            assert not done
            assert lane.passed == passed
            lane.mend()
            assert await asyncio.wait_for(asyncio.gather(*waiting), LONG) == [b"after", b"after"]

    asyncio.run(body())


def test_where_one_side_ends_the_other_one_does() -> None:
    async def body() -> None:
        async with echo_behind_a_lane() as (_, connect):
            reader, writer = await connect()
            writer.write(b"x")
            await asyncio.wait_for(reader.readexactly(1), LONG)
            writer.write_eof()
            assert await asyncio.wait_for(reader.read(), LONG) == b""

    asyncio.run(body())
