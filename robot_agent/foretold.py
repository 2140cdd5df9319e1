"""The odometry of a step that has none, because its piece comes late: as the piece before. The one that comes tells the rest. Pure.

Taken to stand meanwhile, a robot would see others from where it was, and drive once more what its fixes have told already.
"""

import math
from dataclasses import dataclass, replace

from blackboard.wire.gaussians import one_way, parts_of
from blackboard.wire.messages import Odometry
from robot_agent.untold import LATE, PIECES, long, moves

SHORTEST = 1e-3  # seconds from step to step, at least: nothing is foretold of less, or of a time that goes back
MOST = 10.0  # times a piece that it may stand for
FARTHEST = 1e6  # units, radians or seconds of a piece: beyond that, it is a mistake


@dataclass(frozen=True)
class Foretold:
    """`after` gives the state once a further step has ended."""

    odometry: Odometry | None = None  # of the newest step: told, foretold, or what is left of a piece
    _pieces: tuple[Odometry, ...] = ()  # the newest ones that were told
    _told: float = -math.inf  # team time (s) of the newest of them
    _until: float = -math.inf  # team time (s) up to which its motion was told or foretold
    _ahead: Odometry | None = None  # what was foretold since that piece

    def after(self, told: Odometry | None, time: float) -> "Foretold":
        """The same after a step that ends at a team time (s), and was `told` this odometry."""
        if told is not None:
            pieces = (*self._pieces, told)[-PIECES:]
            return Foretold(self._rest(told, time), pieces, time, time)
        since = time - self._until
        is_late = since >= SHORTEST and time <= self._told + LATE * long(self._pieces)
        if not is_late or not _leads_on(self._pieces[-1], since):
            return replace(self, odometry=None)
        on = _times(self._pieces[-1], since / self._pieces[-1].dt)
        return replace(self, odometry=on, _until=time, _ahead=on if self._ahead is None else one_way(self._ahead, on))

    def _rest(self, told: Odometry, time: float) -> Odometry:
        """What a piece tells beyond what was foretold; all of it, where what was foretold is lost, or time goes back."""
        ahead, since = self._ahead, time - self._until
        is_of_it = since >= SHORTEST and time - told.dt <= self._until + long(self._pieces) / 2
        if ahead is None or not is_of_it or not _is_possible(told):
            return told
        rest, dt = one_way(_times(ahead, -1.0), told), max(told.dt - ahead.dt, since)
        return rest.model_copy(update={"dt": dt} | _sigmas(told, dt / told.dt))


def _leads_on(piece: Odometry, seconds: float) -> bool:
    """Whether a robot that moved so may be taken to move on for some seconds."""
    return moves(piece) and _is_possible(piece) and seconds <= MOST * piece.dt


def _is_possible(piece: Odometry) -> bool:
    return max(abs(piece.distance), abs(piece.aside), abs(piece.turn), piece.dt) <= FARTHEST


def _times(piece: Odometry, factor: float) -> Odometry:
    """A part or a multiple of a piece; by -1 it leads back to where the piece began."""
    curved, driven = parts_of(piece)
    return Odometry(
        distance=factor * piece.distance,
        turn=factor * piece.turn,
        dt=abs(factor) * piece.dt,
        aside=factor * piece.aside,
        curved=factor * curved,
        driven=factor * driven,
        **_sigmas(piece, abs(factor)),
    )


def _sigmas(piece: Odometry, share: float) -> dict[str, float | None]:
    """Those of a share of a piece, whose variances grow with time."""
    sigmas = {"distance_sigma": piece.distance_sigma, "turn_sigma": piece.turn_sigma}
    return {name: None if sigma is None else sigma * math.sqrt(share) for name, sigma in sigmas.items()}
