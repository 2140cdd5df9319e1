"""The live page as an ASGI application: files, one WebSocket that carries the newest frame, what is over, and the reasons.

One task takes in what arrives and makes each frame once, however many browsers look on. Each browser is sent the newest frame
as soon as it has taken the one before. So a slow one loses frames and nothing else. Nothing is loaded from elsewhere.
"""

import asyncio
import json
from collections.abc import Callable
from functools import partial
from importlib import resources
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from blackboard.errors import UserError
from blackboard.view.feed import Source
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
MAX_CHOICE = 200  # characters of a subject that a browser names
POLICY = 1008  # WebSocket close code: not allowed here


class Page:
    """What all browsers share: the frames, and news of them. `look` at them in a loop of its own."""

    def __init__(self, source: Source, team: str, clock: Callable[[], float]) -> None:
        """`clock` gives seconds of a monotonic clock."""
        self.source, self.clock = source, clock
        self.frames = Frames(source.fold, team)
        self.browsers = 0
        self._spent = 0.0  # seconds on making the newest frame, for all subjects that were chosen
        self._news = asyncio.Condition()

    async def look(self) -> None:
        """Announce the frame that is due to all who wait for it. Frames take at most a third of the time."""
        self.frames.remember(self.source.now)
        self.frames.gap = max(LEAST_GAP, 3 * self._spent)
        if self.frames.look(self.clock(), self.source.now):
            self._spent = 0.0
            async with self._news:
                self._news.notify_all()

    def newest(self, chosen: str) -> bytes:
        """The newest frame, for a browser that has chosen a subject."""
        begin = self.clock()
        packed = self.frames.newest(chosen)
        self._spent += self.clock() - begin
        return packed

    async def newer_than(self, number: int) -> int:
        """Wait for a frame that is newer than `number`, and return its own number."""
        async with self._news:
            await self._news.wait_for(lambda: self.frames.number > number)
            return self.frames.number

    def state(self) -> dict[str, Any]:
        """Of what the page is: a running team, or a tape and whether it was read to its end."""
        return {"tape": self.source.done is not None, "done": bool(self.source.done), "skipped": self.source.skipped}


def application(page: Page, hosts: list[str], drift: float) -> Starlette:
    """The page as an ASGI application, for browsers that call it by one of `hosts`; `drift` as in `explain`."""
    routes = [
        Route("/", _file),
        Route("/past", partial(_past, page)),
        Route("/frame", partial(_frame, page)),
        Route("/why", partial(_why, page, drift)),
        Route("/{name}", _file),
        WebSocketRoute("/live", partial(_live, page)),
    ]
    return Starlette(routes=routes, middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=hosts)])


async def _file(request: Request) -> Response:
    """A file of the page."""
    name = request.path_params.get("name", "index.html")
    if name not in FILES:
        return Response("no such file", 404)
    content = resources.files("blackboard.view.web").joinpath("page", name).read_bytes()
    return Response(content, media_type=FILES[name], headers=HEADERS)


async def _past(page: Page, request: Request) -> Response:
    """What is over, from a tick on."""
    past = page.frames.past(_tick(request, "from") or 0)
    answer = b'{"source":%b,"past":%b}' % (json.dumps(page.state()).encode(), past)
    return Response(answer, media_type="application/json", headers=HEADERS)


async def _frame(page: Page, request: Request) -> Response:
    """The frame of a tick that is over."""
    tick, query = _tick(request), request.query_params
    packed = None if tick is None else page.frames.at(query.get("run", ""), tick, query.get("subject", ""))
    if packed is None:
        return Response("this tick is not kept here", 404, headers=HEADERS)
    return Response(packed, media_type="application/octet-stream", headers=HEADERS)


async def _why(page: Page, drift: float, request: Request) -> Response:
    """The reasons of a subject's belief, at a tick or at the newest one."""
    team, tick, query = page.frames.team, _tick(request), request.query_params
    moment = team.moments.newest if tick is None else team.moments.at(tick)
    if moment is None or query.get("run", moment.run) != moment.run:
        return JSONResponse({"sentences": ["This tick is no longer kept here."]}, headers=HEADERS)
    try:
        told = await asyncio.to_thread(explain, team, moment, query.get("subject", ""), drift)
    except UserError as error:
        return JSONResponse({"sentences": [str(error)]}, headers=HEADERS)
    return JSONResponse({"sentences": sentences(told), "why": told}, headers=HEADERS)


def _tick(request: Request, name: str = "tick") -> int | None:
    """The tick that a browser names; None where it names none, or no number."""
    told = request.query_params.get(name, "")
    return int(told) if told.isdecimal() and len(told) < 17 else None


async def _live(page: Page, socket: WebSocket) -> None:
    """The newest frames, until the browser leaves."""
    origin = socket.headers.get("origin")
    if origin is not None and origin.partition("://")[2] != socket.headers.get("host"):
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


async def _send_newest(page: Page, socket: WebSocket) -> None:
    """Send each newest frame until the browser leaves. What it sends is the subject that it has chosen."""
    chosen, changed = "", asyncio.Event()

    async def send() -> None:
        number = 0
        while True:
            waiting = [asyncio.create_task(page.newer_than(number)), asyncio.create_task(changed.wait())]
            try:
                await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in waiting:
                    task.cancel()
            changed.clear()
            number = page.frames.number
            if number:
                await socket.send_bytes(page.newest(chosen))  # returns when the connection has room again

    async def listen() -> None:
        nonlocal chosen
        while True:
            chosen = (await socket.receive_text())[:MAX_CHOICE]
            changed.set()

    tasks = [asyncio.create_task(send()), asyncio.create_task(listen())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception) and not isinstance(result, WebSocketDisconnect | RuntimeError | KeyError):
                raise result
