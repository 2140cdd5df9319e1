"""What consumers of a team's consensuses get of a run."""

from itertools import count

from blackboard.lab.team import InProcessTeam
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus

Key = tuple[str, str, str, int]  # sub-team, level, subject, tick


class Stream:
    """Every consensus of a run as consumers get it, in the order of sending."""

    def __init__(self, team: InProcessTeam) -> None:
        self.sent: list[Consensus] = []
        team.bus.spies.append(self._record)

    def _record(self, envelope: Envelope) -> None:
        if "/consensus/" in envelope.key or "/agreed/" in envelope.key:
            self.sent.append(decode(Consensus, envelope.payload))

    @staticmethod
    def key(consensus: Consensus) -> Key:
        return consensus.sub_team, consensus.level, consensus.subject, consensus.tick

    @property
    def beliefs(self) -> dict[Key, Consensus]:
        """The consensus of each key, without the name of its board."""
        return {self.key(consensus): consensus.model_copy(update={"board": ""}) for consensus in self.sent}

    def check(self) -> None:
        """One stream: nothing goes back in time, and what is said again, to a Clock that is repeated, is the same."""
        first: dict[Key, Consensus] = {}
        newest: dict[tuple[str, str, str], int] = {}
        for consensus in self.sent:
            where = consensus.sub_team, consensus.level, consensus.subject
            assert consensus.tick >= newest.get(where, -1), consensus
            assert first.setdefault(self.key(consensus), consensus) == consensus
            newest[where] = consensus.tick

    def boards(self, sub_team: str) -> list[str]:
        """Who spoke for a sub-team, by tick."""
        by_tick = {consensus.tick: consensus.board for consensus in self.sent if consensus.sub_team == sub_team}
        return [by_tick[tick] for tick in sorted(by_tick)]


def lose_some(team: InProcessTeam) -> None:
    """Every 17th message of a team disappears, but for those of its world."""
    numbers = count(1)
    team.bus.lose = lambda envelope: next(numbers) % 17 == 0 and "/world/" not in envelope.key
