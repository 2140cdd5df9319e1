"""Disasters that are no PASS, with real services: a board that dies and stays away, and robots that all begin anew in the middle."""

from blackboard.lab.team import InProcessTeam
from robot_agent.team import robot_of
from tests.scenarios import SCENARIO

LONGER = SCENARIO.changed("time", seconds=12.0).changed("world", objects={}, check={"robots": 9.0, "solo": 1.5})


def test_a_board_that_dies_and_stays_away_is_a_fail_that_names_its_robots() -> None:
    team = InProcessTeam(LONGER)
    team.run_until(lambda: team.world.tick >= 7)
    team.leave(team.boards["b"])
    card = team.run()
    assert (card["verdict"], card["ticks"]) == ("FAIL", 24)
    assert [reason.split(" ")[0] for reason in card["reasons"]] == ["robot/r3:", "robot/r3:"]
    assert "of its samples are missing" in card["reasons"][0]
    assert card["reasons"][1].endswith("s to the end at 12 s")


def test_robots_that_all_lose_themselves_are_a_fail() -> None:
    calm = InProcessTeam(LONGER).run()
    assert calm["verdict"] == "PASS", calm["reasons"]
    team = InProcessTeam(LONGER)
    team.run_until(lambda: team.world.tick >= 7)
    for name, service in team.robots.items():
        team.leave(service)
        team.join(robot_of(LONGER, name))
    card = team.run()
    assert card["verdict"] == "FAIL"
    assert any(reason.startswith("robots: solo rmse") for reason in card["reasons"])
