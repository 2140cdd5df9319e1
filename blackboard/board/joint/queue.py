"""Evidence as it arrives: of each robot and tick once, until it is settled. Pure.

Evidence is numbered by robot, epoch and tick, so that what a robot reports to two boards, or what two boards forward, counts once.
"""

from collections import Counter, deque
from dataclasses import replace

from blackboard.board.joint.evidence import shrank, unpack
from blackboard.board.joint.room import ObjectRoom
from blackboard.errors import Refused
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.wire.evidence import PackedEvidence

MAX_ROBOTS = 64
EPOCHS = 8  # of one robot of which it is known what was taken; a stale one may arrive after the newest
MAX_WAITING = 64  # ticks of one robot that wait to be settled; the oldest are dropped


class EvidenceQueue:
    """Mutable: what was taken of each robot, and what of it waits to be settled. Robots are named as `r1`."""

    def __init__(self, counters: Counter[str], *, future: float, kept: float) -> None:
        """`future`: seconds that an epoch may begin ahead of its evidence; `kept`: as in `ObjectRoom`.

        Counted are `joint_dropped` and `unknown_kinds`.
        """
        self._counters, self._future, self._room = counters, future, ObjectRoom(kept)
        self.until: dict[str, float] = {}  # robot -> team time (s) until which its evidence was taken
        self.states: dict[str, Moments | None] = {}  # robot -> its own belief in the newest
        self._newest: dict[str, PackedEvidence] = {}  # robot -> the newest that was taken
        self._taken: dict[str, dict[int, int]] = {}  # robot -> its last epochs -> the newest tick that was taken
        self._waiting: dict[str, deque[Evidence]] = {}

    def take(self, robot: str, tick: int, time: float, packed: PackedEvidence, skew: float) -> bool:
        """Take the evidence of a robot's tick at a team time (s), once: whether it is new.

        `skew` is how many seconds the robot's clock, by which it numbers its epochs, may be ahead. Where that clock was set back, a
        smaller epoch begins: what it says is later all the same. An epoch after which another one began is over for good.

        Refused: "mass", "too-many", "future" (an epoch that has not begun), "backwards" (sums that shrink within an epoch, as
        of a robot that was started again and did not begin a greater one).
        """
        if self._is_over(robot, tick, time, packed):
            return False
        self._check(robot, time, packed, skew)
        evidence = unpack(robot, tick, time, packed)
        bounded = self._room.bounded(evidence, len(self._newest))
        self._counters["joint_dropped"] += len(evidence.relatives) - len(bounded.relatives)
        if unknown := sum(not sighting.is_known for sighting in packed.seen):
            self._counters["unknown_kinds"] += unknown  # sightings of kinds that are not known here
        others = [(epoch, newest) for epoch, newest in self._taken.get(robot, {}).items() if epoch != packed.epoch]
        self._taken[robot] = dict([*others[1 - EPOCHS :], (packed.epoch, tick)])
        self._newest[robot], self.states[robot], self.until[robot] = packed, evidence.belief, time
        waiting = self._waiting.setdefault(robot, deque())
        waiting.append(bounded)
        if len(waiting) > MAX_WAITING:
            waiting.popleft()
            self._counters["joint_dropped"] += 1  # a tick that waited too long
        return True

    def _is_over(self, robot: str, tick: int, time: float, packed: PackedEvidence) -> bool:
        """Whether the evidence was taken already, or is older than what was."""
        before, taken = self._newest.get(robot), self._taken.get(robot, {})
        if before is not None and packed.epoch != before.epoch:
            return packed.epoch in taken or (packed.epoch < before.epoch and time <= self.until[robot])
        return tick <= taken.get(packed.epoch, -1)

    def _check(self, robot: str, time: float, packed: PackedEvidence, skew: float) -> None:
        before = self._newest.get(robot)
        if packed.epoch > 1000 * (time + self._future + skew):
            raise Refused("future", f"epoch {packed.epoch} of {robot} is later than {1000 * time:.0f} ms of team time")
        if before is not None and shrank(before, packed):
            raise Refused(
                "backwards",
                f"travelled of {robot} shrank within epoch {packed.epoch}: it is summed since the epoch began; after a new start "
                "begin a greater epoch",
            )
        if before is None and len(self._newest) >= MAX_ROBOTS:
            raise Refused("too-many", f"{robot} would be one more than {MAX_ROBOTS} robots in the joint")

    @property
    def steps(self) -> int:
        """How many ticks wait of the robot of which most do."""
        return max((len(waiting) for waiting in self._waiting.values()), default=0)

    def pop(self, number: int) -> list[Evidence]:
        """Of every robot the oldest that waits, as of tick `number`."""
        return [replace(waiting.popleft(), tick=number) for waiting in self._waiting.values() if waiting]
