"""What a team of other people knows, told to a simulated team, whose scores it must not touch."""

from typing import Any

import pytest

from blackboard.board.service import BoardService
from blackboard.client.member import Member
from blackboard.client.share import Share
from blackboard.config import BoardSection, Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.belief import gaussian
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus

SCENARIO = Scenario(
    {
        "team": {"name": "here", "sub_teams": {"a": ["r1", "r2"]}, "guests": "vote"},
        "grid": {"shape": [20, 20]},
        "time": {"tick": 0.5, "seconds": 6.0, "mode": "realtime"},
        "board": {"fusion": "opinions"},
        "world": {"objects": {"ball": {}}},
    }
)
NEW = "object/new"


def run(shared: bool) -> tuple[dict[str, Any], list[Consensus]]:
    """The scorecard of the simulated team, and what it agreed on about an object that only the other team knows."""
    team, agreed = InProcessTeam(SCENARIO), list[Consensus]()
    if shared:
        member = Member(team="there", sub_teams=("s",), robot="z", grid=SCENARIO.grid, settings=BoardSection())
        team.join(
            BoardService(team="there", sub_team="s", board="b", grid=SCENARIO.grid, settings=BoardSection(period=0.01))
        )
        team.join(member)
        settings = SCENARIO.board
        share = Share("there", "here", sub_team="a", grid=SCENARIO.grid, settings=settings, every=0.01)
        team.join(share)

        def spy(envelope: Envelope) -> None:
            if keys.CLOCK.match(envelope.key):  # with each tick of the one team the other one says something new
                team.send(member, member.report(NEW, gaussian(SCENARIO.grid, (5.0, 6.0), 1.0), team.now))
            if envelope.key == keys.AGREED.key(team="here", sub_team="a", subject=NEW):
                agreed.append(decode(Consensus, envelope.payload))

        team.bus.spies.append(spy)
    return team.run(), agreed


def test_a_simulated_team_knows_what_it_is_told_and_is_scored_as_before() -> None:
    alone, _ = run(shared=False)
    card, agreed = run(shared=True)
    assert len(agreed) > 2
    assert set(agreed[-1].ancestors) == {"from.there", "there..z"}
    for group in ("robots", "objects"):
        for level in ("solo", "consensus", "agreed"):
            with_it, without = card["scores"][group][level], alone["scores"][group][level]
            assert with_it["n"] == without["n"]
            # in real time a microsecond decides in which tick a board learns, so not to the digit
            assert with_it["rmse"] == pytest.approx(without["rmse"], rel=0.05)
    assert card["verdict"] == alone["verdict"]
