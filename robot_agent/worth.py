"""What reports are worth, in nats of log score, as they are and coarser (`budget`). Pure."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import AXES, STATES
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import unpack_increment, unpack_state
from blackboard.wire.messages import PackedBelief, Report
from robot_agent.coarse import coarser

#: Precisions beside the one that a report has: nats between two levels, and how far below the peak the box reaches.
FINER, COARSER, COARSEST = (0.2, 8.0), (0.5, 7.0), (1.0, 5.0)
MOST = 20.0  # nats that an increment counts at most
FLOOR = 1e-12  # of a probability in a logarithm


@dataclass(frozen=True, eq=False)
class Option:
    """A report as it could be sent: its bytes on the wire, what it is worth, and the belief that a board then has."""

    report: Report
    size: int
    worth: float  # nats
    belief: Belief
    whole: bool = True  # False: the motion alone


@dataclass(frozen=True)
class TeamKnowledge:
    """What the team agreed on about a subject: the entropy in nats, and whether it is a marginal of the boards' joint."""

    entropy: float
    joint: bool
    state: Moments | None = None  # of the robot itself in that joint


@dataclass(frozen=True)
class Offers:
    """A report about what a robot believes, as it is and coarser; `size` counts its bytes on the wire."""

    grid: Grid
    robot: str
    size: Callable[[Report], int]

    def is_mate(self, subject: str) -> bool:
        """Whether a subject is another robot."""
        return subject.startswith("robot/") and subject != f"robot/{self.robot}"

    def of_belief(
        self, report: Report, best: Belief, stale: Belief, known: TeamKnowledge | None, share: float
    ) -> list[Option]:
        """The report as it is, then coarser."""
        informed, first = report.informed, unpack(report.belief, self.grid)
        if self.is_mate(report.subject):
            return self._of_mate(report, first, stale, known, share)
        lost = divergence(best.p, stale.p)
        options = [self._option(report, best, best, lost, share)]
        # The key says that the source is the only one.
        plain = report.model_copy(update={"ancestors": {}, "unnamed": []})
        for precisions in (
            (FINER, FINER),
            (COARSER, FINER),
            (COARSER, COARSER),
            (COARSEST, COARSER),
            (COARSEST, COARSEST),
        ):
            changes: dict[str, object] = {"belief": coarser(first, report.belief, *precisions[0])}
            told = changes["belief"]
            if informed is not None:
                told = coarser(best, informed.belief, *precisions[1])
                changes["informed"] = informed.model_copy(update={"belief": told})
            assert isinstance(told, PackedBelief)
            options.append(self._option(plain.model_copy(update=changes), unpack(told, self.grid), best, lost, share))
        return options

    def _of_mate(
        self, report: Report, first: Belief, stale: Belief, known: TeamKnowledge | None, factor: float
    ) -> list[Option]:
        """What a robot sees of a mate in a tick replaces what it saw before, and is no more right for being another noise.

        So it is worth what its lesser age adds to the precision, the inverse of the area, of all that the team knows. What the team
        made of it comes from the team, and is left out.
        """
        area = float(self.grid.size) if known is None else math.exp(known.entropy)
        sharpness = math.exp(-entropy_of(first.p))
        more = max(0.0, sharpness - math.exp(-entropy_of(stale.p)))
        worth = math.log1p(area * more)
        share = min(1.0, area * sharpness)
        options = [Option(report, self.size(report), worth * factor, first)]
        plain = report.model_copy(update={"ancestors": {}, "informed": None})
        for precision in (FINER, COARSER, COARSEST):
            packed = coarser(first, report.belief, *precision)
            shown, told = plain.model_copy(update={"belief": packed}), unpack(packed, self.grid)
            lost = share * divergence(first.p, told.p)
            options.append(Option(shown, self.size(shown), (worth - lost) * factor, told))
        return options

    def _option(self, report: Report, told: Belief, best: Belief, lost: float, share: float) -> Option:
        worth = share * (lost - divergence(best.p, told.p))
        return Option(report, self.size(report), worth, told)


def gained(evidence: PackedEvidence, known: Moments | None) -> float:
    """Nats that an increment adds to what is `known` of a robot's place, or where no board knows it, to what it knows itself."""
    if evidence.increment is None or (known is None and evidence.state is None):
        return 0.0
    try:
        information = unpack_increment(evidence.increment).information
        if known is not None:
            before = known.covariance
            after = np.linalg.solve(np.eye(STATES) + before @ information, before)
        else:
            assert evidence.state is not None
            after = unpack_state(evidence.state).covariance
            before = np.linalg.solve(np.eye(STATES) - after @ information, after)
        nats = 0.5 * math.log(np.linalg.det(before[AXES, AXES]) / np.linalg.det(after[AXES, AXES]))
    except (Refused, ValueError, np.linalg.LinAlgError):  # the numbers of a robot that knows nothing yet
        return MOST
    return float(min(MOST, max(0.0, nats))) if math.isfinite(nats) else MOST


def divergence(p: Array, q: Array) -> float:
    """KL(p || q) in nats."""
    return float((p * (np.log(np.maximum(p, FLOOR)) - np.log(np.maximum(q, FLOOR)))).sum())
