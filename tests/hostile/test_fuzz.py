"""A small part of `make fuzz`: changed messages of every type through the services of a team."""

import pytest

from tests.hostile.fuzz import run


@pytest.mark.parametrize("joint", [False, True], ids=["opinions", "joint"])
def test_whatever_arrives_no_service_meets_an_exception_and_the_run_ends(joint: bool) -> None:
    counted = run(1, 150, joint)
    assert counted["sent"] == 150
    assert counted["fields"] > 50
