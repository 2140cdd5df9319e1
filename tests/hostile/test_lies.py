"""Every lie of the catalogue, on a small team: it says something else than the honest robot, and nobody dies of it.

`make test` tries one of each kind in a joint, `make fuzz` all of them in both fusions.
"""

from functools import cache

import numpy as np
import pytest

from blackboard.chaos.cases import chosen
from blackboard.chaos.lies.catalogue import CATALOGUE, Lie
from blackboard.chaos.lies.changes import Absurd, Off
from blackboard.chaos.lies.liar import Liar
from blackboard.chaos.lies.trial import guests_of, liars_of, lying_team, run_lie, span
from blackboard.config import Scenario, load
from blackboard.errors import UserError
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from tests.scenarios import LEARNS

TEAM = LEARNS.changed("time", seconds=4.0).changed("world", objects={"ball": {"drift": 0.2}})
QUICK = {
    "sure-off", "epochs-pulls", "replays-5", "clock-slow", "tells-poses", "knows-all", "echoes", "absurd-10",
    "drives-back", "guests-off",
}  # fmt: skip
TRIED = [
    pytest.param(fusion, lie, id=f"{fusion}-{lie.name}", marks=() if quick else pytest.mark.hostile)
    for fusion in ("joint", "opinions")
    for lie in CATALOGUE.values()
    for quick in [fusion == "joint" and lie.name in QUICK]
]


class Played:
    """A run with a lie, and the reports that each robot sent, by tick of sending."""

    def __init__(self, scenario: Scenario, lie: Lie | None) -> None:
        self.team = lying_team(scenario, lie, np.random.default_rng(1))
        self.reports: list[tuple[int, str, Envelope]] = []
        self.team.bus.spies.append(self._note)
        run_lie(self.team, lie)

    def _note(self, envelope: Envelope) -> None:
        if parts := keys.REPORT.match(envelope.key):
            self.reports.append((self.team.world.tick, parts["source"], envelope))

    def of(self, robot: str, begin: int = 0, end: int = 1000) -> list[Envelope]:
        return [envelope for tick, source, envelope in self.reports if source == robot and begin <= tick < end]


@cache
def calm(fusion: str) -> Played:
    return Played(TEAM.changed("board", fusion=fusion), None)


@pytest.mark.long
def test_a_team_that_is_too_large_to_count_what_each_has_moved_goes_on() -> None:
    """Before, what its liar had moved could not be taken back, and boards went on without all that it said."""
    names = [f"r{k + 1}" for k in range(22)]
    scenario = load("demo").changed("team", sub_teams={"a": names[:11], "b": names[11:]}).changed("time", seconds=7.0)
    team = Played(scenario, CATALOGUE["apart-bearings"]).team
    assert not any(board.counters["failed"] for board in team.boards.values())


@pytest.mark.parametrize(("fusion", "lie"), TRIED)
@pytest.mark.team
def test_nobody_dies_of_a_lie(fusion: str, lie: Lie) -> None:
    honest, played = calm(fusion), Played(TEAM.changed("board", fusion=fusion), lie)
    team = played.team
    assert not any(board.counters["failed"] for board in team.boards.values())
    assert not any(robot.counters["failed"] for robot in team.robots.values())
    assert team.world.why == ""
    assert all(board.clock.tick == team.world.tick for board in team.boards.values())
    begin = round(span(TEAM, lie)[0] / TEAM.time.tick)
    for liar in liars_of(TEAM, lie.liars):
        assert played.of(liar, 0, begin) == honest.of(liar, 0, begin)
        if fusion == "joint":
            assert played.of(liar, begin) != honest.of(liar, begin)
    for guest in guests_of(lie.guests):
        assert played.of(guest)


def test_a_lie_is_the_same_to_the_bit_each_time() -> None:
    scenario, lie = TEAM.changed("board", fusion="joint"), CATALOGUE["absurd-10"]
    assert Played(scenario, lie).reports == Played(scenario, lie).reports


def test_who_lies_in_turns() -> None:
    lie = Lie("turns", (Off((3.0, 0.0)),), on=1.0, off=1.0)
    assert [lie.is_told(since) for since in (0.0, 0.5, 1.0, 1.5, 2.0)] == [True, True, False, False, True]


def test_what_is_sent_again_is_the_same_lie() -> None:
    lie = Lie("absurd", (Absurd(5),), start=0.0, end=1.0)
    team = lying_team(TEAM.changed("board", fusion="joint"), lie, np.random.default_rng(2))
    team.run_until(lambda: team.world.tick == 4)
    (liar,) = [service for service in team.services if isinstance(service, Liar)]
    robot = team.robots[liars_of(TEAM, 1)[0]]
    honest = robot.peer.say(robot.peer.answers, team.now)
    assert liar.said(honest) == liar.said(honest)
    assert liar.said(honest) != honest


def test_the_catalogue_has_what_was_asked_for() -> None:
    assert len(CATALOGUE) >= 40
    assert {lie.liars for lie in CATALOGUE.values()} == {0, 1, 2}
    assert {lie.guests for lie in CATALOGUE.values()} == {0, 1, 2}
    assert chosen("off-3, two-off", CATALOGUE, "lie") == [CATALOGUE["off-3"], CATALOGUE["two-off"]]
    with pytest.raises(UserError, match="--only nothing: no such lie; choose from off-2, "):
        chosen("nothing", CATALOGUE, "lie")


def test_who_lies_is_the_last_of_each_sub_team_in_turn() -> None:
    scenario = TEAM.changed("team", sub_teams={"a": ["r1", "r2", "r3"], "b": ["r4", "r5"]})
    assert liars_of(scenario, 3) == ["r3", "r5", "r2"]
