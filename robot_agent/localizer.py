"""The interface of a localizer: a robot's belief about its own pose, by Markov localisation on a grid.

A localizer is a value: every operation returns a new one, so that a robot may go back some ticks and play them again.
`robot_agent.localizers` says which localizers there are.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Sighting
from robot_agent.sensing import TickMotion


@runtime_checkable
class Localizer(Protocol):
    """A robot's belief about its own pose. Positions are in the grid's unit, angles in radians."""

    def predict(self, motion: TickMotion, compass: float | None) -> Localizer:
        """Move by one tick's motion; `compass` is the heading after it, where the robot has a compass."""

    def update_with_fix(self, fix: Fix) -> Localizer:
        """Bayes with an absolute position (and heading)."""

    def update_with_sighting(
        self, sighting: Sighting, motion: TickMotion | None, place: Array, covariance: Array
    ) -> Localizer:
        """Bayes with a sighting of something at `place`, shape (2,), known up to `covariance`, shape (2, 2), unit ** 2.

        `motion` is that of the tick in which it was seen, None in the first one.
        """

    def tempered(self, power: float) -> Localizer:
        """The belief to a power, normalised: a power below 1 discounts evidence that another belief may hold too."""

    def entropy(self) -> float:
        """Entropy in nats, over all that it estimates (the heading too, where it is estimated)."""

    def marginal(self) -> Belief:
        """The belief about the position alone, on the team's grid."""

    def fold(self, agreed: Belief, reported: Belief) -> Localizer:
        """Jeffrey's rule: p(pose) * agreed(position) / reported(position), so that heading given position is kept.

        `reported` is the marginal that was reported to the team. Where both contradict each other, the position becomes `agreed`.
        """

    def project(self, sighting: Sighting, motion: TickMotion | None) -> Belief:
        """The belief about the seen subject's position, given the sighting and the robot's own uncertain pose."""


@runtime_checkable
class TakesParts(Localizer, Protocol):
    """A localizer that also takes ranges and bearings alone; of another one they are left out."""

    def update_with_part(self, seen: Seen, motion: TickMotion | None, place: Array, covariance: Array) -> TakesParts:
        """The same as `update_with_sighting` with a range or a bearing alone."""
