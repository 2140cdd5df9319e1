"""Connections to the live page's server that do not come to their point: closed after a while, or for newer ones."""

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

PATIENCE = 30.0  # seconds in which a connection must have had an answer, a slow one read to its end
MOST = 256  # connections that wait for a request or an answer; the one that waits longest is closed for another one
PING = 20.0  # seconds between two pings of a browser, and until it must have answered
NO_TEXT = 1007  # WebSocket close code: not the kind of data that was announced


class Visit(H11Protocol):
    """A connection over HTTP. uvicorn itself waits for the rest of a request without end."""

    _began = 0.0  # when it began to wait, seconds of the event loop
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait()
        waiting = [visit for visit in self.connections if isinstance(visit, Visit) and not visit.transport.is_closing()]
        if len(waiting) > MOST:
            min(waiting, key=lambda visit: visit._began).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        self._wait()
        super().on_response_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer once to a request whose rest is no HTTP; uvicorn would log tracebacks of a second answer."""
        if self.cycle is not None and self.cycle.response_started:
            self.transport.close()
            return
        if self.cycle is not None:
            self.cycle.disconnected = True  # what the application answers is dropped
        super().send_400_response(msg)

    def handle_websocket_upgrade(self, event: object) -> None:
        self._stop()
        super().handle_websocket_upgrade(event)  # type: ignore[arg-type]

    def _wait(self) -> None:
        self._stop()
        self._began = self.loop.time()
        self._timer = self.loop.call_later(PATIENCE, self.transport.abort)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


class Watching(WebSocketsSansIOProtocol):
    """A browser's WebSocket."""

    def send_receive_event_to_app(self) -> None:
        """Hand a message on. Text that is no UTF-8 ends the connection; uvicorn would log a traceback of it, too."""
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self.conn.send_close(NO_TEXT)
                self.handle_parser_exception()
                return
        super().send_receive_event_to_app()

    def keepalive_timeout(self) -> None:
        """End the connection of a browser that does not answer, also where it has not read what was sent."""
        super().keepalive_timeout()
        self.transport.abort()
