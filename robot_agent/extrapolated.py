"""Odometry of steps that have none yet, because it comes less often than steps: extrapolated at constant velocity. Pure.

If such a robot were taken to stand, its sightings would be of the place before, and the odometry that then comes would drive once
more what fixes have shown already. So the robot is taken to move on as in the newest odometry. When the next one comes, only the
difference to what was extrapolated is left of it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from blackboard.wire.gaussians import one_way, parts_of
from blackboard.wire.messages import Odometry
from robot_agent.untold import LATE, PIECES, long, moves

SHORTEST = 1e-3  # seconds from step to step, at least; less, or a time that goes back, is no step to extrapolate over
MOST = 10.0  # times the duration of the newest odometry: nothing is extrapolated farther
FARTHEST = 1e6  # units, radians or seconds of one odometry: beyond that it is a mistake


@dataclass(frozen=True)
class Extrapolated:
    """Immutable. `after` gives the next state, which has the odometry to use for the step."""

    odometry: Odometry | None = None  # to use for the newest step; None: nothing is known of it
    _received: tuple[Odometry, ...] = ()  # the newest ones that the robot gave, at most `PIECES`
    _received_at: float = -math.inf  # team time (s) of the newest of these
    _until: float = -math.inf  # team time (s) up to which the motion is known or extrapolated
    _ahead: Odometry | None = None  # the sum of what was extrapolated since the newest of these

    def after(self, given: Odometry | None, time: float) -> "Extrapolated":
        """The state after a step that ends at a team time (s), by the odometry that the robot gave with it."""
        if given is not None:
            received = (*self._received, given)[-PIECES:]
            return Extrapolated(self._difference(given, time), received, time, time)
        since = time - self._until
        is_silent = time > self._received_at + LATE * long(self._received)
        if since < SHORTEST or is_silent or not _can_go_on(self._received[-1], since):
            return replace(self, odometry=None)
        on = _times(self._received[-1], since / self._received[-1].dt)
        return replace(self, odometry=on, _until=time, _ahead=on if self._ahead is None else one_way(self._ahead, on))

    def _difference(self, given: Odometry, time: float) -> Odometry:
        """Given odometry without what was extrapolated of it: all of it where it begins later than that."""
        ahead, since = self._ahead, time - self._until
        begins_later = time - given.dt > self._until + long(self._received) / 2
        if ahead is None or begins_later or since < SHORTEST or not _is_possible(given):
            return given
        rest, dt = one_way(_times(ahead, -1.0), given), max(given.dt - ahead.dt, since)
        return rest.model_copy(update={"dt": dt, **_sigmas(given, dt / given.dt)})


def _can_go_on(newest: Odometry, seconds: float) -> bool:
    """Whether a robot may be taken to move on for some seconds as in its newest odometry."""
    return moves(newest) and _is_possible(newest) and seconds <= MOST * newest.dt


def _is_possible(given: Odometry) -> bool:
    return max(abs(given.distance), abs(given.aside), abs(given.turn), given.dt) <= FARTHEST


def _times(given: Odometry, factor: float) -> Odometry:
    """A part or a multiple of a motion; with -1 it leads back to where it began."""
    curved, driven = parts_of(given)
    return Odometry(
        distance=factor * given.distance,
        turn=factor * given.turn,
        dt=abs(factor) * given.dt,
        aside=factor * given.aside,
        curved=factor * curved,
        driven=factor * driven,
        **_sigmas(given, abs(factor)),
    )


def _sigmas(given: Odometry, share: float) -> Mapping[str, float | None]:
    """The sigmas of a share of a motion: variances grow with time."""
    sigmas = {"distance_sigma": given.distance_sigma, "turn_sigma": given.turn_sigma}
    return {name: None if sigma is None else sigma * math.sqrt(share) for name, sigma in sigmas.items()}
