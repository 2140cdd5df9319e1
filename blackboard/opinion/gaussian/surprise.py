"""Whether what a robot has said makes what others measure more surprising than it was without it.

`influence` has for each robot how far it has moved the others (D), and the covariance that this has if it is honest (C). Without it
places would be off by D, with C more covariance. Evidence of others has the innovation v with the covariance S, and the derivatives
H. By so many nats it is likelier without what the robot has said:

    l = ln N(v + H D; 0, S + H C H^T) - ln N(v; 0, S)

If the robot is honest, v is of N(0, S) whatever was before. Then exp l, a ratio of two densities, is 1 in the mean. So from any moment
on the sum of l exceeds ln n in at most one of n cases (Ville 1939). It begins anew where it is below 0 (Page, Biometrika 41, 1954),
and comes to ln n after n pieces of evidence in the mean, or later (Lorden, Annals of Mathematical Statistics 42, 1971).

A liar may also say again what the team believes, with noise of its own. It moves nobody, but makes the team too sure, and what others
measure is too far off then. That is in the covariances.

Who is found out moves its own place alone, and what it has moved is taken back.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from blackboard.opinion.gaussian.copying import Copyable

#: Cases in one of which an honest robot is doubted. A tick of six robots has dozens: of 1000, the demo has one in some minutes.
SELDOM = 1e4
HELD = 5.0  # seconds for which a robot is doubted then


@dataclass
class Surprise(Copyable):
    """Mutable; `pass_time` once per tick, `on_evidence` once per piece of evidence that is taken."""

    _nats: dict[str, float] = field(default_factory=dict)  # robot -> the sum
    _held: dict[str, float] = field(default_factory=dict)  # robot -> for how many seconds more it is doubted

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._held = {robot: left - dt for robot, left in self._held.items() if left > dt}

    def on_evidence(self, nats: Mapping[str, float]) -> None:
        """Take how much likelier somebody's evidence is without what each robot has said."""
        for robot, likelier in nats.items():
            self._nats[robot] = max(0.0, self._nats.get(robot, 0.0) + likelier)
        worst = max(self._nats, key=self._nats.__getitem__, default=None)
        if worst is not None and self._nats[worst] > math.log(SELDOM):
            self._held[worst] = HELD

    def doubts(self, robot: str) -> bool:
        """Whether the others' evidence has lately been likelier without what it has said."""
        return robot in self._held

    def forget_scores(self) -> None:
        """What was measured was held against a belief that is not held any more. Who is doubted for it stays so."""
        self._nats = {}

    def forget(self, robot: str) -> None:
        """Drop what concerns a robot."""
        self._nats.pop(robot, None)
        self._held.pop(robot, None)
