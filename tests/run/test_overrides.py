"""`--set`: a key of a scenario and its values."""

from typing import Any

import pytest

from blackboard.config import load
from blackboard.run.overrides import parse_set, with_settings


@pytest.mark.parametrize(
    ("given", "key", "values"),
    [
        ("board.rule=cooperative,coalition", "board.rule", ["cooperative", "coalition"]),
        ("world.vision.gain=0.05, 0.1", "world.vision.gain", [0.05, 0.1]),
        ("grid.shape=[20, 20],[30, 30]", "grid.shape", [[20, 20], [30, 30]]),
        ('board.rule="a,b",c', "board.rule", ["a,b", "c"]),
        ("robot.vision.mates=true,false", "robot.vision.mates", [True, False]),
        (
            'board.subjects."object/ball"={rule="linear", k=1}',
            'board.subjects."object/ball"',
            [{"rule": "linear", "k": 1}],
        ),
    ],
)
def test_a_setting_has_values_as_in_toml_or_bare_words(given: str, key: str, values: list[Any]) -> None:
    assert parse_set(given) == (key, values)


def test_a_rule_is_set_before_its_parameters_and_without_those_of_the_old_one() -> None:
    scenario = with_settings(load("demo"), {"board.gamma": 0.4, "board.rule": "cooperative"})
    assert scenario.board.in_force() == {"rule": "cooperative", "k": 2.0, "gamma": 0.4}
