"""The process of a robot: when it acts with a world, without one, and when a world comes and goes."""

import logging

import pytest

from blackboard.process.team_clock import WORLD_SILENT
from blackboard.wire.envelope import Kind
from blackboard.wire.messages import Report, Status
from robot_agent.inputs import MAX_AGREED
from tests.robot_agent.services import NOW, agreed, clock, kinds, new_service, readings
from tests.wire.envelopes import opened, world


def test_without_a_world_a_robot_reports_with_its_readings(caplog: pytest.LogCaptureFixture) -> None:
    """Real robots have no world: nobody publishes a Clock."""
    robot = new_service()
    with caplog.at_level(logging.INFO):
        for tick in range(20):
            answers = opened(robot.receive(readings(tick, time=NOW + 0.2 * tick), NOW + 0.2 * tick))
            assert [type(message) for message in answers] == [Report, Status]
            report, status = answers
            assert isinstance(report, Report)
            assert (report.tick, report.time, report.subject) == (tick, NOW + 0.2 * tick, "robot/r1")
            assert isinstance(status, Status)
            assert (status.tick, status.phase, status.subjects) == (tick, "reported", ["robot/r1"])
            assert status.settings["pace"] == "free"
    assert sum("no world gives the clock" in record.message for record in caplog.records) == 1


def test_without_a_world_it_takes_agreed_beliefs_whose_ticks_are_the_boards_own() -> None:
    robot = new_service(readings(0, time=NOW))
    robot.receive(agreed(5_000_000, time=NOW + 0.1), NOW + 0.1)
    (report, _) = opened(robot.receive(readings(1, time=NOW + 0.2), NOW + 0.2))
    assert isinstance(report, Report)
    assert report.informed is not None
    assert robot.refused == {}


def test_readings_that_come_again_are_not_counted_twice() -> None:
    robot = new_service(readings(3, time=NOW))
    assert robot.receive(readings(3, time=NOW), NOW + 0.1) == []
    assert robot.receive(readings(2, time=NOW), NOW + 0.1) == []
    assert robot.counters["ticks"] == 1


def test_in_lockstep_it_waits_for_the_clock_and_for_what_was_agreed() -> None:
    robot = new_service(world())
    assert robot.receive(readings(0), NOW) == []
    assert kinds(robot.receive(clock(0), NOW)) == ["Report", "Solo", "Status"]
    robot.receive(readings(1), NOW)
    assert robot.receive(clock(1, settled=["robot/r1", "object/ball"]), NOW) == []
    assert robot.receive(agreed(0), NOW) == []
    assert kinds(robot.receive(agreed(0, "object/ball"), NOW)) == ["Report", "Solo", "Status"]
    assert robot.counters["late"] == 0


def test_in_lockstep_its_patience_ends() -> None:
    robot = new_service(world(), readings(0), clock(0), readings(1), clock(1, settled=["robot/r1"]))
    patience = robot.settings.patience
    assert "Report" not in kinds(robot.wake(NOW + patience - 0.01))
    due = robot.wake_at(NOW + patience - 0.01)
    assert due is not None
    assert due <= NOW + patience
    assert "Report" in kinds(robot.wake(NOW + patience))
    assert robot.counters["late"] == 1


def test_a_robot_that_comes_in_the_middle_waits_for_nothing_that_was_agreed_before() -> None:
    robot = new_service(world(), readings(5))
    assert "Report" in kinds(robot.receive(clock(5, settled=["robot/r1", "object/ball"]), NOW))
    assert robot.receive(readings(6), NOW) == []
    assert robot.receive(clock(6, settled=["robot/r1"]), NOW) == []
    assert "Report" in kinds(robot.receive(agreed(5), NOW))
    assert robot.counters["late"] == 0


def test_its_patience_does_not_begin_anew_when_the_world_asks_again() -> None:
    robot = new_service(world(), readings(0), clock(0), readings(1), clock(1, settled=["robot/r1"]))
    patience = robot.settings.patience
    for envelope in (readings(1), clock(1)):
        robot.receive(envelope, NOW + patience / 2)
    assert "Report" in kinds(robot.wake(NOW + patience))


def test_the_world_that_asks_again_gets_the_same_answers_and_the_last_word_gets_none() -> None:
    robot = new_service(world(), readings(0))
    first = robot.receive(clock(0), NOW)
    again = robot.receive(clock(0), NOW + 1)
    assert opened(again)[:-1] == opened(first)[:-1]
    assert robot.counters["repeated"] == 1
    assert robot.receive(clock(0, end=True), NOW + 2) == []


def test_a_clock_of_nobody_stops_no_robot() -> None:
    """A Clock without a world's token is not followed for good."""
    robot = new_service(clock(7, run="forged"), readings(0, time=NOW))
    later = NOW + WORLD_SILENT + 0.1
    robot.wake(later)
    assert "Report" in kinds(robot.receive(readings(1, time=later), later))


def test_when_the_world_has_gone_it_goes_by_its_readings_again(caplog: pytest.LogCaptureFixture) -> None:
    robot = new_service(world(), readings(0), clock(0), world(Kind.GONE))
    assert robot.receive(readings(1), NOW + 0.1) == []  # it may come back
    later = NOW + WORLD_SILENT + 1.0
    assert "Report" in kinds(robot.wake(later))
    assert "Report" in kinds(robot.receive(readings(2), later + 0.1))
    assert "the world is gone" in caplog.text


def test_another_run_begins_anew() -> None:
    robot = new_service(world(), readings(0), clock(0), readings(1), clock(1))
    assert robot.tick == 1
    robot.receive(world(Kind.GONE), NOW)
    robot.receive(world(), NOW)
    assert robot.receive(readings(0, run="y"), NOW) == []  # the clock is still the old run's
    assert "Report" in kinds(robot.receive(clock(0, run="y"), NOW))
    assert (robot.run, robot.tick) == ("y", 0)


def test_agreed_beliefs_of_two_boards_do_not_hide_each_other() -> None:
    """The newest tick counts, then the first name, whatever the order of arrival."""
    reports = []
    for boards in (("one", "two"), ("two", "one")):
        robot = new_service()
        robot.receive(readings(0), NOW)
        for board in boards:
            robot.receive(agreed(0, board=board), NOW)
        reports.append(opened(robot.receive(readings(1), NOW))[0])
    assert reports[0] == reports[1]


def test_agreed_beliefs_are_bounded_in_number() -> None:
    robot = new_service()
    for i in range(MAX_AGREED + 5):
        robot.receive(agreed(0, f"object/o{i}"), NOW)
    robot.check()
    assert robot.refused == {"too-many": 5}


def test_what_was_agreed_before_a_world_came_does_not_stand_for_what_is_agreed_in_its_run() -> None:
    """Boards that go by Unix time count ticks in the thousands of millions, and readings may come before the first Clock."""
    robot = new_service(world(), readings(0), agreed(5_000_000, time=NOW), clock(0), readings(1))
    assert robot.receive(clock(1, settled=["robot/r1"]), NOW) == []
    assert kinds(robot.receive(agreed(0), NOW)) == ["Report", "Solo", "Status"]
    assert robot.counters["late"] == 0


def test_who_joins_a_run_takes_what_was_agreed_in_the_tick_before() -> None:
    robot = new_service(world(), clock(20, settled=["robot/r1"]), agreed(19))
    assert kinds(robot.receive(readings(20), NOW)) == ["Report", "Solo", "Status"]
    robot.receive(agreed(22), NOW)
    assert robot.refused == {"future": 1}
    assert robot.counters["late"] == 0
