"""Two processes of one name are told, by each of the two and by those who look on; one that is started again is not."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from blackboard.net.link import Link
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.messages import Status
from tests.processes import Program, program, wait_until

WARNING = "another process sends under this name, too; stop one of the two, or give it another name (--id)"
COMMANDS = {
    "board-a": ("-m", "blackboard", "serve", "--team", "t", "--sub-team", "a"),
    "r1": ("-m", "robot_agent", "--team", "t", "--sub-team", "a", "--id", "r1"),
}


def run(stack: ExitStack, name: str, endpoint: str) -> Program:
    running = stack.enter_context(program(*COMMANDS[name], "-e", endpoint))
    running.says("ready")
    return running


@pytest.mark.parametrize(("name", "kind"), [("board-a", "board"), ("r1", "robot")])
def test_two_of_one_name_are_told_and_one_that_comes_back_is_not(
    name: str, kind: str, endpoint: str, connect: Callable[[str], Link]
) -> None:
    link, key = connect("watcher"), keys.STATUS.key(team="t", sub_team="a", process=name)

    def statuses() -> list[Status]:
        return [decode(Status, envelope.payload) for envelope in link.get(key)]

    with ExitStack() as stack:
        first, second = run(stack, name, endpoint), run(stack, name, endpoint)
        for running in (first, second):
            running.says(f"{key}: {WARNING}")
        wait_until(lambda: [it.namesakes for it in statuses()] == [1, 1], "each counts the other one")
        with program("-m", "blackboard", "status", "--json", "-e", endpoint) as status:
            assert status.ends() == 0, status.err
            (found,) = json.loads(status.out)["teams"][0]["processes"]
            assert (found["name"], found["counters"]["namesakes"]) == (name, 1)
        command = ("health", kind, "--id", name, "--team", "t", "--max-age", "inf", "-e", endpoint)
        with program("-m", "blackboard", *command) as health:
            health.ends()
            assert kind == "robot" or health.out == f"healthy, but 2 processes answer as board {name}\n"
        for running in (first, second):
            running.running.kill()
            running.ends()
            assert running.err.count(WARNING) == 1
        again = run(stack, name, endpoint)
        # as many statuses as show another one of this name, one a second, and some more
        wait_until(lambda: [it.counters.get("sent", 0) >= 8 for it in statuses()] == [True], "it speaks for a while")
        assert [it.namesakes for it in statuses()] == [0]
        assert WARNING not in again.err
