"""Tapes of real processes: recorded in lockstep and in real time, replayed to the bit, and played into a network."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from blackboard.net.link import Link
from blackboard.tape.file import read
from blackboard.wire.envelope import Kind
from tests.processes import Letters
from tests.system.test_demo import blackboard

GOLDEN = Path(__file__).parents[1] / "tape" / "golden.mcap"


@pytest.mark.long
def test_a_recorded_run_is_replayed_to_the_bit_in_lockstep_and_in_real_time(tmp_path: Path) -> None:
    for pace, more in (("lockstep", ()), ("realtime", ("--realtime",))):
        tape = tmp_path / f"{pace}.mcap"
        card = json.loads(
            blackboard("demo", "--robots", "2", "--seconds", "3", "--record", str(tape), "--json", *more).stdout
        )
        again = blackboard("replay", str(tape), "--json")
        found = json.loads(again.stdout)
        assert again.returncode == 0, again.stderr
        assert (found["mode"], found["ticks"]) == (pace, 15)
        assert found.keys() == card.keys()
        if pace == "lockstep":
            assert found["hash"] == card["hash"]


def test_a_tape_is_played_into_a_network(endpoint: str, connect: Callable[[str], Link]) -> None:
    listener = connect("listener")
    listener.subscribe("cop/demo/**")
    played = blackboard("replay", str(GOLDEN), "--speed", "4", "--only", "world", "-e", endpoint)
    assert played.returncode == 0, played.stderr
    Letters(listener).until(*[e for _, e in read(GOLDEN) if "/world/" in e.key and e.kind is Kind.PUT])
