"""What the processes of a team sent, received and refused in a run: the sum of what their newest statuses count. Pure."""

from collections import Counter
from collections.abc import Mapping

from blackboard.wire.messages import Status

MAX_PROCESSES = 256


class Traffic:
    """The newest status of each process. A robot may send its own to several sub-teams, and counts once."""

    def __init__(self) -> None:
        #: (its sub-team if a board) and process -> counters and refused of its newest status
        self._statuses: dict[tuple[str, str], tuple[dict[str, int], dict[str, int]]] = {}

    def hear_status(self, sub_team: str, status: Status) -> None:
        """Take a status; processes beyond the first `MAX_PROCESSES` are not counted."""
        name = sub_team if status.kind == "board" else "", status.process
        if name in self._statuses:
            self._statuses[name] = self._statuses[name] if status.is_brief else (status.counters, status.refused)
        elif len(self._statuses) < MAX_PROCESSES:
            self._statuses[name] = status.counters, status.refused

    def counters(self, own: Mapping[str, int]) -> Counter[str]:
        """The counters of all processes, and `own`: "sent", "received", "dropped", "bytes" and whatever else they count."""
        return sum((Counter(counters) for counters, _ in self._statuses.values()), Counter(own))

    def refused(self, own: Mapping[str, int]) -> Counter[str]:
        """Reason -> messages that were refused by any process, and `own`."""
        return sum((Counter(refused) for _, refused in self._statuses.values()), Counter(own))
