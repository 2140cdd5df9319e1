"""How far a robot may have moved while no odometry measured it. Pure.

Either readings were lost on their way, or they come without odometry. Meanwhile the robot may have driven in any direction as fast as
before, and have turned. Odometry may arrive later than other readings, and its pieces may differ in length. So a gap counts only if it
is longer than half of a long piece. A robot whose newest odometry is of no way and no turn is taken to stand. So is one that never
told a motion, such as a camera on a mast, unless its fixes show that it moves (`gaussian/roaming.py`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from blackboard.wire.messages import Odometry, Readings

TURNING = 0.3  # rad/s: by which a robot that drives may have turned while nothing was measured
PIECES = 50  # of odometry, that are remembered
LONG = 0.9  # the quantile of their durations that counts as a long one
LATE = 1.5  # times as long as a long piece: odometry that is late by more is silent


@dataclass(frozen=True)
class Unseen:
    """Unmeasured motion: how far the robot may have come (sigma, unit) and turned (sigma, radians; beyond pi anywhere)."""

    way: float = 0.0
    turn: float = 0.0

    def less(self, earlier: "Unseen") -> "Unseen":
        """What this adds to what was counted earlier: as it goes on in whatever direction it went, these add up."""
        return Unseen(max(0.0, self.way - earlier.way), max(0.0, self.turn - earlier.turn))


NOTHING = Unseen()


@dataclass(frozen=True)
class Untold:
    """The unmeasured motion of a robot up to its newest readings. `after` gives the state once further readings have come."""

    lapse: Unseen = NOTHING  # what the newest readings added to it
    whole: Unseen = NOTHING  # since the odometry before them
    _pieces: tuple[Odometry, ...] = ()  # the newest ones
    _since: float | None = None  # team time (s) up to which its motion was measured
    _counted: Unseen = NOTHING  # what was given as a `lapse` since then

    @property
    def is_all(self) -> bool:
        """Whether no odometry was ever told."""
        return not self._pieces

    def after(self, readings: Readings) -> "Untold":
        """The same after the readings that follow."""
        told, since = readings.odometry, self._since
        pieces = self._pieces if told is None else (*self._pieces, told)[-PIECES:]
        if since is None or not pieces:  # it never moved
            return Untold(_pieces=pieces, _since=readings.time)
        missing = readings.time - since - (0.0 if told is None else told.dt)
        late = self._long(told) * (LATE if told is None else 0.5)
        whole = NOTHING if missing <= late else self._gone(missing, told)
        lapse = whole.less(self._counted)
        if told is None:
            counted = self._counted if whole == NOTHING else whole
            return replace(self, lapse=lapse, whole=whole, _counted=counted)
        return Untold(lapse, whole, pieces, readings.time)

    def _long(self, told: Odometry | None) -> float:
        """Seconds that a long piece of odometry lasts."""
        usual = long(self._pieces)
        return usual if told is None else max(usual, told.dt)

    def _gone(self, seconds: float, told: Odometry | None) -> Unseen:
        """How far it may have moved in a gap: at the larger speed before and after it, or, while it lasts, at the RMS speed."""
        known = self._pieces if told is None else (*self._pieces[-1:], told)
        speeds = [math.hypot(piece.distance, piece.aside) / piece.dt for piece in known]
        rates = [abs(piece.turn) / piece.dt for piece in known]
        if told is not None:
            speed, rate = max(speeds), max(rates)
        elif moves(known[-1]):
            speed, rate = (math.sqrt(sum(each**2 for each in some) / len(some)) for some in (speeds, rates))
        else:
            speed = rate = 0.0
        return Unseen(speed * seconds, max(rate, TURNING if speed else 0.0) * seconds)


#: Before any readings.
ALL_TOLD = Untold()


def long(pieces: Sequence[Odometry]) -> float:
    """Seconds that a long one of some pieces lasts; 0 of none."""
    durations = sorted(piece.dt for piece in pieces)
    return durations[int(LONG * (len(durations) - 1))] if durations else 0.0


def moves(piece: Odometry) -> bool:
    """Whether a piece is of any way or turn."""
    return bool(piece.distance or piece.turn or piece.aside)
