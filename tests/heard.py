"""All that the services of a team say on their bus, by topic."""

from collections import defaultdict
from typing import Any

from blackboard.lab.team import InProcessTeam
from blackboard.net.bus import Bus
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.keys import Topic
from blackboard.wire.messages import MODELS, Consensus

Agreed = dict[str, dict[tuple[int, str], Consensus]]  # sub-team -> tick and subject -> what was agreed on


class Heard:
    """What is sent on a bus from now on."""

    def __init__(self, bus: Bus) -> None:
        self.envelopes: list[Envelope] = []
        bus.spies.append(self.envelopes.append)

    def of(self, topic: Topic, **parts: str) -> list[Any]:
        """The messages of a topic whose keys have these parts, in the order of sending."""
        puts = (
            (topic.match(envelope.key), envelope.payload) for envelope in self.envelopes if envelope.kind is Kind.PUT
        )
        model = MODELS[topic.message]
        return [decode(model, payload) for named, payload in puts if named and parts.items() <= named.items()]

    def agreed(self) -> Agreed:
        """What was agreed on."""
        agreed: Agreed = defaultdict(dict)
        for consensus in self.of(keys.AGREED):
            agreed[consensus.sub_team][consensus.tick, consensus.subject] = consensus
        return agreed


def played(team: InProcessTeam) -> tuple[str, Agreed]:
    """Run a team to its end, which must be the regular one: the hash over all consensuses, and what was agreed on."""
    heard = Heard(team.bus)
    team.run()
    assert team.world.why == ""
    return team.world.referee.hash, heard.agreed()
