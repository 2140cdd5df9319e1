"""The fold: envelopes in, the state of the teams out. Pure: time is an argument, memory is bounded whatever arrives."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from blackboard.errors import Refused
from blackboard.state.moments import MAX_BYTES
from blackboard.state.team import TOKENS, TeamFold
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind

MAX_TEAMS = 16


class Fold:
    """All teams that are heard of. `hear_envelope` never raises for what arrives: it counts what it refuses."""

    def __init__(self, most_bytes: int = MAX_BYTES) -> None:
        """`most_bytes` are those of the moments of each team (`blackboard.state.moments`)."""
        self._most_bytes = most_bytes
        self.teams: dict[str, TeamFold] = {}
        self.refused: Counter[str] = Counter()  # by reason, as `blackboard.wire.messages.REASONS`

    def hear_envelope(self, envelope: Envelope, now: float) -> None:
        """Take one envelope that arrived at `now`, Unix seconds."""
        try:
            if envelope.kind in (Kind.ALIVE, Kind.GONE):
                parsed = keys.parse(envelope.key)
                if parsed is not None and parsed[0].name in TOKENS:
                    self._heard(parsed[1]["team"]).hear_token(*parsed, envelope, now)
            elif envelope.kind is Kind.PUT and (sender := _unread(envelope.key)) is not None:
                self._heard(sender.pop("team")).hear_sender(**sender, size=len(envelope.payload), now=now)
            elif envelope.kind is Kind.PUT:
                _, parts, message = open_envelope(envelope)
                self._heard(parts["team"]).hear_message(parts, message, len(envelope.payload), now)
        except Refused as refusal:
            self.refused[refusal.reason] += 1

    def expect(self, name: str, sub_teams: Mapping[str, Iterable[str]]) -> None:
        """The robots of a team's scenario by sub-team: they are shown although they were never heard."""
        for sub_team, robots in sub_teams.items():
            for robot in robots:
                self._heard(name).expect(sub_team, robot)

    def team(self, name: str) -> TeamFold:
        """The state of a team; an empty one before anything was heard of it."""
        return self.teams.get(name) or TeamFold(name)

    def _heard(self, name: str) -> TeamFold:
        if name not in self.teams and len(self.teams) >= MAX_TEAMS:
            raise Refused("too-many", f"{name} would be one more than {MAX_TEAMS} teams")
        return self.teams.setdefault(name, TeamFold(name, self._most_bytes))


def _unread(key: str) -> dict[str, Any] | None:
    """Who sends on a key whose messages show nothing new and are large: solo beliefs, evidence, memories; None for others."""
    if (parts := keys.SOLO.match(key)) is not None:
        return {"team": parts["team"], "kind": "robot", "name": parts["robot"], "sub_team": None}
    if (parts := keys.FORWARD.match(key) or keys.MEMORY.match(key)) is not None:
        return {"team": parts["team"], "kind": "board", "name": parts["board"], "sub_team": parts["sub_team"]}
    return None
