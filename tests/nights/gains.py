"""What a robot gains by itself and sends now and then: all that it gained since it sent last, and none of it twice."""

from dataclasses import dataclass, replace

import numpy as np

from blackboard.board.joint.evidence import unpack
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import POSE, correct, drive
from blackboard.wire.messages import Report
from robot_agent.gaussian.agent import JointAgent
from robot_agent.gaussian.filter import FirstHand
from robot_agent.service import AgentService
from tests.nights.events import Began, Event, Said
from tests.nights.night import Night
from tests.nights.oracles import Oracle

#: Between which shares of a robot's own variance what its boards can know of its place is: they move it by sums over some ticks.
WHOLE = 0.75, 1.3


@dataclass(frozen=True, eq=False)
class Sent:
    """A robot when it sent what it had gained: by what its filter then was, and where that had it."""

    evidence: Evidence
    belief: Moments
    joint: Joint  # another one where the belief was given up since
    widened: tuple[int, ...]  # priors that were contradicted until then

    @classmethod
    def of(cls, evidence: Evidence, filter_: FirstHand) -> "Sent | None":
        """None: the robot has no Gaussian belief."""
        belief = filter_.belief
        return None if belief is None else cls(evidence, belief, filter_.joint, filter_.widened)

    def goes_on(self, before: "Sent") -> bool:
        """Whether a belief is the one from before, with what was measured since."""
        same = self.evidence.epoch == before.evidence.epoch and self.widened == before.widened
        return same and self.joint is before.joint and self.evidence.time > before.evidence.time


class GainsAddUp(Oracle):
    """What a robot knew when it last sent what it had gained, moved on, times what it sends now, is what it knows now of its place.

    So on a poor link nothing that was gained is lost, and nothing counts twice. Not asked of who tells its compass beside that.
    """

    sees = (Began, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._sent: dict[str, Sent] = {}  # by process

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._sent.pop(event.process, None)
        elif isinstance(event, Said) and isinstance(report := event.message, Report):
            if event.process in self.night.liars or not isinstance(event.service, AgentService):
                return
            agent = event.service.agent
            if report.evidence is None or report.evidence.compass is not None or not isinstance(agent, JointAgent):
                return
            evidence = unpack(report.source, report.tick, report.time, report.evidence)
            now, before = Sent.of(evidence, agent.filter), self._sent.pop(event.process, None)
            if now is None:
                return
            before = before if before is not None and now.goes_on(before) else None
            if evidence.increment is not None and before is not None:
                self._judge(event, before, now)
            elif before is not None:  # the motion alone: boards move the robot on by it
                now = replace(now, belief=reckoned(before, now))
            elif evidence.increment is None:
                return
            self._sent[event.process] = now

    def _judge(self, event: Said, before: Sent, now: Sent) -> None:
        known, own = reckoned(before, now).covariance[POSE, POSE], now.belief.covariance[POSE, POSE]
        shares = np.linalg.eigvals(np.linalg.solve(own, known)).real
        if not WHOLE[0] < shares.min() <= shares.max() < WHOLE[1]:
            least, most = float(shares.min()), float(shares.max())
            self.breaks(
                event.at, f"what {event.process} sends leaves {least:.2f} to {most:.2f} times the variance that it has"
            )


def reckoned(before: Sent, now: Sent) -> Moments:
    """Where a robot is by what it sent, from what it knew when it sent before."""
    joint, evidence = Joint(), now.evidence
    robot, since = evidence.robot, evidence.time - before.evidence.time
    joint.add(robot, before.belief)
    motion = evidence.travelled.since(before.evidence.travelled).after(before.evidence.travelled, since)
    drive(joint, robot, motion, evidence.nuisance)
    gained = None if evidence.increment is None else likelihood(joint, robot, evidence.increment)
    if gained is not None:
        correct(joint, gained)
    return joint.moments(robot)
