"""The server of the live page: files, one WebSocket that carries the newest frame, the frames of the last minutes, and the reasons.

One task takes in what arrives and makes each frame once, however many browsers look on; each browser is sent the newest frame as
soon as it has taken the one before, so that a slow one loses frames and nothing else. Nothing is loaded from elsewhere.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib import resources
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from blackboard.errors import UserError
from blackboard.view.feed import Feed
from blackboard.view.fold import Fold
from blackboard.view.web.frames import LEAST_GAP, Frames
from blackboard.view.why import explain
from blackboard.view.words import sentences

FILES = {
    "index.html": "text/html; charset=utf-8",
    "page.css": "text/css; charset=utf-8",
    "page.js": "text/javascript; charset=utf-8",
    "frames.js": "text/javascript; charset=utf-8",
    "draw.js": "text/javascript; charset=utf-8",
}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
MAX_BROWSERS = 64
POLICY = 1008  # WebSocket close code: not allowed here


class Page:
    """What all browsers share: the frames, and news of them. `take` it in a loop of its own."""

    def __init__(self, fold: Fold, team: str) -> None:
        self.frames = Frames(fold, team)
        self.browsers = 0
        self._news = asyncio.Condition()

    async def look(self, now: Callable[[], float]) -> None:
        """Make the frame that is due, and wake all who wait for it. Frames of a large team take at most a third of the time."""
        begin = now()
        if self.frames.look(begin):
            self.frames.gap = max(LEAST_GAP, 3 * (now() - begin))
            async with self._news:
                self._news.notify_all()

    async def newer_than(self, number: int) -> tuple[int, bytes]:
        """The newest frame once it is newer than `number`, with its own number."""
        async with self._news:
            await self._news.wait_for(lambda: self.frames.number > number)
            return self.frames.number, self.frames.newest


def application(page: Page, hosts: list[str]) -> Starlette:
    """The page as an ASGI application, for browsers that call it by one of `hosts`."""

    async def file(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in FILES:
            return Response("no such file", 404)
        content = resources.files("blackboard.view.web").joinpath("page", name).read_bytes()
        return Response(content, media_type=FILES[name], headers=HEADERS)

    async def past(request: Request) -> Response:
        return Response(page.frames.past(), media_type="application/octet-stream", headers=HEADERS)

    async def why(request: Request) -> Response:
        team, query = page.frames.team, request.query_params
        tick = query.get("tick", "")
        moment = team.moments.at(int(tick)) if tick.isdecimal() and len(tick) < 17 else team.moments.newest
        if moment is None or query.get("run", moment.run) != moment.run:
            return JSONResponse({"sentences": ["This tick is no longer kept here."]}, headers=HEADERS)
        try:
            found = await asyncio.to_thread(explain, team, moment, query.get("subject", ""))
        except UserError as error:
            return JSONResponse({"sentences": [str(error)]}, headers=HEADERS)
        return JSONResponse({"sentences": sentences(found), "why": found}, headers=HEADERS)

    async def live(socket: WebSocket) -> None:
        origin = socket.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != socket.headers.get("host"):
            await socket.close(POLICY)  # another site's page must not look on
            return
        if page.browsers >= MAX_BROWSERS:
            await socket.close(POLICY)
            return
        await socket.accept()
        page.browsers += 1
        try:
            await _send_newest(page, socket)
        finally:
            page.browsers -= 1

    routes = [
        Route("/", file),
        Route("/past", past),
        Route("/why", why),
        Route("/{name}", file),
        WebSocketRoute("/live", live),
    ]
    return Starlette(routes=routes, middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=hosts)])


async def _send_newest(page: Page, socket: WebSocket) -> None:
    """Send each newest frame until the browser leaves."""

    async def send() -> None:
        number = 0
        while True:
            number, newest = await page.newer_than(number)
            await socket.send_bytes(newest)  # returns when the browser's connection has room again

    async def listen() -> None:
        while True:
            await socket.receive_bytes()  # browsers send nothing; this notices when they leave

    tasks = [asyncio.create_task(send()), asyncio.create_task(listen())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception) and not isinstance(result, WebSocketDisconnect | RuntimeError | KeyError):
                raise result


def serve(
    feed: Feed,
    team: str,
    now: Callable[[], float],
    host: str,
    port: int,
    stopped: Callable[[], bool],
    ready: Callable[[str], None],
) -> None:
    """Serve the page of a team until SIGINT, SIGTERM or `stopped`; `ready` is called with its URL. UserError: the port is taken."""
    with _bound(host, port) as listening:
        at = listening.getsockname()[1]
        asyncio.run(_serve(feed, team, now, host, listening, stopped, lambda: ready(f"http://{host}:{at}/")))


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
    feed: Feed,
    team: str,
    now: Callable[[], float],
    host: str,
    listening: socket.socket,
    stopped: Callable[[], bool],
    ready: Callable[[], None],
) -> None:
    page = Page(feed.fold, team)
    local = host in ("127.0.0.1", "localhost", "::1")
    app = application(page, ["127.0.0.1", "localhost", host] if local else ["*"])
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        log_level="warning",
        lifespan="off",
        ws="websockets-sansio",
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    async with _following(page, feed, now, stopped, server):
        ready()
        await server.serve(sockets=[listening])


@asynccontextmanager
async def _following(
    page: Page, feed: Feed, now: Callable[[], float], stopped: Callable[[], bool], server: uvicorn.Server
) -> AsyncIterator[None]:
    """Take in what arrives while the server runs; a fault in it ends the server, and is raised."""

    async def follow() -> None:
        try:
            while not (stopped() or server.should_exit):
                feed.take(await asyncio.to_thread(feed.receive))
                await page.look(now)
        finally:
            server.should_exit = True

    task = asyncio.create_task(follow())
    try:
        yield
    finally:
        server.should_exit = True
        await task
