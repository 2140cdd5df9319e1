"""A robot of another program in a world that waits for everybody: nobody waits in vain, and it is in every consensus."""

from blackboard.client.member import Member
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.belief import gaussian
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock
from tests.heard import Heard
from tests.scenarios import SCENARIO


class Still(Member):
    """It reports where it stands at every third tick; in between that stands."""

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        out = super().receive(envelope, now)
        if keys.CLOCK.match(envelope.key) and decode(Clock, envelope.payload).tick % 3 == 0:
            out += self.report("robot/c1", gaussian(self.grid, (12, 12), 1.0), now)
        return out


def test_a_client_in_lockstep_is_waited_for_and_keeps_nobody_waiting() -> None:
    team = InProcessTeam(SCENARIO.changed("team", guests="vote"))
    client = Still(team="t", sub_teams=("a",), robot="c1", grid=SCENARIO.grid, settings=SCENARIO.board)
    team.join(client)
    heard = Heard(team.bus)
    result = team.run()
    assert team.world.why == ""
    clocks, said = heard.of(keys.CLOCK), heard.of(keys.CONSENSUS, subject="robot/c1")
    last = max(clock.tick for clock in clocks)
    assert all("c1" in clock.robots["a"] for clock in clocks if 0 < clock.tick < last)  # in tick 0 it had not come yet
    assert {consensus.tick for consensus in said if "c1" in {opinion.source for opinion in consensus.used}} == set(
        range(1, last + 1)
    )
    assert last >= result["ticks"]
    assert [board.counters["late"] for board in team.boards.values()] == [0, 0]
    assert all(board.refused.total() == 0 for board in team.boards.values())
