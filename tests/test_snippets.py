"""Every block of code in the documentation is claimed: by a test that reads it from its page, or with the reason why none runs it."""

import ast
from dataclasses import dataclass
from functools import cache

import pytest

from tests.files import ROOT
from tests.snippets import Block, blocks, pages


@dataclass(frozen=True)
class NotRun:
    """Why no test runs a block. What its command lines begin with `blackboard` is parsed all the same (tests/test_docs.py)."""

    why: str


NEWCOMER = "tests/long/test_newcomer.py"
RECORDED = "tests/long/test_recorded.py"
MAINTAINER = "tests/long/test_maintainer.py"
CLIENT = "tests/system/test_client_page.py::test_every_line_of_the_page_does_what_it_says"
ROBOTS = "tests/system/test_client_page.py::test_every_line_of_the_page_does_what_it_says"
TAPE = "tests/view/test_tutorial.py::test_a_command_of_the_tutorial_does_what_it_says"
RESEARCH = "tests/long/test_research_page.py::test_every_command_of_the_page_does_what_it_says"
PLAN = "tests/run/test_plan.py::test_the_page_shows_what_is_printed"
PLUGINS = "tests/opinion/test_plugins.py::test_the_page_s_example_is_short_and_keeps_the_laws"
SETTINGS = "tests/test_page_settings.py"
WIRE = "tests/wire/test_docs.py::test_the_worked_example_is_true"
DRAWING = NotRun("a drawing of the code, or an example of what is printed")
SITE = NotRun("`make docs` runs it, with warnings as errors")
HOSTS = NotRun("several hosts; tests/flow and tests/access run the same services")
SYMPTOMS = NotRun("of a team in trouble; each command has tests of its own")
COMPOSE = NotRun("a Docker engine; tests/compose/test_compose.py runs the same services")
MINUTES_OF_LAB = NotRun("minutes; tests/long/test_lab.py and tests/system/test_lab.py run short forms of all four")
MINUTES = NotRun("many minutes; a short form is tested")

#: Page -> (how the first line of a block begins, who runs it), in the order of the page.
CLAIMS: dict[str, tuple[tuple[str, str | NotRun], ...]] = {
    "README.md": (
        ("make demo", f"{NEWCOMER}::test_make_demo_in_a_clone"),
        ("n     RMSE", f"{NEWCOMER}::test_make_demo_in_a_clone"),
        (".venv/bin/pip install -e '.[record,web,tui]'", f"{NEWCOMER}::test_what_it_believes_and_why"),
    ),
    "CONTRIBUTING.md": (
        (".venv/bin/python -m pytest", f"{MAINTAINER}::test_what_the_page_adds_passes_the_tests_that_it_names"),
        ("# blackboard/opinion/averages.py", f"{MAINTAINER}::test_the_new_rule_and_localizer_and_message_are_there"),
        ("blackboard scenario > ", f"{MAINTAINER}::test_what_the_page_adds_passes_the_tests_that_it_names"),
        ("# robot_agent/localizers.py", f"{MAINTAINER}::test_the_new_rule_and_localizer_and_message_are_there"),
        (".venv/bin/python -m pytest", f"{MAINTAINER}::test_what_the_page_adds_passes_the_tests_that_it_names"),
        ("# blackboard/wire/messages.py", f"{MAINTAINER}::test_the_new_rule_and_localizer_and_message_are_there"),
        ("# blackboard/wire/keys.py", f"{MAINTAINER}::test_the_new_rule_and_localizer_and_message_are_there"),
        ("python -m blackboard.run.messages", f"{MAINTAINER}::test_what_the_page_adds_passes_the_tests_that_it_names"),
        ("blackboard scenario > ", f"{MAINTAINER}::test_the_golden_tape_is_made_and_its_hash_told_as_the_page_says"),
    ),
    "api.md": ((".. automodule::", SITE), (".. autoclass::", SITE), *[(".. automodule::", SITE)] * 4),
    "calibrate.md": (
        ("blackboard calibrate", f"{RECORDED}::test_what_calibrate_finds_is_what_its_page_shows"),
        ("r1 ", f"{RECORDED}::test_what_calibrate_finds_is_what_its_page_shows"),
    ),
    "client.md": (
        ("blackboard router", CLIENT),
        *[("", CLIENT)] * 13,
    ),
    "design.md": tuple(("", DRAWING) for _ in range(2)),
    "faults.md": (
        ("[[fault]]", f"{SETTINGS}::test_a_fault_as_the_page_writes_it"),
        ("blackboard up liar", NotRun("two minutes; tests/flow/test_faults.py runs small teams with and without faults")),
        ("blackboard chaos --lies", NotRun("ten minutes; tests/hostile/test_lies.py tries lies on small teams")),
    ),
    "fleets.md": (
        ("site-a$  blackboard router", HOSTS),
        ("blackboard keys add", NotRun("several hosts; tests/access/test_sites.py runs two routers on one")),
        ("blackboard serve --team all", "tests/system/test_share.py::test_an_object_that_one_team_sees_is_known_in_the_others"),
    ),
    "hosts.md": (
        ("base$    blackboard router", f"{NEWCOMER}::test_each_process_by_hand"),
        ("r1$      python examples/feed_robot.py", "tests/system/test_real_robot.py::test_readings_reach_the_team_with_no_world_running"),
        ("docker compose up --build", COMPOSE),
        ("export WORLD=", COMPOSE),
    ),
    "looking.md": (
        ("blackboard status", NotRun("of a team that runs, most without an end; tests/view/test_door.py runs them on a bus")),
        ("blackboard health", NotRun("of a team that runs; tests/run/test_health_door.py and tests/access/test_door.py")),
    ),
    "network.md": (
        ("[robot.send]", f"{SETTINGS}::test_a_poor_link_as_the_page_sets_it"),
        ("blackboard chaos", NotRun("seven minutes; tests/long/test_chaos.py runs two cases")),
        ("make soak", NotRun("ten minutes; tests/chaos/test_verdict.py")),
    ),
    "nights.md": (
        ("make nights", NotRun("minutes; tests/nights lives through ten, and plants a bug")),
    ),
    "notes/lost-robots.md": (
        ("python -m tests.robot_agent.spoilt", NotRun("minutes, and a recording")),
    ),
    "notes/mutants.md": (("make mutants", MINUTES),),
    "paper.md": (("blackboard figures", MINUTES_OF_LAB), ("sum over q", DRAWING)),
    "real-robots.md": (
        ("blackboard score", NotRun("half an hour, and a recording; tests/lab/test_score_page.py, tests/long/test_recorded.py")),
        ("blackboard demo --pyfg", NotRun("a recording; tests/sim_world/test_pyfg.py replays a made one")),
    ),
    "notes/real-robots.md": (
        ("blackboard score", NotRun("half an hour, and a recording; tests/lab/test_score_page.py, tests/long/test_recorded.py")),
        ("blackboard demo --pyfg", NotRun("a recording; tests/sim_world/test_pyfg.py replays a made one")),
    ),
    "notes/far-off.md": (("python -m tests.field.grounds", NotRun("minutes; tests/field/test_grounds.py plays one")),),
    "notes/wrong-models.md": (
        ("python -m tests.robot_agent.spoilt", NotRun("minutes, and a recording")),
    ),
    "recording.md": (
        (".venv/bin/pip install", NotRun("tests/tape/test_door.py and tests/system/test_tape.py run the same commands on small tapes")),
    ),
    "research.md": (("blackboard demo", RESEARCH), ("import pandas", RESEARCH), ("blackboard sweep", RESEARCH)),
    "robots.md": (("[team]", ROBOTS), ("blackboard router", ROBOTS), *[("", ROBOTS)] * 4),
    "ros2.md": (
        (".venv/bin/pip install", NotRun("an installation; tests/other/test_ros.py needs what it installs")),
        ("blackboard demo", NotRun("a node of ROS 2; tests/other/test_ros.py runs both with one in Rust")),
        ("export RMW_IMPLEMENTATION", NotRun("a full ROS 2, which no machine of ours has")),
        ("blackboard serve", NotRun("a node of ROS 2; tests/bridges/ros/test_service.py has odometry and fixes come in")),
        ("blackboard ros", NotRun("a node of ROS 2; tests/bridges/ros/test_service.py has poses come in")),
        ("blackboard keys add", NotRun("two routers, one of them of ROS; tests/bridges/ros/test_keys.py runs a bridge with keys")),
    ),
    "rules.md": (
        ("[board]", f"{SETTINGS}::test_a_board_as_the_page_sets_it"),
        ("import numpy", PLUGINS),
        ("[project.entry-points", f"{SETTINGS}::test_entry_points_are_of_the_groups_that_are_looked_up"),
        ("@localizer", f"{SETTINGS}::test_a_localizer_as_the_page_registers_it"),
        ("[project.entry-points", f"{SETTINGS}::test_entry_points_are_of_the_groups_that_are_looked_up"),
        ("[board]", f"{SETTINGS}::test_a_board_as_the_page_sets_it"),
        ("from blackboard import Grid", f"{SETTINGS}::test_the_pools_alone"),
    ),
    "scaling.md": (("blackboard plan", PLAN), ("teams:", PLAN)),
    "fields.md": (
        ("blackboard demo", NotRun("tests/long/test_research_page.py and tests/tape/test_door.py run the same, shorter")),
    ),
    "security.md": (
        (".venv/bin/pip install", NotRun("an installation; tests/access/test_team.py runs the two commands on the demo")),
        ("base$    blackboard router", NotRun("several hosts; tests/access/test_door.py runs them on one")),
        ("keys/authority/", DRAWING),
        ("blackboard keys init", NotRun("a Docker engine; tests/compose/test_compose.py runs the same services")),
    ),
    "symptoms.md": tuple((first, SYMPTOMS) for first in (
        "blackboard health router", "blackboard status --scenario", "blackboard health board", "blackboard why robot/r3",
        "blackboard replay", "blackboard replay", "blackboard why robot/r3", "blackboard tune", "blackboard demo", "blackboard echo",
        "blackboard health robot", "blackboard status --watch", "blackboard tape recover", "blackboard health robot", "blackboard status",
    )),
    "tutorial.md": (
        ("make demo", f"{NEWCOMER}::test_the_tutorial_from_its_first_to_its_last_line"),
        *[(".venv/bin/blackboard status", TAPE)],
        (".venv/bin/blackboard view", f"{NEWCOMER}::test_the_tutorial_from_its_first_to_its_last_line"),
        (".venv/bin/blackboard why", TAPE),
        ("robot/r1 is believed to be at", f"{NEWCOMER}::test_the_tutorial_from_its_first_to_its_last_line"),
        (".venv/bin/blackboard why", TAPE),
        (".venv/bin/blackboard replay", TAPE),
        ("[team]", f"{NEWCOMER}::test_the_tutorial_from_its_first_to_its_last_line"),
        (".venv/bin/blackboard up", f"{NEWCOMER}::test_the_tutorial_from_its_first_to_its_last_line"),
        (".venv/bin/blackboard tape", TAPE),
    ),
    "bytes.md": (*[("", WIRE)] * 4, ("78 5e", "tests/wire/test_docs.py::test_the_worked_example_of_fine_levels_is_true")),
}  # fmt: skip


@pytest.mark.parametrize("page", pages())
def test_every_block_is_claimed_once_and_every_claim_is_of_a_block(page: str) -> None:
    claims, of_page = CLAIMS.get(page, ()), blocks(page)
    lines = [f"{page}:{each.line}: {each.first}" for each in of_page]
    assert len(claims) == len(of_page), lines
    for (start, _), each, line in zip(claims, of_page, lines, strict=True):
        assert each.first.lstrip().startswith(start), line


@cache
def functions(file: str) -> set[str]:
    """The names of the functions of a test file."""
    nodes = ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
    return {node.name for node in nodes if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(
    ("page", "claim"), sorted({(p, c) for p, cs in CLAIMS.items() for _, c in cs if isinstance(c, str)})
)
def test_who_claims_a_block_is_a_test_that_reads_the_page(page: str, claim: str) -> None:
    file, _, name = claim.partition("::")
    assert name in functions(file)
    assert page in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.parametrize("why", sorted({c.why for cs in CLAIMS.values() for _, c in cs if isinstance(c, NotRun)}))
def test_a_test_that_a_reason_names_is_there(why: str) -> None:
    for word in why.replace(";", " ").replace(",", " ").split():
        assert not word.startswith("tests/") or (ROOT / word).exists()


def test_a_shell_block_has_commands_only() -> None:
    """What the parser takes for a table or a drawing holds no command of ours at the beginning of a line."""
    ours = ("blackboard ", ".venv/", "make ", "robot-agent ", "sim-world ", "docker ")

    def hides(block: Block) -> bool:
        return block.language == "text" and any(line.startswith(ours) for line in block.text.splitlines())

    assert [(block.page, block.line) for page in pages() for block in blocks(page) if hides(block)] == []
