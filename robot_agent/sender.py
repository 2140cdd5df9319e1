"""What a robot says of its reports by what its team knows, a `Budget` beside what was agreed on last, and of its speed. Pure."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from blackboard.errors import Refused
from blackboard.wire.gaussians import unpack_state
from blackboard.wire.messages import Consensus, Report
from robot_agent.budget import Budget, Sending
from robot_agent.worth import TeamKnowledge

FASTEST = 1e6  # unit per second that is said at most
SPAN = 5  # ticks over which a steady speed is averaged


def fastest(speeds: Sequence[float], *, steady: bool) -> float | None:
    """The greatest of the speeds of the last ticks (unit per second), by which boards widen old reports; None before any.

    `steady`: of their means over a few ticks, for a robot that is often silent. Its reports grow old before the next one, and the
    noise of a single tick's odometry would let them spread too far.
    """
    if not speeds:
        return None
    if not steady:
        return min(max(speeds), FASTEST)
    ticks = min(SPAN, len(speeds))
    means = [sum(speeds[i : i + ticks]) / ticks for i in range(len(speeds) - ticks + 1)]
    return float(np.float32(min(max(means), FASTEST)))


class Sender:
    """Leaves out, or says more coarsely, what is worth less than its bytes."""

    def __init__(self, budget: Budget, robot: str) -> None:
        self._budget, self._own = budget, f"robot/{robot}"
        self._standing: dict[str, TeamKnowledge] = {}  # what was agreed last, by subject
        self._arrivals = 0  # of boards, until the newest tick

    def choose(
        self,
        reports: Sequence[Report],
        time: float,
        speed: float | None,
        agreed: Mapping[str, Consensus],
        arrivals: int,
    ) -> Sending:
        """What is sent of the reports of a tick at a team time (s), after what was `agreed` since the last.

        `arrivals`: how often a board has come. One that was started again needs the whole state, however soon it is back.
        """
        self._standing |= {subject: self._standing_of(consensus) for subject, consensus in agreed.items()}
        if arrivals != self._arrivals:
            self._arrivals = arrivals
            self._budget.repeat_state()
        choice = self._budget.choose(reports, time, speed, self._standing)
        wanted = {report.subject for report in reports}
        self._standing = {subject: standing for subject, standing in self._standing.items() if subject in wanted}
        return choice

    def _standing_of(self, agreed: Consensus) -> TeamKnowledge:
        state = None
        if agreed.subject == self._own and agreed.state is not None:
            with suppress(Refused):
                state = unpack_state(agreed.state)
        return TeamKnowledge(agreed.entropy, agreed.rule == "joint", state)
