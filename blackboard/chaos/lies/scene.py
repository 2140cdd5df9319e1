"""What a liar sees when it lies: its team, and what this has agreed on. Lengths are in the grid's unit, angles in radians."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.gaussian.vehicle import AXES, HEADING
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.messages import Consensus, Report

Whom = Literal["self", "mate", "mates", "object", "objects", "others", "all"]  # mate, object: the first one by name
Reports = dict[str, Report]  # by subject


@dataclass
class Scene:
    """What a liar knows when it lies."""

    robot: str
    grid: Grid
    mates: Sequence[str]  # the honest robots of the scenario, sorted
    rng: np.random.Generator
    time: float = 0.0  # of the tick
    since: float = 0.0  # seconds since its lie began
    tick: int = 0
    agreed: dict[str, Consensus] = field(default_factory=dict)  # subject -> the newest that it heard
    past: list[Reports] = field(default_factory=list)  # its honest reports since the lie began, by subject

    @property
    def own(self) -> str:
        return f"robot/{self.robot}"

    def targets(self, whom: Whom) -> dict[str, Array]:
        """The subjects that a lie is about, of those that the team has agreed on, and where the team has them."""
        own = [self.own] if self.own in self.agreed else []
        mates = [f"robot/{mate}" for mate in self.mates if f"robot/{mate}" in self.agreed]
        objects = sorted(subject for subject in self.agreed if subject.startswith("object/"))
        subjects = {
            "self": own,
            "mate": mates[:1],
            "mates": mates,
            "object": objects[:1],
            "objects": objects,
            "others": mates + objects,
            "all": own + mates + objects,
        }[whom]
        return {subject: self.place(subject) for subject in subjects}

    def place(self, subject: str) -> Array:
        """Where the team has a subject, shape (2,). KeyError: it has not agreed on it."""
        agreed = self.agreed[subject]
        return np.array(agreed.state.mean[AXES]) if agreed.state is not None else self.belief(agreed).mean()

    def belief(self, consensus: Consensus) -> Belief:
        return unpack(consensus.belief, self.grid)

    def evidence_in(self, reports: Reports) -> PackedEvidence | None:
        """The evidence for a joint among its reports; None without."""
        own = reports.get(self.own)
        return None if own is None else own.evidence

    def pose(self, reports: Reports) -> Array | None:
        """Where it believes itself to be, and its heading: shape (3,); None without evidence."""
        evidence = self.evidence_in(reports)
        return None if evidence is None or evidence.state is None else np.array(evidence.state.mean[: HEADING + 1])

    def drawn(self, mean: Array, sigma: float) -> Belief:
        """A Gaussian on the grid, at its border where the mean is outside."""
        low = np.array(self.grid.origin)
        high = low + np.array(self.grid.shape) * self.grid.cell
        return gaussian(self.grid, [float(x) for x in np.clip(mean, low, high)], sigma)
