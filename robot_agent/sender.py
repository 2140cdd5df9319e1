"""What a robot on a poor link says, by what its team knows: a `Budget` beside what was agreed on last. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress

from blackboard.errors import Refused
from blackboard.wire.evidence import unpack_state
from blackboard.wire.messages import Consensus, Report
from robot_agent.budget import Budget, Known, Said


class Sender:
    """Leaves out, or says more coarsely, what is worth less than its bytes."""

    def __init__(self, budget: Budget, robot: str) -> None:
        self._budget, self._own = budget, f"robot/{robot}"
        self._known: dict[str, Known] = {}  # what was agreed last, by subject
        self._boards: set[str] = set()  # that were there in the newest tick

    def choose(
        self,
        reports: Sequence[Report],
        time: float,
        speed: float | None,
        agreed: Mapping[str, Consensus],
        boards: Collection[str],
    ) -> Said:
        """What is sent of the reports of a tick at a team time (s), after what was `agreed` since the last, to `boards`."""
        self._known |= {subject: self._known_of(consensus) for subject, consensus in agreed.items()}
        if set(boards) - self._boards:
            self._budget.repeat_state()
        self._boards = set(boards)
        said = self._budget.choose(reports, time, speed, self._known)
        wanted = {report.subject for report in reports}
        self._known = {subject: known for subject, known in self._known.items() if subject in wanted}
        return said

    def _known_of(self, agreed: Consensus) -> Known:
        state = None
        if agreed.subject == self._own and agreed.state is not None:
            with suppress(Refused):
                state = unpack_state(agreed.state)
        return Known(agreed.entropy, agreed.rule == "joint", state)
