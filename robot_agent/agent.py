"""The agent: a robot's two chains, what it reports from them, and how it takes the team's word back. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, PackedBelief, Readings, Report, Solo
from robot_agent.chain import Chain, Mate
from robot_agent.config import RobotSection

Feedback = Literal["paper", "guarded", "off"]

WORTH = 0.5  # nats that an informed belief about somebody else must be sharper to be reported beside the first-hand one

MEMORY = 8  # ticks that can be gone back to when an agreed belief comes late


@dataclass(frozen=True, eq=False)
class Past:
    """The informed chain after a tick, what was told of it, and what led to it."""

    readings: Readings
    mates: Mapping[str, Mate]
    chain: Chain
    told: dict[str, PackedBelief]


class Agent:
    """One robot's mind: `tick` takes readings and the agreed beliefs that have arrived, and returns what to report."""

    def __init__(self, robot: str, settings: RobotSection, grid: Grid, feedback: Feedback = "guarded") -> None:
        self.robot = robot
        self.settings, self.grid, self.feedback = settings, grid, feedback
        self.firsthand = self.informed = Chain.begin(settings, grid, robot)
        self.mates: dict[str, Mate] = {}
        self._past: deque[Past] = deque(maxlen=MEMORY)

    def tick(self, readings: Readings, agreed: Mapping[str, Consensus]) -> tuple[list[Report], Solo]:
        """Fold what the team agreed (subject -> consensus) back, move, see, and report; raises Refused on a bad belief."""
        if self.feedback != "off":
            self._fold(agreed)
        self.firsthand = self.firsthand.advance(readings)
        if self._is_alone():
            self.informed = self.firsthand
        else:
            self.informed = self.informed.advance(readings, self.mates)
        reports, told = self._reports(readings)
        self._past.append(Past(readings, self.mates, self.informed, told))
        return reports, self._solo(readings)

    # --- the team's word ----------------------------------------------------------------------------------------------

    def _is_alone(self) -> bool:
        """Whether the team has told it nothing yet, so that both chains are one."""
        return not self.mates and set(self.informed.ancestors) <= {self.robot}

    def _fold(self, agreed: Mapping[str, Consensus]) -> None:
        """Go back to the tick that was agreed on, take the belief there, and play the ticks since again."""
        words = {s: c for s, c in sorted(agreed.items()) if c.ancestors}
        beliefs = {subject: unpack(c.belief, self.grid) for subject, c in words.items()}
        if not words:
            return
        self._know_mates(words, beliefs)
        ticks = sorted({c.tick for s, c in words.items() if self._concerns(s)})
        for tick in ticks:
            start = next((i for i, past in enumerate(self._past) if past.readings.tick == tick), None)
            if start is None:
                continue  # too long ago to go back to
            past = self._past[start]
            chain = past.chain
            for subject, consensus in words.items():
                if consensus.tick == tick and self._concerns(subject):
                    told = past.told.get(subject)
                    before = None if told is None else unpack(told, self.grid)
                    chain = chain.folded(beliefs[subject], before, consensus.ancestors)
            self._past[start] = Past(past.readings, past.mates, chain, past.told)
            for i in range(start + 1, len(self._past)):
                later = self._past[i]
                chain = chain.advance(later.readings, later.mates)
                self._past[i] = Past(later.readings, later.mates, chain, later.told)
            self.informed = chain

    def _concerns(self, subject: str) -> bool:
        return subject == f"robot/{self.robot}"

    def _know_mates(self, words: Mapping[str, Consensus], beliefs: Mapping[str, Belief]) -> None:
        if not self.settings.vision.mates:
            return
        for subject, belief in beliefs.items():
            if subject.startswith("robot/") and not self._concerns(subject):
                covariance = belief.covariance()
                self.mates = {**self.mates, subject: Mate(belief.mean(), covariance, words[subject].ancestors)}

    # --- what is said -------------------------------------------------------------------------------------------------

    def _reports(self, readings: Readings) -> tuple[list[Report], dict[str, PackedBelief]]:
        alone = self.informed is self.firsthand
        first = beliefs(self.firsthand)
        informed = {} if alone else beliefs(self.informed)
        ancestors = dict(sorted(self.informed.ancestors.items()))
        reports: list[Report] = []
        told: dict[str, PackedBelief] = {}
        for subject in sorted(first.keys() | informed.keys()):
            helped = subject in informed and (
                self._concerns(subject) or _sharper(informed[subject], first.get(subject))
            )
            later = pack(informed[subject]) if helped else None
            if subject not in first:  # nothing of its own to say: an echo of the team gains nothing
                continue
            own = pack(first[subject])
            told[subject] = later or own
            reports.append(
                Report(
                    source=self.robot,
                    subject=subject,
                    tick=readings.tick,
                    time=readings.time,
                    belief=own,
                    ancestors={self.robot: readings.time},
                    informed=None if later is None else Informed(belief=later, ancestors=ancestors),
                )
            )
        return reports, told

    def _solo(self, readings: Readings) -> Solo:
        chain = self.firsthand
        own = {f"robot/{self.robot}": chain.localizer.marginal(), **chain.objects}
        packed = {subject: pack(belief) for subject, belief in sorted(own.items())}
        return Solo(robot=self.robot, tick=readings.tick, time=readings.time, beliefs=packed)


def _sharper(informed: Belief, first: Belief | None) -> bool:
    """Whether the team's help made a belief so much sharper that it is worth a second, overlapping opinion."""
    return first is not None and entropy(informed.p) < entropy(first.p) - WORTH


def beliefs(chain: Chain) -> dict[str, Belief]:
    """All that a chain believes about somebody's place on the team's grid, by subject."""
    return {f"robot/{chain.robot}": chain.localizer.marginal(), **chain.objects, **chain.seen}
