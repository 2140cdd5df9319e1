"""A lockstep run of real processes while a stranger talks into it: it ends, and not a bit of what the team believes has changed."""

import itertools
import json
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from blackboard.config import load
from blackboard.lab.team import InProcessTeam
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.flags import TeamFlags
from blackboard.run.launch import free_port
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Status
from tests.processes import Program, program
from tests.scenarios import patient_demo
from tests.wire.envelopes import put

ROBOTS, SECONDS = 3, 4.0  # a router, two boards, a world and these: everybody who can be spoken to
DEMO = TeamFlags(robots=ROBOTS).apply(load("demo")).changed("time", seconds=SECONDS)
BURST, PAUSE = 200, 0.01  # envelopes, and seconds between them: up to 20 000 a second
ENDS = 300.0  # seconds: a deadline that only a run misses that does not go on


def flood() -> list[Envelope]:
    """What a stranger sends without any token, in the names of invented robots and boards."""
    scenario = DEMO
    team, sub_team = scenario.team.name, next(iter(scenario.team.sub_teams))
    envelopes = []
    for i in range(200):
        status = Status(process=f"x{i}", kind="robot", tick=1, time=0.2, phase="reported", subjects=["object/ball"])
        envelopes.append(put(status, team=team, sub_team=sub_team))
        report = keys.REPORT.key(team=team, sub_team=sub_team, source=f"x{i}", subject="object/ball")
        envelopes.append(Envelope(report, bytes(500)))
        envelopes.append(Envelope(keys.FORWARD.key(team=team, sub_team=sub_team, board=f"x{i}"), b"\x80"))
    return envelopes


def disturbed(disturb: Callable[[Link, Program], None], folder: Path) -> dict[str, Any]:
    """The scorecard of a demo of real processes, while a stranger does something on a link of its own; stopped at the latest."""
    at = f"tcp/127.0.0.1:{free_port()}"
    length = ("--robots", str(ROBOTS), "--seconds", f"{SECONDS:g}")
    with program("-m", "blackboard", "up", patient_demo(folder), *length, "--json", "-l", at) as running:
        with Link(LinkConfig(connect=(at,)), "stranger", patience=30.0) as link:
            disturb(link, running)
        running.running.terminate()
        running.ends()
    card: dict[str, Any] = json.loads(running.out)
    assert card["ticks"] == round(SECONDS / DEMO.time.tick)
    return card


@cache
def undisturbed() -> str:
    """The hash of the same run in one process, without a network."""
    undisturbed_hash: str = InProcessTeam(DEMO).run()["hash"]
    return undisturbed_hash


@pytest.mark.long
def test_a_stranger_s_flood_changes_not_a_bit(tmp_path: Path) -> None:
    sent, pause, clock = 0, threading.Event(), UnixClock()

    def disturb(link: Link, team: Program) -> None:
        nonlocal sent
        envelopes, end = itertools.cycle(flood()), clock.now() + ENDS
        while team.running.poll() is None and clock.now() < end:
            for envelope in itertools.islice(envelopes, BURST):
                link.send(envelope)
            sent += BURST
            pause.wait(PAUSE)

    card = disturbed(disturb, tmp_path)
    assert sum(card["messages"]["refused"].values()) > 0
    assert card["counters"]["floods"] > 0
    assert sent > 1000
    assert card["hash"] == undisturbed()


@pytest.mark.long
def test_tokens_of_processes_that_say_nothing_change_not_a_bit(tmp_path: Path) -> None:
    """100 robots' tokens, and those of two boards."""
    team = DEMO.team

    def disturb(link: Link, running: Program) -> None:
        first, *_ = team.sub_teams
        for i in range(100):
            link.token(keys.MEMBER.key(team=team.name, sub_team=first, robot=f"x{i}"))
        for name in ("a-first", "z-last"):
            link.token(keys.BOARD.key(team=team.name, sub_team=first, board=name))
        running.running.wait(ENDS)

    card = disturbed(disturb, tmp_path)
    assert card["counters"].get("given_up", 0) == 0
    assert card["hash"] == undisturbed()
