"""The agent: a robot's two estimators, what it reports from them, and how it takes the team's agreed beliefs back. Pure.

Where the boards keep a joint, `robot_agent.gaussian.agent` is the agent, and this one is what it falls back on.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.gaussians import unpack_state
from blackboard.wire.messages import (
    MAX_UNNAMED,
    Consensus,
    Informed,
    PackedBelief,
    Readings,
    Report,
    Sighting,
    Solo,
    UnnamedBelief,
)
from robot_agent.budget import Sending
from robot_agent.config import RobotSection
from robot_agent.estimator import Estimator, Mate
from robot_agent.localizers import heading_of
from robot_agent.sensing import placed, trackable, unnamed
from robot_agent.untold import ALL_TOLD, Untold

Feedback = Literal["paper", "guarded", "off"]

#: Nats by which an informed belief about somebody else must be sharper than the first-hand one to be reported beside it.
LEAST_GAIN = 0.5

#: Ticks that can be gone back to when an agreed belief comes late.
SNAPSHOTS = 8


@dataclass(frozen=True, eq=False)
class TeamBelief:
    """What a robot's team agreed on about one subject at a time (team time, seconds), and whose information that contains."""

    tick: int
    time: float
    belief: Belief
    ancestors: Mapping[str, float]
    state: Moments | None = None  # of a robot in the team's joint, shape (12,) and (12, 12)

    @classmethod
    def unpacked(cls, consensus: Consensus, grid: Grid) -> "TeamBelief":
        """The belief, and the state, of a consensus on the team's grid; Refused: "fields", "grid", "mass"."""
        state = None if consensus.state is None else unpack_state(consensus.state)
        return cls(consensus.tick, consensus.time, unpack(consensus.belief, grid), consensus.ancestors, state)


class TeamBeliefs(Mapping[str, TeamBelief]):
    """Consensuses by subject as `TeamBelief`, each unpacked when it is asked for: a robot hears of all subjects and uses few.

    What cannot be unpacked is not there.
    """

    def __init__(self, said: Mapping[str, Consensus], grid: Grid) -> None:
        self._said, self._grid = said, grid
        self._found: dict[str, TeamBelief | None] = {}

    def __getitem__(self, subject: str) -> TeamBelief:
        if subject not in self._found:
            self._found[subject] = None
            with suppress(Refused):
                self._found[subject] = TeamBelief.unpacked(self._said[subject], self._grid)
        belief = self._found[subject]
        if belief is None:
            raise KeyError(subject)
        return belief

    def __iter__(self) -> Iterator[str]:
        return (subject for subject in self._said if self.get(subject) is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The informed estimator after a tick, the readings and mates of that tick, and what the boards then had of its own place."""

    readings: Readings
    mates: Mapping[str, Mate]
    estimator: Estimator
    reported: PackedBelief


class Agent:
    """One robot: `tick` takes readings and the agreed beliefs that have arrived, and returns what to report."""

    def __init__(
        self, robot: str, settings: RobotSection, grid: Grid, feedback: Feedback = "guarded", untold: Untold = ALL_TOLD
    ) -> None:
        """`untold` is its unmeasured motion before."""
        self.robot, self.subject = robot, f"robot/{robot}"
        self.settings, self.grid, self.feedback = settings, grid, feedback
        self.firsthand = self.informed = Estimator.begin(settings, grid, robot, untold)
        self.mates: dict[str, Mate] = {}
        self._snapshots: deque[Snapshot] = deque(maxlen=SNAPSHOTS)

    def uses(self, subject: str) -> bool:
        """Whether a tick takes in what is agreed about a subject: about itself, and about mates that it may see."""
        return subject == self.subject or (self.settings.vision.mates and subject.startswith("robot/"))

    def tick(self, readings: Readings, agreed: Mapping[str, TeamBelief]) -> tuple[list[Report], Solo]:
        """Fold the agreed beliefs (by subject) back, predict, update, and report.

        The solo message holds the same first-hand beliefs as the reports, but for the sighted mates; it is for a referee.
        """
        strange = unnamed(readings)
        readings = trackable(placed(readings), self.firsthand.objects.keys() | self.informed.objects.keys())
        if self.feedback != "off":
            self._fold(agreed)
        self.firsthand = self.firsthand.advance(readings)
        self.informed = self.firsthand if self._is_alone() else self.informed.advance(readings, self.mates)
        first = self.firsthand.beliefs()
        packed = {subject: pack(belief, self.settings.coding) for subject, belief in sorted(first.items())}
        informed = self._informed(first)
        reports = [
            report_of(readings, subject, own, self._with_ancestors(informed.get(subject)))
            for subject, own in packed.items()
        ]
        own = next(i for i, report in enumerate(reports) if report.subject == self.subject)
        reports[own] = reports[own].model_copy(update={"unnamed": self._unnamed(strange)})
        reported = informed.get(self.subject, packed[self.subject])
        self._snapshots.append(Snapshot(readings, self.mates, self.informed, reported))
        solo = {s: own for s, own in packed.items() if s == self.subject or s not in self.firsthand.seen}
        return reports, solo_of(readings, solo)

    def pose(self) -> Moments | None:
        """Where the robot is, (x, y, heading) with covariance, shape (3,) and (3, 3), with what the team agreed on.

        None while the place is hardly known. The variance of a heading that the localizer does not estimate is that of any heading.
        """
        localizer = self.informed.localizer
        place = localizer.marginal()
        if entropy_of(place.p) >= self.settings.objects.forget * math.log(self.grid.size):
            return None
        heading, variance = heading_of(localizer)
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = place.covariance() + np.eye(2) * self.grid.cell**2 / 12
        covariance[2, 2] = variance
        return Moments(np.array([*place.mean(), heading]), covariance)

    def found(self) -> dict[str, float]:
        """What it has found out of its sensors: nothing, because grids leave no room for that."""
        return {}

    def on_sent(self, choice: Sending) -> None:
        """What of the newest reports was sent: what the team agrees on rests on that, or on what was sent before it."""
        sent = {report.subject: report for report in choice.reports}
        if self.subject in sent:
            report = sent[self.subject]
            packed = report.belief if report.informed is None else report.informed.belief
        else:
            packed = pack(choice.kept.get(self.subject) or uniform(self.grid))
        self._snapshots[-1] = replace(self._snapshots[-1], reported=packed)

    # --- what the team agreed on --------------------------------------------------------------------------------------

    def _is_alone(self) -> bool:
        """Whether no agreed belief has been taken yet, so that both estimators are the same."""
        return not self.mates and set(self.informed.ancestors) <= {self.robot}

    def _fold(self, agreed: Mapping[str, TeamBelief]) -> None:
        """Take the agreed beliefs: those about mates as landmarks, the one about this robot into the informed estimator."""
        known = {subject: one for subject, one in sorted(agreed.items()) if one.ancestors}
        if self.settings.vision.mates:
            self.mates = {
                **self.mates,
                **{
                    subject: Mate(one.belief.mean(), one.belief.covariance(), one.ancestors)
                    for subject, one in known.items()
                    if subject.startswith("robot/") and subject != self.subject
                },
            }
        if self.subject in known:
            self._fold_own(known[self.subject])

    def _fold_own(self, agreed: TeamBelief) -> None:
        """Go back to the tick that was agreed on, take the belief there, and repeat the ticks since on their readings."""
        start = self._snapshot_of(agreed)
        if start is None:
            return  # too long ago: the tick is no longer kept
        snapshot = self._snapshots[start]
        estimator = snapshot.estimator.folded(agreed.belief, unpack(snapshot.reported, self.grid), agreed.ancestors)
        self._snapshots[start] = replace(snapshot, estimator=estimator)
        for i in range(start + 1, len(self._snapshots)):
            later = self._snapshots[i]
            estimator = estimator.advance(later.readings, later.mates)
            self._snapshots[i] = replace(later, estimator=estimator)
        self.informed = estimator

    def _snapshot_of(self, agreed: TeamBelief) -> int | None:
        """The snapshot of the tick that was agreed on.

        Where no world counts the ticks for robots and boards alike, it is the newest one that is not younger than the belief.
        """
        ticks = [snapshot.readings.tick for snapshot in self._snapshots]
        if agreed.tick in ticks:
            return ticks.index(agreed.tick)
        times = [snapshot.readings.time for snapshot in self._snapshots]
        return max((i for i, time in enumerate(times) if time <= agreed.time), default=None)

    # --- what is reported ---------------------------------------------------------------------------------------------

    def _informed(self, first: Mapping[str, Belief]) -> dict[str, PackedBelief]:
        """The informed beliefs that are worth a second opinion: the own place, and what the team made much sharper.

        What the robot has no first-hand belief about is left out: it would only send the team's own information back.
        """
        if self.informed is self.firsthand:
            return {}
        return {
            subject: pack(belief, self.settings.coding)
            for subject, belief in self.informed.beliefs().items()
            if subject == self.subject
            or (subject in first and entropy_of(belief.p) < entropy_of(first[subject].p) - LEAST_GAIN)
        }

    def _unnamed(self, strange: Sequence[tuple[int, Sighting]]) -> list[UnnamedBelief]:
        """Where the things are that it sees and cannot name, as far as it knows where it is itself."""
        most, beliefs = self.settings.objects.forget * math.log(self.grid.size), list[UnnamedBelief]()
        for mark, sighting in strange[:MAX_UNNAMED]:
            belief = self.firsthand.place(sighting)
            if entropy_of(belief.p) < most:
                where = pack(belief, self.settings.coding)
                beliefs.append(
                    UnnamedBelief(kind=sighting.subject, belief=where, mark=mark, confidence=sighting.confidence)
                )
        return beliefs

    def _with_ancestors(self, informed: PackedBelief | None) -> Informed | None:
        ancestors = dict(sorted(self.informed.ancestors.items()))
        return None if informed is None else Informed(belief=informed, ancestors=ancestors)


def report_of(readings: Readings, subject: str, own: PackedBelief, informed: Informed | None) -> Report:
    """The report of a tick about a subject."""
    tick, time, robot = readings.tick, readings.time, readings.robot
    return Report(
        source=robot, subject=subject, tick=tick, time=time, belief=own, ancestors={robot: time}, informed=informed
    )


def solo_of(readings: Readings, beliefs: dict[str, PackedBelief]) -> Solo:
    """What a robot believes after a tick without its team."""
    return Solo(robot=readings.robot, tick=readings.tick, time=readings.time, beliefs=beliefs)
