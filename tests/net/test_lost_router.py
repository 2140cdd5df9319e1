"""A router that is lost is one line in the log, and so is that it is back."""

import logging
import re

import pytest

from blackboard.net.link import Link
from blackboard.net.outage import PAUSE, Outage
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from tests.processes import introduce, program, wait_until


def connected() -> Outage:
    outage = Outage()
    outage.hear_router("R1", 0.0, here=True)
    return outage


# --- the machine ---------------------------------------------------------------------------------------------------------


def test_a_loss_and_its_end_are_told_once() -> None:
    outage = connected()
    assert outage.look(1.0) == []
    outage.hear_router("R1", 2.0, here=False)
    assert [outage.look(2.0 + n) for n in range(3)] == [[None], [], []]
    outage.hear_router("R2", 5.5, here=True)  # a router that was started again has another name
    assert [outage.look(6.0 + n) for n in range(3)] == [[3.5], [], []]


def test_what_was_over_before_anybody_looked_is_told_with_its_end() -> None:
    outage = connected()
    outage.hear_router("R1", 2.0, here=False)
    outage.hear_router("R2", 2.25, here=True)
    assert outage.look(2.5) == [None, 0.25]
    assert outage.look(3.0) == []


def test_as_long_as_another_router_is_there_none_is_lost() -> None:
    outage = connected()
    outage.hear_router("R2", 1.0, here=True)
    outage.hear_router("R1", 2.0, here=False)
    assert outage.look(3.0) == []
    outage.hear_router("R2", 4.0, here=False)
    assert outage.look(5.0) == [None]


def test_who_was_never_connected_has_lost_nothing() -> None:
    outage = Outage()
    outage.hear_router("R1", 1.0, here=False)
    assert outage.look(2.0) == []


def test_a_router_that_flaps_is_few_lines() -> None:
    outage, lines = connected(), 0
    for n in range(1000):
        outage.hear_router("R1", 1.0 + 0.1 * n, here=n % 2 == 1)
        lines += len(outage.look(1.0 + 0.1 * n))
    assert lines <= 2 * (100.0 / PAUSE + 1)


def test_a_loss_soon_after_another_one_is_told_later() -> None:
    outage = connected()
    for at in (1.0, 3.0):
        outage.hear_router("R1", at, here=False)
        outage.look(at)
        if at < 3.0:
            outage.hear_router("R1", at + 1.0, here=True)
            outage.look(at + 1.0)
    assert outage.look(1.0 + PAUSE - 0.1) == []
    assert outage.look(1.0 + PAUSE) == [None]
    outage.hear_router("R1", 20.0, here=True)
    assert outage.look(20.0) == [17.0]


def test_a_clock_that_is_set_back_keeps_nothing_from_being_told() -> None:
    outage = connected()
    outage.hear_router("R1", 1e6, here=False)
    assert outage.look(1e6) == [None]
    outage.hear_router("R1", 1e6, here=True)
    outage.look(1e6)
    outage.hear_router("R1", 10.0, here=False)
    assert outage.look(10.0) == [None]


# --- a real router -------------------------------------------------------------------------------------------------------


@pytest.mark.system
def test_a_process_logs_that_its_router_was_killed_and_that_it_is_back() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    route = ("-m", "blackboard", "router", "-l", where)
    with program(*route) as first, program("-m", "robot_agent", "--id", "r1", "-e", where) as robot:
        first.says("ready")
        robot.says("ready")
        assert "lost the router" not in robot.err
        first.running.kill()
        first.ends()
        robot.says(f"warning  r1: lost the router ({where}); trying again")
        with program(*route) as second:
            second.says("ready")
            robot.says("info     r1: the router is back after ")
            robot.running.terminate()  # as it ends, it loses the router on purpose
            assert robot.ends() == 0
    assert (robot.err.count("lost the router"), robot.err.count("the router is back")) == (1, 1)
    assert re.search(r"back after \d+\.\d s\n", robot.err)


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_link_logs_it_while_it_is_read(mode: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    where = f"tcp/127.0.0.1:{free_port()}"
    config = LinkConfig(mode="router", listen=(where,))
    with Link(config, "router") as router, Link(LinkConfig(mode=mode, connect=(where,)), "a") as a:

        def says(text: str) -> None:
            wait_until(lambda: not a.receive(0.05) and text in caplog.text, f"it says {text!r}")

        introduce(a, router)
        router.close()
        says("a: lost the router")
        with Link(config, "router"):
            says("a: the router is back after ")
    assert caplog.text.count("lost the router") == 1
