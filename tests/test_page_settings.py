"""The settings and lines of Python in rules.md, network.md and faults.md: each is read as the programs read it."""

import tomllib
from typing import Any

import numpy as np
import pytest

from blackboard import plugins
from blackboard.config import Scenario
from blackboard.faults import faults_of
from robot_agent import localizers
from robot_agent.config import RobotSection
from tests.snippets import block, blocks


def tables(page: str, first: str) -> list[dict[str, Any]]:
    """The TOML blocks of a page that begin so."""
    return [
        tomllib.loads(block.text)
        for block in blocks(page)
        if block.language == "toml" and block.first.startswith(first)
    ]


def test_the_pools_alone() -> None:
    space: dict[str, Any] = {"opinions": np.random.default_rng(1).dirichlet(np.ones(108), 5).reshape(5, 12, 9)}
    exec(block("rules.md", "from blackboard import Grid").text, space)
    fused = space["fused"]
    assert fused.shape == (12, 9)
    assert fused.sum() == pytest.approx(1.0)


def test_a_board_as_the_page_sets_it() -> None:
    for table in tables("rules.md", "[board]"):
        board = Scenario(table).board
        assert board.fusion == table["board"].get("fusion", "opinions")
    rules, joint = (Scenario(table).board for table in tables("rules.md", "[board]"))
    assert (rules.rule, joint.objects_drift) == ("coalition", 0.5)


def test_a_poor_link_as_the_page_sets_it() -> None:
    (table,) = tables("network.md", "[robot.send]")
    send = Scenario(table).section("robot", RobotSection).send
    assert {name: getattr(send, name) for name in table["robot"]["send"]} == table["robot"]["send"]


def test_a_fault_as_the_page_writes_it() -> None:
    (table,) = tables("faults.md", "[[fault]]")
    (fault,) = faults_of(Scenario({"team": {"sub_teams": {"a": ["r1", "r3"]}}, **table}))
    assert fault.kind == table["fault"][0]["kind"] == "lie"


def test_entry_points_are_of_the_groups_that_are_looked_up() -> None:
    groups = [name for table in tables("rules.md", "[project") for name in table["project"]["entry-points"]]
    assert groups == [plugins.POOLS, plugins.LOCALIZERS]


def test_a_localizer_as_the_page_registers_it() -> None:
    exec(
        block("rules.md", '@localizer("mine")').text,
        {"localizer": localizers.localizer, "MyLocalizer": lambda *both: both},
    )
    assert localizers.localizer_factory("mine")("settings", "grid") == ("settings", "grid")
