"""Evidence of a board's own robots that it passes on to the other boards, in one message a tick. Pure."""

from collections import Counter, deque

from blackboard.wire.evidence import Forwarded
from blackboard.wire.raw import MAX_BYTES, pack_map
from blackboard.wire.types import MAX_OPINIONS

ROOM = MAX_BYTES * 9 // 10  # bytes for the evidence in a message; the tracks have the rest


class PassedOn:
    """Mutable: evidence that waits for the next message. Too much: the robot with most loses its oldest piece (`joint_dropped`)."""

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        #: Robot -> team times (s) and evidence, the oldest first.
        self._waiting: dict[str, deque[tuple[float, Forwarded]]] = {}

    def add(self, time: float, forwarded: Forwarded) -> None:
        """Queue a piece of evidence, of a team time (s)."""
        self._waiting.setdefault(forwarded.robot, deque()).append((time, forwarded))
        lengths = {robot: len(waiting) for robot, waiting in self._waiting.items()}
        if sum(lengths.values()) > MAX_OPINIONS:
            self._drop_of(lengths)

    def take(self, time: float) -> list[Forwarded]:
        """Empty the queue at a team time (s): its evidence, by robot and tick, as much as a message holds."""
        sizes = {robot: [_size(one) for _, one in waiting] for robot, waiting in self._waiting.items()}
        totals = {robot: sum(each) for robot, each in sizes.items()}
        while sum(totals.values()) > ROOM:
            robot = self._drop_of(totals)
            totals[robot] -= sizes[robot].pop(0)
        waiting, self._waiting = self._waiting, {}
        rows = [one.model_copy(update={"age": time - then}) for each in waiting.values() for then, one in each]
        return sorted(rows, key=lambda forwarded: (forwarded.robot, forwarded.tick))

    def _drop_of(self, amounts: dict[str, int]) -> str:
        """Drop the oldest piece of the robot with the largest amount, and return that robot; among equals the first by name."""
        robot = min(amounts, key=lambda robot: (-amounts[robot], robot))
        self._waiting[robot].popleft()
        self._counters["joint_dropped"] += 1
        return robot


def _size(forwarded: Forwarded) -> int:
    """Bytes of a piece of evidence in a message."""
    return len(pack_map(forwarded.model_dump(exclude_defaults=True, exclude_none=True)))
