"""COP as the gate of a joint: where evidence about a robot's place contradicts what was predicted, coalitions say who is believed.

The predicted marginal, what the robot's own increment says, and what each sighting says are opinions about one place. Drawn on a
grid of their own, they form the coalitions of the Cooperative Opinion Pool; the winning one is multiplied in.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise_all
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import AXES, FLAT, Motion, correct
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy_weights

PREDICTION = "prediction"  # the name of the opinion that the joint itself holds
CELLS = 64  # along each edge of the grid on which the opinions meet
REACH = 4.0  # sigmas of each opinion that it must hold
KNOWN = 1e3  # unit ** 2: a position with a larger variance is not known
MEMBER = 0.5  # the least mass of the coalitions that a member of the winning one is in


def named(source: str) -> str:
    """A source in a sentence; it may be what the joint itself predicted."""
    return "the prediction" if source == PREDICTION else source


@dataclass(frozen=True)
class Choice:
    """Who is in the winning coalition, who is not, and the shares of the coalitions of 1, 2, ... opinions (V-.2)."""

    members: frozenset[str]
    others: frozenset[str]
    components: tuple[float, ...]

    @property
    def outvoted(self) -> bool:
        """Whether the joint's own prediction is not in the winning coalition, though two or more opinions are."""
        return PREDICTION not in self.members and len(self.members) > 1


def choose(opinions: Mapping[str, Moments], rule: Coalition) -> Choice:
    """The winning coalition of Gaussian opinions about one place, by source: mean, shape (2,), and covariance, shape (2, 2)."""
    names = sorted(opinions)
    grid = _grid([opinions[name] for name in names])
    drawn = np.stack([draw(grid, opinions[name]).p for name in names])
    pooled = rule.pool(drawn, entropy_weights(drawn))
    members = frozenset(name for name, mass in zip(names, pooled.weights, strict=True) if mass > MEMBER)
    return Choice(members, frozenset(names) - members, tuple(float(share) for share in pooled.components))


def about(
    joint: Joint, robot: str, pieces: Mapping[str, Increment | Relative], motions: Mapping[str, Motion]
) -> dict[str, Moments]:
    """What each piece of evidence says about a robot's place if nothing else was known of it; without those that say nothing.

    `pieces` are by the robot itself, or by the other end of a sighting. The rest of the robot's states, and the other ends, are as the
    joint has them. KeyError: one is not in it.
    """
    block, places = joint.moments(robot), {}
    block.covariance[AXES, :] = block.covariance[:, AXES] = 0.0
    block.covariance[AXES, AXES] = np.eye(2) * FLAT
    alone = Joint.of({robot: block, **{name: joint.moments(name) for name in pieces if name != robot}})
    seen = {source: piece for source, piece in pieces.items() if isinstance(piece, Relative)}
    factors: dict[str, Factor | None] = dict(zip(seen, linearise_all(alone, [*seen.values()], motions), strict=True))
    for source, piece in pieces.items():
        factor = likelihood(alone, robot, piece) if isinstance(piece, Increment) else factors[source]
        after = alone.among(dict.fromkeys((robot, source)))
        if factor is not None:
            correct(after, factor)
        place = after.moments(robot)
        if np.trace(place.covariance[AXES, AXES]) < KNOWN:
            places[source] = Moments(place.mean[AXES], place.covariance[AXES, AXES])
    return places


def _grid(opinions: list[Moments]) -> Grid:
    """A square grid that holds all opinions, but for what is farther out than the vaguest needs beside the sharpest."""
    means = np.array([opinion.mean for opinion in opinions])
    sigmas = np.sqrt([max(np.diag(opinion.covariance)) for opinion in opinions])
    reach = REACH * min(float(sigmas.max()), CELLS * float(sigmas.min()))
    low, high = means.min(axis=0) - reach, means.max(axis=0) + reach
    edge = float((high - low).max())
    middle = (low + high) / 2
    cell = max(edge / CELLS, math.sqrt(np.finfo(float).tiny))
    return Grid((CELLS, CELLS), cell, tuple(float(x) for x in middle - edge / 2))
