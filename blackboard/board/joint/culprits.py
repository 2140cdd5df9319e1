"""Whose evidence breaks the joint: it is left out of the step, and for a while where it does so again and again."""

import logging
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from blackboard.errors import Degenerate
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.once import Settle
from blackboard.opinion.gaussian.team import TeamJoint

log = logging.getLogger(__name__)

STRIKES = 3  # times that a robot's evidence broke the joint until it is left out
PENALTY = 60.0  # seconds of team time for which it is then left out; afterwards one more time is enough


class Culprits:
    """Mutable: how often the evidence of each robot, named as `robot/r1`, broke the joint, and until when it is left out.

    Only a robot whose evidence is `Degenerate` is to blame; any other exception is a fault of this program.
    """

    def __init__(self, settle: Settle, begun: Callable[[], TeamJoint], counters: Counter[str]) -> None:
        """`begun` makes a joint without robots. Counted are `joint_restarts`, `joint_left_out` and `failed`."""
        self._settle, self._begun, self._counters = settle, begun, counters
        self._strikes: Counter[str] = Counter()
        self._barred: dict[str, float] = {}  # robot -> team time (s) until which it is left out
        self._logged: set[str] = set()  # the kinds of our own faults that are logged

    def is_barred(self, robot: str, time: float) -> bool:
        """Whether a robot is left out at a team time (s)."""
        return time < self._barred.get(robot, -math.inf)

    def settle(self, team: TeamJoint, tick: int, dt: float, batch: list[Evidence], time: float) -> TeamJoint:
        """A joint after a step of `dt` seconds, at a team time (s), without the evidence that breaks it.

        Where no single robot's does, the joint begins anew, and every robot enters again by its state.
        """
        before = team.copy()
        team, why = self._tried(team, tick, dt, batch)
        if why is None:
            return team

        def without(left: list[Evidence]) -> tuple[TeamJoint, Exception | None]:
            names = {evidence.robot for evidence in left}
            return self._tried(before.copy(), tick, dt, [kept for kept in batch if kept.robot not in names])

        suspects = sorted(batch, key=lambda evidence: evidence.robot)
        named = [evidence for evidence in suspects if isinstance(why, Degenerate) and evidence.robot == why.robot]
        if named and without(named)[1] is None:
            suspects = named
        while len(suspects) > 1:
            half = suspects[: len(suspects) // 2]
            suspects = half if without(half)[1] is None else suspects[len(half) :]
        team, again = without(suspects)
        if again is not None or not suspects:
            self._counters["joint_restarts"] += 1  # evidence came that no arithmetic survives
            log.warning("the joint begins anew: %s", why)
            return replace(self._begun(), tick=tick, tracks=team.tracks.anew())
        if isinstance(why, Degenerate):
            self._strike(suspects[0].robot, time, why)
        return team

    def _tried(
        self, team: TeamJoint, tick: int, dt: float, batch: list[Evidence]
    ) -> tuple[TeamJoint, Exception | None]:
        """A joint after a step, and what broke it; a fault of this program is logged, each kind once."""
        try:
            return self._settle(team, tick, dt, batch), None
        except Degenerate as error:
            return team, error
        except Exception as error:
            self._counters["failed"] += 1
            if (kind := type(error).__name__) not in self._logged:
                self._logged.add(kind)
                log.error("a fault in the joint, not logged again: it goes on without it", exc_info=error)
            return team, error

    def _strike(self, robot: str, time: float, why: Degenerate) -> None:
        self._counters["joint_left_out"] += 1
        self._strikes[robot] += 1
        strikes = self._strikes[robot]
        if strikes == 1:
            log.warning("the evidence of %s breaks the joint and is left out: %s", robot, why)
        if strikes >= STRIKES:
            self._barred[robot] = time + PENALTY
            log.warning("%s is left out of the joint for %g s: its evidence broke it %d times", robot, PENALTY, strikes)
