"""What a process with keys hears at the router's door: whether its certificate is known there, and what of it was denied."""

import logging
import threading
from collections.abc import Callable

from blackboard.access.doorkeeper import read
from blackboard.access.identity import Identity
from blackboard.errors import UserError
from blackboard.process.clock import UnixClock
from blackboard.wire.envelope import Envelope

log = logging.getLogger(__name__)

PATIENCE = 2.0  # seconds for the router to say that it knows a certificate
PAUSE = 0.1  # seconds between two questions
LARGEST = 4096  # bytes of what a door says

Get = Callable[[str, float], list[Envelope]]  # `Link.get`


class Knock:
    """The door of one member. Zenoh itself opens a session for a revoked certificate too, and drops what it sends without a word."""

    def __init__(self, name: str, identity: Identity, clock: UnixClock) -> None:
        self.identity, self.denied = identity, 0  # messages of this member, as the router counts them
        self._name, self._clock, self._expired = name, clock, False

    @property
    def key(self) -> str:
        """The key on which the router speaks to this member."""
        return self.identity.member.door

    def ask(self, get: Get) -> None:
        """Ask until the router answers. UserError: it does not, because it does not know the certificate."""
        end, pause = self._clock.now() + PATIENCE, threading.Event()
        while not (answers := get(self.key, 1.0)):
            if self._clock.now() > end:
                member = self.identity.member
                raise UserError(
                    f"{self._name}: the router lets {member.common_name} of team {member.team} do nothing: its certificate is "
                    "revoked, or the router was not started again since `blackboard keys` made it"
                )
            pause.wait(PAUSE)
        self.denied = max((told[0] for answer in answers if (told := read(answer.payload))), default=0)

    def hear_router(self, payload: bytes) -> None:
        """Take what the router says, and log what it denied since."""
        told = read(payload)
        if told is not None:
            if told[1] and told[0] > self.denied:
                log.warning("%s: the router denied: %r (%d denials so far)", self._name, told[1], told[0])
            self.denied = told[0]

    def denials(self, get: Get) -> str | None:
        """What the router has denied this member of late, in one line, or None."""
        for answer in get(self.key, 1.0):
            told = read(answer.payload)
            if told is not None and told[1]:
                return f"the router has denied {told[0]} messages of {self.identity.member.who}, just now: {told[1]!r}"
        return None

    def check_time(self) -> None:
        """Log once that the certificate's time is over: then Zenoh closes the connection, and no new one is let in."""
        if not self._expired:
            try:
                self.identity.check_time(self._clock.now())
            except UserError as error:
                self._expired = True
                log.error("%s", error)
