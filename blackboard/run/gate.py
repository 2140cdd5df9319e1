"""A router with keys: it reads in its own Zenoh's log what was denied, and informs members and the operator."""

import fcntl
import logging
import math
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO, cast

from blackboard.access.denials import LEVELS, DenialReader
from blackboard.access.doorkeeper import Doorkeeper, common_names
from blackboard.net.link import Link, start_zenoh_log
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.process.failures import Failures
from blackboard.run.terminal import Printed

log = logging.getLogger(__name__)

PIPE = 1 << 20  # bytes of Zenoh's log that wait, as far as the system allows; Zenoh waits where it is full
PIECE = 1 << 18  # bytes, more than one event can have
LOOK = 0.25  # seconds between two looks at what was denied
AWAITED = 20.0  # seconds within which Zenoh says that its access control is on, also on a machine that is slow


def keep_door(config: LinkConfig, stop: threading.Event, ready: Callable[[], object]) -> None:
    """Run a router with mutual TLS and access control until it is stopped; `ready` is called once it serves.

    UserError: the directory of keys has no certificate for a router.
    """
    identity = config.identity()
    assert identity is not None
    known = common_names(identity.settings().get("access_control", {"subjects": []}))
    keeper, clock = Doorkeeper(known, identity.member.team), UnixClock()
    listening = _Listening(keeper)
    with Link(config, "router", stopped=stop.is_set) as link:
        for envelope in keeper.greet():
            link.send(envelope)
        ready()
        awaited_until = clock.now() + AWAITED
        while not stop.wait(LOOK):
            if not listening.enabled and clock.now() >= awaited_until:
                awaited_until = math.inf
                log.warning(
                    "Zenoh does not say what its access control denies, so it is not counted: unset RUST_LOG, on Linux"
                )
            _ = link.counters  # warns once when the router's certificate has expired
            with listening.lock:
                told = keeper.messages_due(clock.now())
            for envelope in told:
                link.send(envelope)


class _Listening:
    """A thread that reads Zenoh's log from a pipe in place of standard output, to which Zenoh writes it.

    The thread must not end before the process, because Zenoh would wait for it.
    """

    def __init__(self, keeper: Doorkeeper) -> None:
        self.lock = threading.Lock()
        self._keeper, self._reader, self._enabled = keeper, DenialReader(), threading.Event()
        self._failures = Failures()
        self._show = "RUST_LOG" in os.environ  # then the door has started Zenoh's log, for standard error
        # each read gives one write of Zenoh, which is one event; where the system cannot do that, nothing is counted
        self._counts = hasattr(os, "pipe2")
        taken, given = os.pipe2(os.O_DIRECT) if self._counts else os.pipe()
        with suppress(AttributeError, OSError):  # Linux alone can, and lets unprivileged users have so much
            fcntl.fcntl(given, fcntl.F_SETPIPE_SZ, PIPE)
        sys.stdout.flush()
        if not self._show:
            sys.stdout = cast(TextIO, Printed(os.fdopen(os.dup(1), "w")))
        os.dup2(given, 1)
        os.close(given)
        os.environ |= {"RUST_LOG": os.environ.get("RUST_LOG", LEVELS), "NO_COLOR": "1"}
        start_zenoh_log()
        threading.Thread(target=self._read, args=(taken,), daemon=True, name="denials").start()

    @property
    def enabled(self) -> bool:
        """Whether Zenoh has said that its access control is on."""
        return self._enabled.is_set()

    def _read(self, descriptor: int) -> None:
        while event := os.read(descriptor, PIECE):
            if not self._counts:
                continue
            with self._failures.survive("Zenoh's log"), self.lock:
                denial = self._reader.read(event)
                if denial is not None:
                    self._keeper.count([denial])
            if self._reader.enabled:
                self._enabled.set()
            other, self._reader.other = self._reader.other, []
            for line in [] if self._show else other:
                log.warning("zenoh", extra={"fields": {"said": line}})
            if self._show:
                sys.stderr.write(event.decode("utf-8", "replace"))
