"""What `blackboard plan` says of any fleet, whatever was measured."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import UserError
from blackboard.run.plan import COSTS, LIMITS, MOST, SOURCES, Costs, Growth, Plan, bits, planned
from tests.commands import Ran
from tests.snippets import block, pages

GROWTHS = st.builds(Growth, st.floats(0.1, 1e3), st.floats(0.0, 10.0))
COST = st.builds(Costs, GROWTHS, GROWTHS, GROWTHS)
FLEETS = st.tuples(st.integers(1, 20_000), st.floats(0.1, 20.0), st.floats(1e4, 1e9), st.floats(1e4, 1e9), COST)


def needed(plan: Plan) -> tuple[int, int, int]:
    return plan.teams, plan.boards, len(plan.above)


def plan_of(robots: int, hertz: float, link: float, robot_link: float, costs: Costs) -> Plan | None:
    """None: not even one robot fits."""
    try:
        return planned(robots, hertz, link, robot_link, costs)
    except UserError:
        return None


@given(FLEETS)
def test_all_robots_have_a_place_and_nothing_is_used_beyond_what_is_planned_for(
    fleet: tuple[int, float, float, float, Costs],
) -> None:
    plan = plan_of(*fleet)
    if plan is not None:
        assert plan.teams * plan.robots >= fleet[0]
        assert plan.robots <= SOURCES
        assert all(share <= MOST for share in plan.used.values())
        assert (plan.binds is None) == (plan.teams == 1)


@given(FLEETS, st.integers(0, 20_000), st.floats(1.0, 4.0), st.floats(1.0, 4.0), st.floats(1.0, 4.0))
def test_more_robots_faster_robots_and_poorer_links_never_need_less(
    fleet: tuple[int, float, float, float, Costs], more: int, faster: float, poorer: float, weaker: float
) -> None:
    robots, hertz, link, robot_link, costs = fleet
    plan = plan_of(*fleet)
    harder = plan_of(robots + more, hertz * faster, link / poorer, robot_link / weaker, costs)
    if harder is not None:
        assert plan is not None
        assert all(least <= other for least, other in zip(needed(plan), needed(harder), strict=True))


@given(FLEETS)
def test_a_team_is_as_large_as_it_can_be(fleet: tuple[int, float, float, float, Costs]) -> None:
    robots, hertz, link, robot_link, costs = fleet
    plan = plan_of(*fleet)
    if plan is not None and plan.teams > 1:
        fewer = -(-robots // (plan.teams - 1))
        alone = plan_of(fewer, hertz, link, robot_link, costs)
        assert alone is None or alone.teams > 1


@pytest.mark.parametrize(
    ("text", "value"),
    [("20Mbit", 20e6), ("250kbit", 250e3), ("1Gbit", 1e9), ("9600bit", 9600.0), ("1.5 Mbit/s", 1.5e6)],
)
def test_links_are_read_with_their_unit(text: str, value: float) -> None:
    assert bits("--link", text) == value


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("0", "2", "20Mbit"), "--robots 0: give at least 1"),
        (("9", "0", "20Mbit"), "--hz 0: give reports a second, more than 0"),
        (("9", "nan", "20Mbit"), "--hz nan: give reports a second, more than 0"),
        (("9", "2", "20MB"), "--link 20MB: give bits a second as 250kbit, 20Mbit or 1Gbit"),
        (("9", "2", "0Mbit"), "--link 0Mbit: give bits a second as 250kbit, 20Mbit or 1Gbit"),
        (
            ("9", "2", "20Mbit", "--robot-link", "fast"),
            "--robot-link fast: give bits a second as 250kbit, 20Mbit or 1Gbit",
        ),
        (
            ("9", "2", "9bit"),
            "of a team's link, and 50 % is planned for; give fewer reports a second, or a larger link",
        ),
    ],
)
def test_a_mistake_is_one_line(words: tuple[str, ...], said: str) -> None:
    robots, hertz, link, *more = words
    ran = Ran("plan", "--robots", robots, "--hz", hertz, "--link", link, *more)
    assert ran.status == 2
    assert said in ran.err
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize("fusion", COSTS)
def test_the_command_says_what_binds(fusion: str) -> None:
    words = ("plan", "--robots", "300", "--hz", "2", "--link", "20Mbit", "--fusion", fusion)
    report = json.loads(Ran(*words, "--json").out)
    text = Ran(*words).out
    assert f"binds: {LIMITS[report['binds']]}" in text
    assert f"boards: {report['boards']}, shares: {2 * (report['boards'] - 1)}" in text


PAGE = "scaling.md"


def test_the_page_shows_what_is_printed() -> None:
    (command,) = block(PAGE, "blackboard plan").commands
    assert Ran(*command.split()[1:]).out == block(PAGE, "teams:").text


def test_the_page_s_table_is_what_is_planned() -> None:
    rows = re.findall(
        r"^\| (\d+) \| (\d+) \| (\w+) \| (\d+) \((\d+)\) \| (\d+) \((\d+)\) \| (\d+) \((\d+)\) \|",
        pages()[PAGE],
        re.MULTILINE,
    )
    assert rows
    for robots, hertz, link, *cells in rows:
        speed = bits("--link", link)
        both = [planned(int(robots), float(hertz), speed, speed, COSTS[fusion]) for fusion in ("opinions", "joint")]
        assert [int(cell) for cell in cells] == [
            n for pair in zip(*((plan.teams, plan.robots, plan.boards) for plan in both), strict=True) for n in pair
        ]
