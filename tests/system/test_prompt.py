"""A board whose team says more than it can take in ends within 2 s of a SIGTERM, at any time."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from blackboard.chaos.lies.catalogue import CATALOGUE
from blackboard.chaos.lies.trial import liars_of, lying_team, run_lie
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Report
from tests.processes import LONG, program, seconds_to_end
from tests.scenarios import JOINT

pytestmark = pytest.mark.system

SCENARIO = JOINT.changed("time", seconds=4.0)
CROWD = [f"r{number}" for number in range(20, 32)]


@cache
def lies() -> list[Report]:
    """What a robot says that invents objects, in the tick in which it says most."""
    lie, said = CATALOGUE["invents-groups"], list[Report]()
    team = lying_team(SCENARIO, lie, np.random.default_rng(1))

    def note(envelope: Envelope) -> None:
        parts = keys.REPORT.match(envelope.key)
        if parts and parts["source"] == liars_of(SCENARIO, 1)[0]:
            said.append(decode(Report, envelope.payload))

    team.bus.spies.append(note)
    run_lie(team, lie)
    busiest = max({report.tick for report in said}, key=lambda tick: sum(report.tick == tick for report in said))
    return [report for report in said if report.tick == busiest]


@contextmanager
def crowd(endpoint: str, reports: list[Report]) -> Iterator[None]:
    """Many robots that say so again and again, as fast as they can."""
    over, clock = threading.Event(), UnixClock()

    def shout() -> None:
        tick = 0
        while not over.is_set():
            tick += 1
            for robot in CROWD:
                for report in reports:
                    now = clock.now()
                    subject = f"robot/{robot}" if report.subject.startswith("robot/") else report.subject
                    more = {"source": robot, "subject": subject, "tick": tick, "time": now, "ancestors": {robot: now}}
                    if report.evidence is not None:
                        epoch = {"epoch": 1000 * int(now) - 60_000}
                        more["evidence"] = report.evidence.model_copy(update=epoch)
                    key = keys.REPORT.key(team="t", sub_team="a", source=robot, subject=subject)
                    link.send(Envelope(key, encode(report.model_copy(update=more))))
                    if over.is_set():
                        return

    with Link(LinkConfig(connect=(endpoint,)), "crowd") as link:
        for robot in CROWD:
            link.token(keys.MEMBER.key(team="t", sub_team="a", robot=robot))
        thread = threading.Thread(target=shout)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


@pytest.mark.parametrize("agreed", [0, 1, 60])
def test_a_board_under_a_crowd_ends_within_two_seconds(endpoint: str, tmp_path: Path, agreed: int) -> None:
    """At the signal it has just begun, or has agreed on so many beliefs."""
    file, key = tmp_path / "team.json", keys.AGREED.key(team="t", sub_team="a", subject="**")
    named = {"a": [*SCENARIO.team.sub_teams["a"], *CROWD]}  # a board does not hear guests
    file.write_text(SCENARIO.changed("team", sub_teams=named).to_json())
    with (
        Link(LinkConfig(connect=(endpoint,)), "viewer") as viewer,
        crowd(endpoint, lies()),
        program("-m", "blackboard", "serve", "--scenario", str(file), "--sub-team", "a", "-e", endpoint) as board,
    ):
        viewer.subscribe(key)
        board.says("ready")
        heard: list[Envelope] = []
        while len(heard) < agreed:
            heard += viewer.receive(LONG)
        assert seconds_to_end(board) < 2.0
        assert "Traceback" not in board.err
