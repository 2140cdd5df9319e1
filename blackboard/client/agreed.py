"""What a team agrees on, as a program hears of it: about each subject every belief that is newer than the one before. Pure."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Grid
from blackboard.process.reactions import Cue
from blackboard.wire.arrays import unpack
from blackboard.wire.gaussians import pose_of, velocity_of
from blackboard.wire.messages import Consensus, Refusal
from blackboard.wire.types import Message

#: Seconds without a newer agreed belief after which an older one is taken, because the stamp of the last one must have been wrong.
FORGOTTEN = 10.0
MAX_SUBJECTS = 1024  # of which it is remembered what was agreed on last


@dataclass(frozen=True)
class Agreed:
    """What the team agreed on about a subject. `time` is team time in seconds, `story` the message: who was used, who was not."""

    subject: str
    belief: Belief
    tick: int
    time: float
    story: Consensus

    @property
    def pose(self) -> Moments | None:
        """Mean (x, y, heading), shape (3,), of a robot in a joint, (x, y), shape (2,), of an object; None of anything else.

        With the covariance. It is exact, where `belief` has cells.
        """
        return pose_of(self.story.state or self.story.pose)

    @property
    def lost(self) -> float | None:
        """The probability that a robot in a joint is not where this says, 0 to 1; None of anything else."""
        return self.story.lost

    @property
    def existence(self) -> float | None:
        """The probability that there is what a track, as `person/7`, is of, 0 to 1; None of anything else."""
        return self.story.existence

    @property
    def velocity(self) -> Moments | None:
        """Velocity along x and y (unit / s), and of a robot its rate of turn (rad / s): shape (3,), of an object that rolls (2,).

        With the covariance. None where nobody knows, and of an object that walks at random.
        """
        return velocity_of(self.story.velocity)


class Newest:
    """Makes one stream of what several boards agree on: each subject's beliefs in the order of their stamps."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        #: subject -> time and tick of what was agreed on last, and Unix time when it came; the oldest arrival first
        self._last: dict[str, tuple[tuple[float, int], float]] = {}

    def hear_consensus(self, consensus: Consensus, now: float) -> Agreed | None:
        """What a consensus that came at a Unix time says, if it is new. Refused: "fields", "grid", "mass"."""
        at = consensus.time, consensus.tick
        last, since = self._last.get(consensus.subject, ((-math.inf, -1), now))
        if at <= last and now - since <= FORGOTTEN:
            return None
        belief = unpack(consensus.belief, self._grid)
        self._last.pop(consensus.subject, None)
        self._last[consensus.subject] = at, now
        if len(self._last) > MAX_SUBJECTS:
            del self._last[next(iter(self._last))]
        return Agreed(consensus.subject, belief, consensus.tick, consensus.time, consensus)

    def forget(self) -> None:
        """Stamps mean something else from now on."""
        self._last = {}

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        assert len(self._last) <= MAX_SUBJECTS


class TeamNews:
    """What a robot's process hears of its team, handed to the program: what is agreed, and what boards refused of the robot."""

    def __init__(
        self,
        grid: Grid,
        on_agreed: Callable[[Agreed], None] = lambda agreed: None,
        on_refused: Callable[[Refusal], None] = lambda refusal: None,
    ) -> None:
        self._newest, self._on_agreed, self._on_refused = Newest(grid), on_agreed, on_refused

    def on_news(self, heard: Cue | Message, now: float) -> None:
        """Take what came at a Unix time. Refused: as in `Newest.hear_consensus`; and whatever a callback raises."""
        if heard in (Cue.BEGIN, Cue.FREE):
            self._newest.forget()
        elif isinstance(heard, Consensus) and (agreed := self._newest.hear_consensus(heard, now)) is not None:
            self._on_agreed(agreed)
        elif isinstance(heard, Refusal):
            self._on_refused(heard)

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        self._newest.check()
