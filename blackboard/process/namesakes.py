"""Whether another process speaks under the name of this one, by the statuses that come on its own key. Pure, and bounded.

What a process sends itself is not delivered to it, so a status there is another's. It tells the two apart from a process that was
started again: what the one before it sent last may still be on its way, but not for long.
"""

import math
from collections.abc import Iterable

from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

SURE = 3.0  # seconds over which another must have spoken; statuses come once a second
GAP = 10.0  # seconds of silence after which it is as if none had spoken, as long as there was no warning
AGAIN = 60.0  # seconds of silence after which the next one that speaks gives a warning again


class Namesakes:
    """All times are Unix time in seconds."""

    def __init__(self, tokens: Iterable[str]) -> None:
        """`tokens` are those that this process holds; without a robot's or a board's among them there is no warning."""
        self.count = 0  # warnings
        self._keys = {key for token in tokens if (key := _status_key(token)) is not None}
        self._since = self._heard_at = -math.inf  # of what the other one says
        self._warned = False

    def hear_envelope(self, envelope: Envelope, now: float) -> str | None:
        """Take what arrived; the line to log where it shows that another process has this name, once as long as that goes on."""
        if envelope.key not in self._keys or envelope.kind is not Kind.PUT:
            return None
        if not 0.0 <= now - self._heard_at <= (AGAIN if self._warned else GAP):
            self._since, self._warned = now, False
        self._heard_at = now
        if self._warned or now - self._since < SURE:
            return None
        self.count, self._warned = self.count + 1, True
        return f"{envelope.key}: another process sends under this name, too; stop one of the two, or give it another name (--id)"


def _status_key(token: str) -> str | None:
    """On which key the holder of a token sends its statuses; None where it sends none."""
    topic, parts = keys.parse(token) or (None, {})
    if topic not in (keys.MEMBER, keys.BOARD):
        return None
    return keys.STATUS.key(team=parts["team"], sub_team=parts["sub_team"], process=parts[topic.owner])
