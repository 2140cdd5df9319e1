"""Two processes of one name are told, by each of the two and by those who look on; one that is started again is not."""

import json
from collections.abc import Callable
from contextlib import ExitStack

from blackboard.net.link import Link
from blackboard.process.namesakes import SURE
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


def test_two_of_one_name_are_told_and_one_that_comes_back_is_not(endpoint: str, connect: Callable[[str], Link]) -> None:
    link = connect("watcher")
    status = {name: keys.STATUS.key(team="t", sub_team="a", process=name) for name in COMMANDS}

    def statuses(name: str) -> list[Status]:
        return [decode(Status, envelope.payload) for envelope in link.get(status[name])]

    def counted(name: str) -> list[int]:
        return [said.namesakes for said in statuses(name)]

    def sent(name: str) -> list[int]:
        return [said.counters.get("sent", 0) for said in statuses(name)]

    with ExitStack() as stack:
        twins = {name: [run(stack, name, endpoint) for _ in range(2)] for name in COMMANDS}
        for name, running in twins.items():
            for twin in running:
                twin.says(f"{status[name]}: {WARNING}")
        wait_until(lambda: all(counted(name) == [1, 1] for name in COMMANDS), "each counts the other one")
        with program("-m", "blackboard", "status", "--json", "-e", endpoint) as shown:
            assert shown.ends() == 0, shown.err
            processes = json.loads(shown.out)["teams"][0]["processes"]
            assert {process["name"]: process["counters"]["namesakes"] for process in processes} == dict.fromkeys(
                COMMANDS, 1
            )
        command = ("health", "board", "--id", "board-a", "--team", "t", "--max-age", "inf", "-e", endpoint)
        with program("-m", "blackboard", *command) as health:
            health.ends()
            assert health.out == "healthy, but 2 processes answer as board board-a\n"
        for twin in [twin for running in twins.values() for twin in running]:
            twin.running.kill()
            twin.ends()
            assert twin.err.count(WARNING) == 1
        again = [run(stack, name, endpoint) for name in COMMANDS]
        # as many statuses as show another one of this name, one a second, and some more
        wait_until(lambda: all(min(sent(name), default=0) > SURE + 2 for name in COMMANDS), "they speak for a while")
        assert [counted(name) for name in COMMANDS] == [[0], [0]]
        assert not any(WARNING in twin.err for twin in again)
