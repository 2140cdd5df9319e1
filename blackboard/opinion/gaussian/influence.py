"""How far each robot's evidence has moved what the team believes: nobody moves others much farther than an honest robot would.

Beside the estimate x stands, for each source i, what would be believed without it: x - D, with the same gains. A source is a robot or
an object. All sightings of it count as its own, too: who sees a robot whose odometry lies is led along by that. Evidence of i with the
innovation v, its covariance S and the gain K adds K v to D.
Evidence of others, whose derivatives are H, leaves (I - K H) D of it: they correct what i has moved. This is solution separation
(Brown and McBurney, Navigation 34(1), 1987) with shared gains, so that a mean for each source is enough. The innovations of honest
evidence are white. So the covariance C of D is known: K S K^T is added, and (I - K H) C (I - K H)^T is left. Headings are left out.

Evidence that moves somebody else's place, so that a robot's D is beyond the 99.9 % region of C and farther than before, moves the own
places of those alone who have moved it (Schmidt 1966). Nobody moves whom another one has moved that far: a robot whose odometry lies
and a mate that sees it would else follow each other without end.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.coalitions import KNOWN
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Block, Expected, Factor, Joint, pairs_of
from blackboard.opinion.gaussian.vehicle import AXES, STATES
from blackboard.opinion.grid import Array

# Of |D|^2 by C: the 99.9 % quantile; at 90 % a robot that alone sees landmarks no longer led its mates.
FARTHEST = quantile(GATE, 2)
MEMORY = 5.0  # seconds after which what a robot has moved, and no other has corrected, counts for 1/e
FAINT = 0.01  # share of a place's variance that D may have without being counted: the models are no better
MOST = 30_000  # numbers in all C: 19 robots, or 6 and 29 objects; in larger teams one counts for little, and this is left out


@dataclass
class Influence(Copyable):
    """Mutable. Places are x and y of robots and objects. Sources are robots, then objects whose sightings have moved robots."""

    _sources: list[str] = field(default_factory=list)
    _robots: int = 0  # sources that are robots
    _leading: list[str] = field(default_factory=list)  # objects whose sightings have moved robots
    _places: list[str] = field(default_factory=list)
    _moved: Array = field(default_factory=lambda: np.zeros((0, 0)))  # D, shape (sources, 2 places)
    _honest: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))  # C, shape (sources, 2 places, 2 places)
    # Object -> how far it went as it was seen to move, shape (2,).
    _went: dict[str, Array] = field(default_factory=dict)

    def is_counted(self, robots: int) -> bool:
        """Whether a team of so many is small enough."""
        return 4 * robots**3 <= MOST

    def drop(self, place: str) -> None:
        """A place is no longer in the joint, or is there for other reasons from now on."""
        self._went.pop(place, None)
        if place in self._leading:
            self._leading.remove(place)
        if place in self._sources[self._robots :]:
            row = self._sources.index(place)
            del self._sources[row]
            self._moved, self._honest = np.delete(self._moved, row, 0), np.delete(self._honest, row, 0)
        if place in self._places:
            at = self._places.index(place)
            keep = np.r_[0 : 2 * at, 2 * at + 2 : 2 * len(self._places)]
            del self._places[at]
            self._moved, self._honest = self._moved[:, keep], self._honest[:, keep][:, :, keep]

    def pass_time(self, dt: float, kept: Collection[str] = ()) -> None:
        """Let `dt` seconds pass. Of places that are `kept` nothing fades: only what others see corrects it."""
        fade = np.exp(-dt / MEMORY)
        keep = np.repeat([1.0 if place in kept else fade for place in self._places], 2)
        self._moved = self._moved * keep
        self._honest = self._honest * np.sqrt(np.outer(keep, keep))
        self._went = {place: way * fade for place, way in self._went.items()}

    def rename(self, old: str, new: str) -> None:
        """A place has another name from now on."""
        self._places, self._sources, self._leading = (
            [new if name == old else name for name in names] for names in (self._places, self._sources, self._leading)
        )
        self._went = {new if place == old else place: way for place, way in self._went.items()}

    def go(self, place: str, way: Array) -> None:
        """Note the displacement of an object, shape (2,), by its velocity. What is taken back of a robot includes its share of it."""
        self._went[place] = self._went.get(place, 0.0) + way

    def _share_of_ways(self, row: int) -> Array:
        """What of the ways that objects went is put down to a robot, shape (2 places,)."""
        norms = np.hypot(self._moved[:, ::2], self._moved[:, 1::2])
        shares = norms[row] / np.maximum(norms[: self._robots].sum(axis=0), np.finfo(float).tiny)
        ways = np.array([self._went.get(place, np.zeros(2)) for place in self._places])
        return np.asarray((shares[:, np.newaxis] * ways).ravel())

    def _follow(self, joint: Joint) -> None:
        """Note who has come into the joint and who has gone; where they were when they came counts for nobody."""
        subjects = [block for block in joint.blocks if isinstance(block, str)]
        robots = [block for block in subjects if _is_robot(joint, block)]
        room = int(math.sqrt(MOST / max(1, len(robots))) / 2)
        places = (
            [*robots, *(block for block in subjects if block not in robots)][:room]
            if self.is_counted(len(robots))
            else []
        )
        size = 2 * len(places)
        leading = [block for block in places if block in self._leading]
        sources = [*robots, *leading][: MOST // max(1, size**2)]
        if (sources, places) == (self._sources, self._places):
            return
        before = self._sources, self._places, self._moved, self._honest
        self._moved, self._honest = np.zeros((len(sources), size)), np.zeros((len(sources), size, size))
        kept = [block for block in places if block in before[1]]
        to, of = pairs_of(places, kept), pairs_of(before[1], kept)
        for row, source in enumerate(sources):
            if source in before[0]:
                old = before[0].index(source)
                self._moved[row, to] = before[2][old, of]
                self._honest[row][np.ix_(to, to)] = before[3][old][np.ix_(of, of)]
        self._robots, self._sources, self._places = len(robots), sources, places

    def after(
        self,
        joint: Joint,
        robot: str,
        factor: Factor,
        expected: Expected,
        only: Collection[Block] | None = None,
        share: float = 1.0,
    ) -> tuple[Array, Array]:
        """D and C of all once a factor that `robot` tells is taken, into `only` some blocks if given, with a `share` of its gain.

        What is `expected` is as before any of it; the factor's blocks are in the joint.
        """
        if only is None:
            objects = (block for block in factor.jacobians if isinstance(block, str) and not _is_robot(joint, block))
            self._leading += [block for block in objects if block not in self._leading]
        self._follow(joint)
        rows, spread = joint.indices(self._places, 2).ravel(), expected.spread + factor.noise
        by = np.zeros((len(factor.residual), len(rows)))
        for block, part in factor.jacobians.items():
            if block in self._places:
                at = 2 * self._places.index(block)
                by[:, at : at + 2] = part[:, AXES]
        gain = share * np.linalg.solve(spread, expected.cross[:, rows]).T
        if only is not None:
            gain *= np.repeat([place in only for place in self._places], 2)[:, np.newaxis]
        moved = self._moved - (self._moved @ by.T) @ gain.T
        # from both sides alike, or else what rounding adds grows
        left = self._honest - (self._honest @ by.T) @ gain.T
        honest = left - gain @ (by @ left)
        mine = [row for row, source in enumerate(self._sources) if source == robot or source in factor.jacobians]
        moved[mine] = self._moved[mine] + gain @ factor.residual
        honest[mine] = self._honest[mine] + gain @ spread @ gain.T
        enter = np.repeat(joint.variances[rows].reshape(-1, 2).sum(axis=1) > KNOWN, 2)
        moved[:, enter], honest[:, enter], honest[:, :, enter] = 0.0, 0.0, 0.0
        return moved, honest

    def after_shift(self, joint: Joint, robots: Collection[str], shift: Array, sigmas: Array) -> tuple[Array, Array]:
        """D and C as they will be after all means have moved by `shift`, shape (n,), by evidence of `robots`, in equal shares.

        By evidence of honest robots they move by `sigmas`, shape (n,), times one standard normal number.
        """
        self._follow(joint)
        rows, share = joint.indices(self._places, 2).ravel(), 1 / len(robots)
        moved, honest = self._moved.copy(), self._honest.copy()
        for row in map(self._sources.index, robots):
            moved[row] += share * shift[rows]
            honest[row] += share**2 * np.outer(sigmas[rows], sigmas[rows])
        return moved, honest

    def beyond(self, joint: Joint, after: tuple[Array, Array]) -> set[tuple[str, str]]:
        """Pairs of robot and another place than its own, where its D would leave the region of C and grow."""
        moved, honest = (of[: self._robots] for of in after)
        variances = joint.variances[joint.indices(self._places, 2)].mean(axis=1)
        faint = FAINT * variances[:, np.newaxis, np.newaxis] * np.eye(2)
        then = _squared(moved, _blocks(honest) + faint)
        if not (then > FARTHEST).any():
            return set()
        now = _squared(self._moved[: self._robots], _blocks(self._honest[: self._robots]) + faint)
        pairs = zip(*np.nonzero(then > np.maximum(FARTHEST, now)), strict=True)
        named = ((self._sources[one], self._places[place]) for one, place in pairs)
        return {(robot, place) for robot, place in named if robot != place}

    def on_factor(self, after: tuple[Array, Array]) -> None:
        """A factor is taken next, which leaves that D and C (`after`)."""
        self._moved, self._honest = after

    def moved(self, source: str) -> tuple[Array, Array]:
        """D and C of a robot or an object, shape (2 places,) and (2 places, 2 places). ValueError: it is not in the joint."""
        row = self._sources.index(source)
        return self._moved[row].copy(), self._honest[row].copy()

    def take_back(self, joint: Joint, source: str, only: str | None = None, told_by: Collection[str] = ()) -> None:
        """Undo what a source has moved at all places but its own, or at `only` one: means go back, covariances grow.

        Of an object, `told_by` are who saw it: what it has moved is taken off their D. Where a robot's is undone, no object has moved
        anything any more, so that nothing is undone twice.
        """
        self._follow(joint)
        if source not in self._sources or not self._places:
            return
        row = self._sources.index(source)
        is_robot = row < self._robots
        back = np.repeat([place != source and only in (None, place) for place in self._places], 2)
        both = back & back[:, np.newaxis]
        rows = joint.indices(self._places, 2).ravel()
        way = self._share_of_ways(row) if is_robot else 0.0
        joint.mean[rows] -= np.where(back, self._moved[row] + way, 0.0)
        joint.covariance[np.ix_(rows, rows)] += np.where(both, self._honest[row], 0.0)
        tellers = [] if is_robot else [at for at, robot in enumerate(self._sources[: self._robots]) if robot in told_by]
        self._moved[tellers] -= np.where(back, self._moved[row], 0.0)
        undone = [row, *range(self._robots, len(self._sources))] if is_robot else [row]
        self._moved[undone] = np.where(back, 0.0, self._moved[undone])
        self._honest[undone] = np.where(back | back[:, np.newaxis], 0.0, self._honest[undone])


def _is_robot(joint: Joint, block: str) -> bool:
    return bool(joint.blocks[block].stop - joint.blocks[block].start == STATES)


def _blocks(matrices: Array) -> Array:
    """The blocks of two rows on the diagonals of matrices, shape (k, 2 n, 2 n): (k, n, 2, 2)."""
    k, n = len(matrices), matrices.shape[1] // 2
    return np.asarray(np.einsum("knxny->knxy", matrices.reshape(k, n, 2, n, 2)))


def _squared(vectors: Array, covariances: Array) -> Array:
    """Squared Mahalanobis distances, shape (k, n), of vectors of two, shape (k, 2 n), by covariances (k, n, 2, 2)."""
    x, y = vectors[:, ::2], vectors[:, 1::2]
    a, b, d = covariances[..., 0, 0], covariances[..., 0, 1], covariances[..., 1, 1]
    across = np.maximum(a * d - b * b, np.finfo(float).tiny)
    return np.asarray((d * x * x - 2 * b * x * y + a * y * y) / across)
