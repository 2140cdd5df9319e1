"""The protocols of a replay: which landmark sightings the robots may use, and who is not given its start pose.

A protocol makes the recording harder, so that the team matters: without landmarks a robot depends on its team-mates. In the
families `O1_landmark` and `O2_mate` one landmark, or one robot, is an object that the others look for. No robot knows where the
landmark is, and the robot does not take part.
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class SightingProtocol:
    """`allows` says whether a robot (its number) may use the sighting of a landmark (its number) at a time (s since the start)."""

    allows: Callable[[int, int, float], bool] = lambda robot, landmark, t: True
    lost: Callable[[int], bool] = lambda robot: False  # who gets a compass instead of its start pose
    unknown: int | None = None  # the number of the landmark or the robot that is an object


PROTOCOLS = {
    "A_all": SightingProtocol(),
    "B_turns": SightingProtocol(lambda robot, landmark, t: robot == 1 + int(t // 60) % 5),  # one robot a minute
    "C_blind12": SightingProtocol(lambda robot, landmark, t: robot not in (1, 2)),
    "D_one3": SightingProtocol(lambda robot, landmark, t: robot == 3),
    "E_south": SightingProtocol(lambda robot, landmark, t: 6 <= landmark <= 10),
    "F_nolm": SightingProtocol(lambda robot, landmark, t: False),
    "G_wake": SightingProtocol(lost=lambda robot: True),
    "H_lost12": SightingProtocol(lambda robot, landmark, t: robot not in (1, 2), lost=lambda robot: robot in (1, 2)),
}

#: Families of protocols, one for each landmark (its number 6 to 20) or each robot (1 to 5) of a recording.
FAMILIES = {
    "O1_landmark": {f"O1_landmark{n}": SightingProtocol(unknown=n) for n in range(6, 21)},
    "O2_mate": {f"O2_mate{n}": SightingProtocol(unknown=n) for n in range(1, 6)},
}


def protocol_of(name: str) -> SightingProtocol | None:
    """The protocol of a name, also of one in a family; None where there is none."""
    return PROTOCOLS.get(name) or next((family[name] for family in FAMILIES.values() if name in family), None)
