"""A short form of the table of network trouble, as a person gets it: real processes behind proxies, on 127.0.0.1."""

import json
from functools import partial
from pathlib import Path

from tests.processes import program, wait_until

SCENARIO = """
[team]
name = "storm"
[team.sub_teams]
a = ["r1", "r2"]
b = ["r3"]
[time]
tick = 0.2
"""


def test_two_sites_go_on_by_themselves_and_a_killed_robot_comes_back(tmp_path: Path) -> None:
    """Both cases at the same time, because most of their time is waiting. That all is settled again is the exit status."""
    scenario = tmp_path / "storm.toml"
    scenario.write_text(SCENARIO)
    command = ("-m", "blackboard", "chaos", str(scenario), "--json", "--only")
    with program(*command, "sites") as partition, program(*command, "kill-robot") as killing:
        cases = {"sites": partition, "kill-robot": killing}
        by_site = {}
        for name, case in cases.items():
            wait_until(
                partial(lambda case: case.running.poll() is not None, case), f"{name} is done", 100
            )  # it takes 25
            assert case.ends() == 0, case.err
            (by_site[name],) = json.loads(case.out)["rows"]
    assert {row["case"] for row in by_site.values()} == set(cases)
    assert all(row["recovery"] is not None and row["samples"] > 0 for row in by_site.values())
    # the partition was real, and of 2 x 3 robots each site had its own all the time: at least (2 + 1) / 6
    assert 0.5 < by_site["sites"]["settled"] < 0.99
