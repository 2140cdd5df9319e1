"""Tracks of a whole team against a centralised JPDA that is given the same sightings, and where every robot truly is."""

import tomllib
from typing import Any

import pytest

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.judge.tracks import TrackAt, TrackJudge
from blackboard.lab.team import InProcessTeam, played
from tests.files import ROOT

pytest.importorskip("stonesoup", reason="no Stone Soup: pip install '.[jpda]'")
from tests.other.jpda import Central

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore")]

SEEDS = [171, 172]
SECONDS = 60.0


def people(seed: int) -> Scenario:
    """`blackboard up people` in a world of another seed."""
    table = tomllib.loads((ROOT / "sim_world" / "scenarios" / "people.toml").read_text())
    table["world"]["seed"], table["time"]["seconds"] = seed, SECONDS
    return Scenario(table)


def centralised(scenario: Scenario) -> dict[str, Any]:
    """What the scorecard would say of the tracks of a centralised JPDA."""
    world = scenario.section("world", WorldSection)
    tracker = Central(world.vision, 1.0 - world.detector.missed, world.detector.clutter, world.people.speed)
    judge = TrackJudge(world.check.track)
    for tick in played(scenario):
        tracker.hear(tick.truth, tick.readings)
        if tick.judged:
            things = {
                subject: place for subject, place in tick.truth.positions.items() if subject.startswith("person/")
            }
            judge.judge_instant(things, {track: TrackAt(place) for track, place in tracker.places().items()})
    return judge.summary()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_team_follows_people_about_as_well_as_one_computer_that_knows_where_all_robots_are(seed: int) -> None:
    team, central = InProcessTeam(people(seed)).run()["tracks"]["person"], centralised(people(seed))
    assert team["gospa"] <= 1.1 * central["gospa"]
    assert team["switches"] <= central["switches"]
    assert team["false"] <= central["false"]
