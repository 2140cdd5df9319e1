"""The envelopes of a team in one process, with the tokens that its services hold, and the frames that a page gets of them."""

import json
from functools import cache
from typing import Any

import numpy as np

from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.process.service import Service
from blackboard.state.fold import Fold
from blackboard.state.team import TeamFold
from blackboard.tape import file as tape
from blackboard.wire.envelope import Envelope, Kind
from tests.files import GOLDEN
from tests.scenarios import SCENARIO

JOINT = SCENARIO.changed("board", fusion="joint").changed("robot", localizer="position")


class Deaf:
    """A link on which nothing can be asked for; what it receives is given."""

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def get(self, key_expr: str) -> list[Envelope]:
        return []


@cache
def recorded(joint: bool = False) -> tuple[tuple[Envelope, float], ...]:
    """Every envelope of a run with its time on the bus, in Unix seconds; tokens first."""
    return tuple(record(JOINT if joint else SCENARIO))


def record(scenario: Scenario) -> list[tuple[Envelope, float]]:
    team = InProcessTeam(scenario)
    services: list[Service] = [*team.boards.values(), *team.robots.values(), team.world]
    envelopes = [(Envelope(token, kind=Kind.ALIVE), team.now) for service in services for token in service.tokens]
    team.bus.spies.append(lambda envelope: envelopes.append((envelope, team.now)))
    team.run()
    return envelopes


def folded(joint: bool = False) -> Fold:
    """A fold that has taken a whole run."""
    fold = Fold()
    for envelope, now in recorded(joint):
        fold.hear_envelope(envelope, now)
    return fold


def team_of(joint: bool = False) -> TeamFold:
    return folded(joint).teams["t"]


def golden_team() -> TeamFold:
    """The team of the golden tape, read to its end."""
    fold = Fold()
    for at, envelope in tape.read(GOLDEN):
        fold.hear_envelope(envelope, at)
    return fold.teams["demo"]


def read(frame: bytes) -> tuple[dict[str, Any], bytes]:
    """The header of a frame of the page, and its levels."""
    length = int.from_bytes(frame[:4], "little")
    return json.loads(frame[4 : 4 + length]), frame[4 + length :]


def within(pieces: np.ndarray, x: float, y: float) -> bool:
    """Whether a point is inside the closed line that the pieces (x, y, x, y) make: by a ray to the right."""
    x1, y1, x2, y2 = pieces.T
    crosses = (y1 > y) != (y2 > y)
    at = x1[crosses] + (x2 - x1)[crosses] * (y - y1[crosses]) / (y2 - y1)[crosses]
    return int(np.count_nonzero(at > x)) % 2 == 1
