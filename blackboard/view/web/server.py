"""The server of the live page: it listens, takes in what arrives, and rests as long as that took."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

import uvicorn
from starlette.applications import Starlette

from blackboard.errors import UserError
from blackboard.view.feed import Source
from blackboard.view.web import connections
from blackboard.view.web.application import Page, application
from blackboard.view.web.frames import LEAST_GAP

LONGEST_REST = 1.0  # seconds


@dataclass(frozen=True)
class Address:
    """Where the page listens, and by which names browsers may call it: pages of other sites must not read it by another one."""

    host: str = "127.0.0.1"
    port: int = 0
    names: Sequence[str] | None = None

    @property
    def hosts(self) -> list[str]:
        """The names; any where it does not listen for this machine alone and none are given."""
        local = self.host in ("127.0.0.1", "localhost", "::1")
        return list(self.names) if self.names else ["127.0.0.1", "localhost", self.host] if local else ["*"]


def serve(
    source: Source,
    team: str,
    clock: Callable[[], float],
    address: Address,
    stopped: Callable[[], bool],
    ready: Callable[[str], None],
    drift: float = 1.0,
) -> None:
    """Serve the page of a team until SIGINT, SIGTERM or `stopped`; `ready` is called with its URL. UserError: the port is taken.

    `clock` gives seconds of a monotonic clock, `drift` is as in `explain`.
    """
    with _bound(address.host, address.port) as listening:
        at = listening.getsockname()[1]
        page = Page(source, team, clock)
        app = application(page, address.hosts, drift)
        asyncio.run(_serve(page, app, listening, stopped, lambda: ready(f"http://{address.host}:{at}/")))


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen()  # who comes before the server runs waits
    except (OSError, OverflowError) as error:
        listening.close()
        raise UserError(f"--host {host} --port {port}: {error}; choose another port, or 0 for a free one") from None
    return listening


async def _serve(
    page: Page, app: Starlette, listening: socket.socket, stopped: Callable[[], bool], ready: Callable[[], None]
) -> None:
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        log_level="warning",
        lifespan="off",
        http=connections.Visit,
        ws=connections.Watching,
        ws_ping_interval=connections.PING,
        ws_ping_timeout=connections.PING,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    async with _following(page, stopped, server):
        ready()
        await server.serve(sockets=[listening])


@asynccontextmanager
async def _following(page: Page, stopped: Callable[[], bool], server: uvicorn.Server) -> AsyncIterator[None]:
    """Take in what arrives while the server runs; a fault in it ends the server, and is raised.

    After each look it rests as long as that took, so that a large team costs half a core; what comes meanwhile waits in the inbox.
    """

    async def follow() -> None:
        try:
            while not (stopped() or server.should_exit):
                envelopes = await asyncio.to_thread(page.source.receive)
                begin = page.clock()
                page.source.hear_envelopes(envelopes)
                await page.look()
                if page.source.done is None:
                    await asyncio.sleep(min(LONGEST_REST, page.clock() - begin))
                elif page.source.done:
                    await asyncio.sleep(LEAST_GAP)
        finally:
            server.should_exit = True

    task = asyncio.create_task(follow())
    try:
        yield
    finally:
        server.should_exit = True
        await task
