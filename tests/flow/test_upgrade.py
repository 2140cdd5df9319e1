"""A rolling upgrade: members of the version before, and of one that is to come, in a team with members of today.

`tests/golden/before.mcap` was recorded by the version of commit e498b09, before statuses had `follows`, `sent` and `speed` and consensuses `ahead`, `dissent`
and `camps`:

    git worktree add /tmp/before e498b09 && cd /tmp/before && blackboard demo --robots 3 --seconds 3 --record before.mcap
"""

from pathlib import Path
from typing import Any

import msgpack
import pytest

from blackboard.lab.team import InProcessTeam
from blackboard.net.bus import intersects
from blackboard.tape.content import Tape, load_tape
from blackboard.tape.whatif import what_if
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, Report
from robot_agent.team import robot_of
from tests.hostile.attack import Attack, report_key, status_key
from tests.scenarios import JOINT, SCENARIO
from tests.wire.messages import as_map

BEFORE = Path(__file__).parents[1] / "golden" / "before.mcap"
Agreed = dict[tuple[str, int, str], Consensus]


@pytest.fixture(scope="module")
def before() -> Tape:
    return load_tape(BEFORE)


def agreed(envelopes: list[Envelope]) -> Agreed:
    """The agreed beliefs among some envelopes, by sub-team, tick and subject."""
    published = ((keys.AGREED.match(envelope.key), envelope) for envelope in envelopes if envelope.kind is Kind.PUT)
    consensuses = [decode(Consensus, envelope.payload) for parts, envelope in published if parts is not None]
    return {(consensus.sub_team, consensus.tick, consensus.subject): consensus for consensus in consensuses}


#: Units by which beliefs may be elsewhere than in that version: since then a heading that is known badly widens the way, and sightings
#: are expected with what the error of a place adds.
CHANGED = 0.15


def test_robots_of_the_version_before_are_understood_by_boards_of_today(before: Tape) -> None:
    fields = [msgpack.unpackb(e.payload) for _, e in before.envelopes if keys.STATUS.match(e.key) and e.payload]
    assert fields
    assert not any({"follows", "term", "speed", "since"} & said.keys() for said in fields)
    played = what_if(before, before.scenario)
    assert played.refused == {}
    then, now = agreed([e for _, e in before.envelopes]), agreed([e for _, e in played.sent])
    assert then.keys() == now.keys()
    for where, belief in then.items():
        assert unpack(now[where].belief).mean() == pytest.approx(unpack(belief.belief).mean(), abs=CHANGED)


def test_boards_of_the_version_before_are_understood_by_robots_of_today(before: Tape) -> None:
    robot, said, now = robot_of(before.scenario, "r1"), list[Envelope](), 0.0
    for at, envelope in before.envelopes:
        now = at
        own = keys.STATUS.match(envelope.key) or keys.REPORT.match(envelope.key)
        if envelope.kind is not Kind.PUT or not own:
            is_for_it = any(intersects(one, envelope.key) for one in robot.listens + robot.watches)
            said += robot.receive(envelope, now) if is_for_it else []
    said += robot.wake(now)
    reports = [e for e in said if keys.REPORT.match(e.key)]
    recorded = {
        e.key: decode(Report, e.payload)
        for _, e in before.envelopes
        if e.kind is Kind.PUT and e.key in {report.key for report in reports}
    }
    assert (robot.refused, robot.counters["failed"], robot.tick) == ({}, 0, 15)
    newest = {e.key: decode(Report, e.payload) for e in reports}
    for key, then in recorded.items():
        assert newest[key].tick == then.tick
        assert unpack(newest[key].belief).mean() == pytest.approx(unpack(then.belief).mean(), abs=CHANGED)
        now_informed, informed = newest[key].informed, then.informed
        assert (now_informed is None) == (informed is None)
        if now_informed is not None and informed is not None:
            assert now_informed.ancestors == informed.ancestors
            assert unpack(now_informed.belief).mean() == pytest.approx(unpack(informed.belief).mean(), abs=CHANGED)
    assert any(report.informed is not None for report in newest.values())


def nothing_was_refused(team: InProcessTeam) -> None:
    services: list[Any] = [*team.boards.values(), *team.robots.values(), team.world]
    assert {str(dict(service.refused)) for service in services} == {"{}"}


def more(value: Any) -> Any:
    """A message of a version to come: every map of its own fields has one that nobody knows."""
    if isinstance(value, dict):
        grown = {name: more(item) for name, item in value.items()}
        return grown | {"x_new": {"deep": [1, "two", None]}} if "version" in value or "grid" in value else grown
    return [more(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("scenario", [SCENARIO, JOINT], ids=["opinions", "joint"])
def test_fields_that_nobody_knows_change_nothing(scenario: Any) -> None:
    beliefs = []
    for change in (False, True):
        team, sent = InProcessTeam(scenario), list[Envelope]()
        team.bus.spies.append(sent.append)
        deliver = team.bus.deliver

        def grown(link: Any, envelope: Envelope, sender: Any, deliver: Any = deliver, change: bool = change) -> None:
            if change and envelope.kind is Kind.PUT:
                envelope = Envelope(envelope.key, msgpack.packb(more(msgpack.unpackb(envelope.payload))))
            deliver(link, envelope, sender)

        team.bus.deliver = grown  # type: ignore[method-assign, assignment]
        team.run()
        nothing_was_refused(team)
        beliefs.append({where: consensus.belief for where, consensus in agreed(sent).items()})
    assert beliefs[0] == beliefs[1]


@pytest.mark.parametrize("scenario", [SCENARIO, JOINT], ids=["opinions", "joint"])
def test_members_may_change_their_coding_one_after_another(scenario: Any) -> None:
    places = []
    for board, robot in (("log8", "log8"), ("log8", "log16"), ("log16", "log8")):
        team, sent = (
            InProcessTeam(scenario.changed("board", coding=board).changed("robot", coding=robot)),
            list[Envelope](),
        )
        team.bus.spies.append(sent.append)
        team.run()
        nothing_was_refused(team)
        said = agreed(sent)
        reports = [decode(Report, e.payload) for e in sent if keys.REPORT.match(e.key) and e.kind is Kind.PUT]
        assert {consensus.belief.coding for consensus in said.values()} == {board}
        assert {report.belief.coding for report in reports} == {robot}
        places.append({where: unpack(consensus.belief).mean() for where, consensus in said.items()})
    for other in places[1:]:
        assert other.keys() == places[0].keys()
        assert all(mean == pytest.approx(places[0][where], abs=0.3) for where, mean in other.items())


def test_a_robot_of_another_protocol_version_is_refused_by_name_and_the_others_go_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    attack = Attack()
    for key in (report_key("r2", "robot/r2"), status_key("r2")):
        attack.instead(key, lambda said, key=key: [(key, as_map(said) | {"version": 2})])  # type: ignore[misc]
    attack.goes_on()
    board = attack.team.boards["a"]
    assert board.refused["version"] > 0
    assert f"refused {report_key('r2', 'robot/r2')} (version: version 2; this process speaks 1)" in caplog.text
