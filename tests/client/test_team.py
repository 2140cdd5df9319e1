"""A program joins a real board through a real router: the client's own threads, its streams, asyncio, and what goes wrong."""

import asyncio
import math
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest

from blackboard import Belief, Grid
from blackboard.client import Agreed, Refused, Team, UserError
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Anchor
from blackboard.run.launch import free_port
from tests.client.boards import serving
from tests.processes import LONG, wait_until

pytestmark = pytest.mark.team

GRID = Grid((30, 20), 0.5, (-2.0, 0.0), "m", "map", Anchor(59.3, 18.1, 90.0))


def here(team: Team, x: float = 5.0) -> Belief:
    return Belief.from_gaussian(team.grid, (x, 4.0), np.eye(2))


def test_a_board_says_which_team_sub_team_and_grid_are_meant(endpoint: str) -> None:
    with serving(endpoint, GRID), Team("r1", endpoint=endpoint) as team:
        assert (team.name, team.sub_teams, team.grid, team.grid.anchor) == ("t", ("a",), GRID, GRID.anchor)
        team.report("robot/r1", here(team))
        agreed = team.newest("robot/r1", LONG)
        assert agreed.belief.mean() == pytest.approx((5, 4), abs=0.05)
        assert agreed.belief.grid.frame == "map"
        assert agreed.time <= team.time
        assert set(team.agreed) == {"robot/r1"}
        said = str(team.why("robot/r1"))
        assert "robot/r1: agreed by board-a in tick" in said
        assert "  r1: independent, weight 1.00" in said
        assert str(team.why("object/x")) == "object/x: no board has a belief about it"


def test_callbacks_and_streams_get_what_is_agreed_and_may_report(endpoint: str) -> None:
    heard: list[Agreed] = []
    with serving(endpoint, GRID), Team("r1", endpoint=endpoint) as team:

        @team.on_agreed
        def answer(agreed: Agreed) -> None:
            heard.append(agreed)
            team.report("object/ball", here(team, 8.0))  # in the team's own thread

        team.report("robot/r1", here(team))
        for agreed in team:
            if agreed.subject == "object/ball":
                break
        assert agreed.belief.mean()[0] == pytest.approx(8, abs=0.05)
        team.withdraw("robot/r1")
        assert heard[0].subject == "robot/r1"


def test_asyncio(endpoint: str) -> None:
    async def main() -> list[str]:
        async with Team("r1", endpoint=endpoint) as team:
            team.report("robot/r1", here(team))
            subjects = [(await asyncio.wait_for(team.next("robot/r1"), LONG)).subject]
            async for agreed in team:
                subjects.append(agreed.subject)
                if len(subjects) == 3:
                    await asyncio.to_thread(team.close)
        return subjects

    with serving(endpoint, GRID):
        assert set(asyncio.run(main())) == {"robot/r1"}


def test_a_robot_whose_reports_are_refused_learns_it(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    other = Grid((9, 9))
    with serving(endpoint, GRID), Team("r1", endpoint=endpoint, grid=other, strict=True) as team:
        team.report("object/ball", uniform(other))
        wait_until(lambda: team.refused, "the board says so")
        (refusal,) = team.refused
        assert (refusal.board, refusal.subject, refusal.reason) == ("board-a", "object/ball", "grid")
        assert "board-a refused the report about object/ball of r1 (grid" in str(team.why("object/ball"))
        with pytest.raises(Refused, match=r"^grid: board-a refused object/ball: a belief on \(9, 9\) cells"):
            team.report("object/ball", uniform(other))
        team.report("object/ball", uniform(other))  # raised once
    assert sum("board-a refused the report" in r.getMessage() for r in caplog.records) == 1


def test_what_is_wrong_is_refused_here_with_the_board_s_own_reason(endpoint: str) -> None:
    with serving(endpoint, GRID), Team("r1", endpoint=endpoint) as team:
        with pytest.raises(Refused, match="^grid: "):
            team.report("object/ball", uniform(Grid((9, 9))))
        assert team.refused == []


@pytest.mark.parametrize(
    ("argument", "value"),
    [("subject", 5), ("belief", None), ("belief", np.ones((40, 32))), ("time", "now"), ("time", math.nan)]
    + [("informed", 5), ("informed", (5, {})), ("informed", (uniform(GRID), None)), ("informed", (uniform(GRID),))],
)
def test_a_wrong_report_is_one_sentence_that_names_the_argument(argument: str, value: Any) -> None:
    said = {"subject": "object/ball", "belief": uniform(GRID), argument: value}
    with pytest.raises(ValueError, match=rf"^report\({argument}=.*\): give [^\n]*$"):
        Team("r1", "demo").report(**said)


def test_who_has_left_is_told_so_and_streams_end(endpoint: str) -> None:
    with serving(endpoint, GRID):
        team = Team("r1", endpoint=endpoint)
        with pytest.raises(RuntimeError, match="is known once the team is joined"):
            _ = team.grid
        with team:
            listened: list[Agreed] = []
            reader = threading.Thread(target=lambda: listened.extend(team))
            reader.start()
        team.close()
        reader.join(LONG)
        assert not reader.is_alive()
        with pytest.raises(RuntimeError, match="the team is closed"):
            team.report("robot/r1", here(team))
        with pytest.raises(TimeoutError, match="robot/r1"):
            team.newest("robot/r1", LONG)


ENDS = """
import sys
from blackboard.client import Robot
robot = Robot("r1", endpoint=sys.argv[1]).__enter__()
robot.fix((2.0, 3.0), 0.1, 0.0, 0.1)
robot.step()
robot.newest("robot/r1")
sys.exit(3)
"""


def test_a_program_that_ends_in_a_team_ends_as_it_says(endpoint: str) -> None:
    """Its interpreter ended the team's thread within Zenoh, and that aborted the process."""
    with serving(endpoint, GRID, fusion="joint"):
        words = [sys.executable, "-c", ENDS, endpoint]
        ended = subprocess.run(words, check=False, capture_output=True, text=True, timeout=LONG)
    assert (ended.returncode, ended.stderr) == (3, "")


def test_a_mistake_is_one_line(endpoint: str) -> None:
    with pytest.raises(UserError, match=r"^Team\(robot='r 1'\): use up to 64 letters"):
        Team("r 1")
    with pytest.raises(UserError, match=r"no such file|cannot be read"):
        Team("r1", "nowhere.toml")
    with pytest.raises(
        UserError, match="^r1: no Zenoh router answers at tcp/127.0.0.1.*name another endpoint with endpoint= "
    ):
        Team("r1", "demo", endpoint=f"tcp/127.0.0.1:{free_port()}", patience=0.1).__enter__()
    with pytest.raises(UserError, match="^r1: no board answers"):
        Team("r1", endpoint=endpoint, patience=0.1).__enter__()
    with serving(endpoint, GRID), serving(endpoint, GRID, "b"):
        wait_until(lambda: several(endpoint), "both boards answer")
        with pytest.raises(UserError, match="^r1: no board of .*/z answers; there are boards of .*/a, .*/b"):
            Team("r1", sub_team="z", endpoint=endpoint, patience=0.1).__enter__()


def several(endpoint: str) -> bool:
    try:
        with Team("r1", endpoint=endpoint):
            return False  # only one has answered yet
    except UserError as error:
        assert str(error) == "r1: there are t/a, t/b; say team=... and sub_team=..."
        return True


def test_names_that_no_board_has_are_logged_with_those_that_boards_have(
    endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    with serving(endpoint, GRID), Team("r1", team="x", sub_team="a", grid=GRID, endpoint=endpoint, patience=2.0):
        wait_until(lambda: "r1: no board of x/a answers; there are boards of t/a" in caplog.text, lambda: caplog.text)


def test_who_leaves_before_a_board_came_is_told_nothing(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    with Team("r1", team="x", sub_team="a", grid=GRID, endpoint=endpoint, patience=60.0):
        pass
    assert "no board" not in caplog.text
