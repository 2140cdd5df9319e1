"""Joints of one process that are the same to the bit, and take the same evidence: settled once for all of them.

In lockstep all boards of a team settle the same. In processes each does so for itself; in one process that is done once.
"""

import io
import pickle
from collections.abc import Callable, Sequence

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.team import TeamJoint

#: Takes a joint, a tick, its seconds and its evidence; returns the joint after that. The one that was given is not used any more.
Settle = Callable[[TeamJoint, int, float, Sequence[Evidence]], TeamJoint]


def settle_alone(team: TeamJoint, tick: int, dt: float, reports: Sequence[Evidence]) -> TeamJoint:
    """`TeamJoint.settle`."""
    team.settle(tick, dt, reports)
    return team


class SettledOnce:
    """Mutable: remembers the newest settlement, by all that went into it."""

    def __init__(self) -> None:
        self._newest: tuple[bytes, TeamJoint] | None = None

    def __call__(self, team: TeamJoint, tick: int, dt: float, reports: Sequence[Evidence]) -> TeamJoint:
        """Settle, or copy what was settled last from the same content. Degenerate: as `settle_alone`."""
        content = _content(team, tick, dt, sorted(reports, key=lambda evidence: (evidence.robot, evidence.epoch)))
        if self._newest is None or self._newest[0] != content:
            team.settle(tick, dt, reports)
            self._newest = content, team
        return self._newest[1].copy()


def _content(*of: object) -> bytes:
    """The same bytes for what is equal in all its parts."""
    written = io.BytesIO()
    pickler = pickle.Pickler(written, pickle.HIGHEST_PROTOCOL)
    pickler.fast = True  # without references to what was written before, which differ between equals
    pickler.dump(of)
    return written.getvalue()
