"""What is wrong with a line between a process and its router: how late each piece of a TCP stream comes. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SEGMENT = 1448  # bytes of a TCP segment on Ethernet
RETRANSMISSION = 0.2  # seconds until Linux sends a lost segment again, at least; doubled each time it is lost again
LONGEST = 3.0  # seconds that a piece is kept back by losses, at most


@dataclass(frozen=True)
class Trouble:
    """Of one direction of a line; times in seconds.

    TCP loses no bytes: what a lost segment costs is time, its own and that of all behind it. So `loss` is the share of segments that
    come `RETRANSMISSION` seconds later. A retransmission on hearing duplicate acknowledgements, which is quicker, is left out.
    """

    delay: float = 0.0
    jitter: float = 0.0  # the delay is drawn evenly from delay - jitter to delay + jitter
    loss: float = 0.0  # 0 to 1


class OneDirection:
    """One direction of a connection; the order is kept, as TCP does."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._newest = rng, 0.0

    def arrives(self, now: float, size: int, trouble: Trouble) -> float:
        """When a piece of `size` bytes that was sent `now` arrives, on the clock of `now` (seconds)."""
        late = max(0.0, trouble.delay + trouble.jitter * float(self._rng.uniform(-1, 1)))
        if trouble.loss > 0:
            late += self._kept_back(-(-size // SEGMENT), trouble.loss)
        self._newest = max(self._newest, now + late)
        return self._newest

    def _kept_back(self, segments: int, loss: float) -> float:
        """The slowest of some segments: seconds that losses cost it."""
        slowest = 0.0
        for _ in range(segments):
            kept, wait = 0.0, RETRANSMISSION
            while kept < LONGEST and self._rng.random() < loss:
                kept, wait = kept + wait, 2 * wait
            slowest = max(slowest, kept)
        return min(slowest, LONGEST)
