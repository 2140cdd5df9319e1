"""One robot, one vote: who is honest counts, and boards agree again; how far a lie moves others is judged over all nights."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus, Report, Used
from tests.nights.events import Event, Recovered, Said
from tests.nights.night import FIRST, Night
from tests.nights.oracles import Broken, Oracle, Scored

BARRED = "its evidence breaks the joint"
FRESH = 2.5  # seconds of age; a tick is at most one
WATCHED = 2  # ticks at the end of a night in which a board has what robots on a poor link said
APART = 6.0  # sigmas between what two boards agree on: they may have taken different evidence, and each is right


class TheHonestCount(Oracle):
    """No honest robot is barred; once the team is well, what each says newly of its place counts, whoever lied, and whatever its clock."""

    sees = (Recovered, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._is_well = False
        #: Of a sub-team's level and a robot in it, whether the robot counted in what was said of its place.
        self._counted: dict[tuple[str, str, str], bool] = {}
        #: Of a sub-team and a robot, when it gave evidence of its place, in seconds of the night, and its stamps.
        self._given: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)

    def see(self, event: Event) -> None:
        if isinstance(event, Recovered):
            self._is_well = True
        elif isinstance(event, Said) and isinstance(event.message, Consensus):
            message = event.message
            for out in message.left_out:
                if out.reason == BARRED and f"robot/{out.source}" not in self.night.liars:
                    self.breaks(event.at, f"{event.process} bars {out.source}, which is honest")
            robot = message.subject.removeprefix("robot/")
            mine = robot in self.night.team.sub_teams[message.sub_team] and message.subject not in self.night.liars
            if self._is_well and mine and (message.level == "consensus" or message.rule == "joint"):
                who = message.sub_team, message.level, robot
                counts = any(used.source == robot and used.weight > 0 and self._is_fresh(used) for used in message.used)
                self._counted[who] = self._counted.get(who, False) or counts or self._takes(event, message, robot)
        elif isinstance(event, Said) and isinstance(event.message, Report) and event.message.evidence is not None:
            self._given[event.parts["sub_team"], event.message.source].append((event.at, event.message.time))

    def _takes(self, event: Said, consensus: Consensus, robot: str) -> bool:
        """Whether a joint has all that a robot on a poor link has said a tick before, or earlier: that may be its motion, or nothing."""
        if (
            not self.night.team.is_poor
            or consensus.rule != "joint"
            or event.at < self.night.end - WATCHED * self.night.team.tick
        ):
            return False
        since, until = self.night.well, event.at - self.night.team.tick
        said = [time for at, time in self._given[consensus.sub_team, robot] if since < at < until]
        return not said or consensus.ancestors.get(robot, -math.inf) >= said[-1]

    def _is_fresh(self, used: Used) -> bool:
        """Whether an opinion is of the newest ticks, by the clock of the board; on a poor link a robot says less."""
        return self.night.team.is_poor or -FRESH < used.age < FRESH

    def verdict(self) -> Broken | None:
        for (sub_team, level, robot), counts in self._counted.items():
            if not counts:
                self.breaks(self.night.end, f"{robot} does not count in the {level} of {sub_team} on its place")
        return self._broken


class BoardsAgreeAgain(Oracle):
    """Once the team is well, all boards of a world's team agree about each robot to within `APART` sigmas, where nobody lied."""

    sees = (Recovered, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._is_well = False
        self._agreed: dict[tuple[object, ...], tuple[str, Belief]] = {}

    def see(self, event: Event) -> None:
        if isinstance(event, Recovered):
            self._is_well = self.night.is_honest and self.night.team.mode != "free"
        elif self._is_well and isinstance(event, Said) and isinstance(event.message, Consensus):
            consensus = event.message
            if consensus.level == "agreed" and consensus.subject.startswith("robot/"):
                self._compare(event, consensus)

    def _compare(self, event: Said, consensus: Consensus) -> None:
        mine = unpack(consensus.belief)
        process, other = self._agreed.setdefault(
            (consensus.tick, consensus.time, consensus.subject), (event.process, mine)
        )
        if process == event.process:
            return
        variance = max(float(np.trace(belief.covariance())) / mine.grid.ndim for belief in (mine, other))
        apart = float(np.linalg.norm(mine.mean() - other.mean())) / variance**0.5
        if apart > APART:
            self.breaks(
                event.at, f"{process} and {event.process} are {apart:.1f} sigmas apart about {consensus.subject}"
            )


class OneVote(Scored):
    """How far what is agreed about an honest robot is off, while one robot lies and where nobody does (`run.uncalibrated`)."""

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._found = Counter[str]()
        lies = [fault.begin for fault in night.faults if fault.lies()]
        self._since = min(lies, default=FIRST)
        self._group = {0: "calm", 1: "lied"}.get(len(night.liars))

    def score(self, at: float, tick: int, consensus: Consensus, place: Sequence[float]) -> None:
        if self._group is not None and at >= self._since and consensus.subject not in self.night.liars:
            self._found[f"{self._group} n"] += 1
            off = float(np.linalg.norm(unpack(consensus.belief).mean() - np.array(place)))
            self._found[f"{self._group} off"] += off  # type: ignore[assignment]

    def sums(self) -> Counter[str]:
        return self._found
