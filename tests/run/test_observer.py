"""What the launcher sees of a team."""

from blackboard.config import Scenario
from blackboard.net.bus import Bus
from blackboard.run.launch import Observer
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock

SCENARIO = Scenario({"team": {"name": "t", "sub_teams": {"a": ["r1"]}}, "time": {"tick": 0.5, "seconds": 10.0}})


def test_the_launcher_sees_who_is_alive_and_the_clock_by_the_one_fold() -> None:
    bus = Bus()
    world, link = bus.connect(), bus.connect()
    alive: list[int] = []
    counts: list[tuple[int, int]] = []

    def look() -> None:
        for envelope in link.receive():
            observer.hear_envelope(envelope)

    observer = Observer(link, SCENARIO, lambda: alive.append(len(counts)), lambda *at: counts.append(at))  # type: ignore[arg-type]
    world.token("cop/t/a/member/r1")
    look()
    assert (alive, observer.missing(frozenset({"cop/t/a/member/r1", "cop/t/a/board/x"}))) == ([], {"cop/t/a/board/x"})
    world.token("cop/t/world/alive")
    for tick in (1, 2):
        clock = Clock(run="1", tick=tick, time=0.5 * tick, mode="lockstep")
        world.send(Envelope("cop/t/world/clock", encode(clock)))
    world.send(Envelope("cop/t/world/clock", b"!"))
    look()
    assert alive
    assert counts[:2] == [(1, 20), (2, 20)]
    world.close()
    look()
    assert observer.missing(frozenset({"cop/t/a/member/r1"})) == {"cop/t/a/member/r1"}
