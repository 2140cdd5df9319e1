"""The protocols of a replay: which landmark sightings the robots may use, and who is not given its start pose.

A protocol makes the recording harder, so that the team matters: without landmarks a robot depends on its team-mates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class SightingProtocol:
    """`allows` says whether a robot (its number) may use the sighting of a landmark (its number) at a time (s since the start)."""

    allows: Callable[[int, int, float], bool]
    lost: Callable[[int], bool] = lambda robot: False  # who gets a compass instead of its start pose


PROTOCOLS = {
    "A_all": SightingProtocol(lambda robot, landmark, t: True),
    "B_turns": SightingProtocol(lambda robot, landmark, t: robot == 1 + int(t // 60) % 5),  # one robot a minute
    "C_blind12": SightingProtocol(lambda robot, landmark, t: robot not in (1, 2)),
    "D_one3": SightingProtocol(lambda robot, landmark, t: robot == 3),
    "E_south": SightingProtocol(lambda robot, landmark, t: 6 <= landmark <= 10),
    "F_nolm": SightingProtocol(lambda robot, landmark, t: False),
    "G_wake": SightingProtocol(lambda robot, landmark, t: True, lost=lambda robot: True),
    "H_lost12": SightingProtocol(lambda robot, landmark, t: robot not in (1, 2), lost=lambda robot: robot in (1, 2)),
}

#: Protocols of the recording's page that are judged sighting by sighting, and so cannot be replayed.
NOT_REPLAYED = ("O1_landmark", "O2_mate")
