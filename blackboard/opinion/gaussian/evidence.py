"""What a robot contributes to a joint in one tick, and what became of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from statistics import median_low
from typing import Literal

from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.cameras import CameraFound
from blackboard.opinion.gaussian.coalitions import Choice
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.mounts import CompassReading
from blackboard.opinion.gaussian.naming import Unnamed
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance


@dataclass(frozen=True, eq=False)
class Evidence:
    """A robot's report of one tick, named by (robot, epoch, tick); `robot` is its subject, `robot/r1`.

    An epoch is a first-hand belief that was never begun anew; a robot that lost itself begins the next one. `travelled` is
    the sum of all motions of the epoch, so that a lost report loses no motion. `belief` is the whole first-hand block
    after the tick, from which a robot enters; None while it has no single hypothesis, and then `increment` is None too.
    `time` is when the tick ended, in seconds of team time. `returned` is what an earlier joint knew of the robot (`comparing.enter`).
    `camera` is what was found of the noise with which `relatives` are told; None of a camera of which nothing is found. `compass` is
    its reading at the end of the tick, if it is not in `increment`.
    """

    robot: str
    epoch: int
    tick: int
    travelled: Motion
    nuisance: Nuisance
    belief: Moments | None = None
    increment: Increment | None = None
    relatives: tuple[Relative, ...] = ()
    time: float = 0.0
    returned: Moments | None = None
    camera: CameraFound | None = None
    compass: CompassReading | None = None

    def named(self) -> Evidence:
        """Without the sightings of which only the class is told."""
        if not any(is_class(relative.subject) for relative in self.relatives):
            return self
        return replace(self, relatives=tuple(relative for relative in self.relatives if not is_class(relative.subject)))


def end_of_tick(news: Iterable[Evidence]) -> float:
    """The team time (s) at which a tick ends for objects: that of the middle robot, because one that lies moves it little."""
    return median_low(evidence.time for evidence in news)


@dataclass(frozen=True)
class Verdict:
    """What the gate said of one piece of evidence: its squared Mahalanobis distance, the degrees of freedom, taken or not.

    `outvoted_by` are the members of a coalition that left it out, sorted. An `echo` is an increment that says more than its robot's
    belief gained: it is left out before any gate.
    """

    source: str
    subject: str
    kind: Literal["increment", "compass", "relative", "echo"]
    squared: float
    freedom: int
    taken: bool
    outvoted_by: tuple[str, ...] = ()


@dataclass
class UnusedCounts(Copyable):
    """Counters of what was not used, by reason."""

    repeated: int = 0  # reports of a tick that is settled already
    gated: int = 0  # increments and relative beliefs that contradict the joint
    silent: int = 0  # relative beliefs about a robot of which no motion came in the tick, or that say too little alone
    bounded: int = 0  # pieces of evidence that would have moved somebody farther than an honest robot does
    outvoted: int = 0  # predictions of a robot's place that a coalition contradicted
    verdicts: list[Verdict] = field(default_factory=list)  # of the last tick
    unnamed: list[Unnamed] = field(default_factory=list)  # what became of those of the last tick
    #: Of the last tick: tracks that were named, or were over; unnamed sightings that found no room.
    tracks: Counter[str] = field(default_factory=Counter)
    #: Of the last tick: robot -> who was believed about its place.
    choices: dict[str, Choice] = field(default_factory=dict)
