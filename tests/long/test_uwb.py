"""Four recorded robots with UWB ranges to each other and to one anchor: the joint against one filter that has everything."""

import re
from pathlib import Path

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.lab.team import played
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import forget_biases
from blackboard.opinion.gaussian.vehicle import Motion, correct, drive, entering
from blackboard.run.flags import RecordingFlags
from blackboard.wire.messages import Odometry
from robot_agent.config import RobotSection
from robot_agent.gaussian.absolute import starting_pose
from robot_agent.gaussian.sensors import sensors_of
from tests.field.play import Score
from tests.files import ROOT, page
from tests.robot_agent.spoilt import Spoil, recorded
from tests.sim_world.graphs import spoilt

#: The note's table, as recorded: seeds 1 to 4 and all together.
ROWS = re.search(r"\| as recorded \| one filter \| (.*) \|\n\| \| joint \| (.*) \|", page("notes/real-robots.md"))
UWB = ROOT.parent / "shared" / "uwb" / "tiers.pyfg"
pytestmark = pytest.mark.skipif(not UWB.is_file(), reason="needs the recording in ../shared/uwb/tiers.pyfg")


def one_filter(scenario: Scenario) -> Score:
    """An extended Kalman filter of all robots with all readings and the same models; it gates as the team does."""
    sensors, joint, score = sensors_of(scenario.section("robot", RobotSection)), Joint(), Score()
    last: dict[str, Odometry] = {}
    for tick in played(scenario):
        motions: dict[str, Motion] = {}
        for reading in tick.readings:
            subject = f"robot/{reading.robot}"
            if (pose := starting_pose(reading, sensors.compass)) is not None:
                joint.add(subject, entering(pose, sensors.wheels.nuisance))
            if reading.odometry is not None:
                motions[subject] = sensors.wheels.motion(reading.odometry, last.get(subject))
                last[subject] = reading.odometry
                drive(joint, subject, motions[subject], sensors.wheels.nuisance)
        forget_biases(joint, tick.dt)
        for reading in tick.readings:
            for sighting in reading.seen:
                place = None if sighting.landmark is None else np.array(sighting.landmark)
                factor = linearise(joint, sensors.relative(f"robot/{reading.robot}", sighting), motions, place)
                innovation = joint.innovation(factor)
                if innovation.squared <= quantile(GATE, innovation.freedom):
                    correct(joint, factor)
        for subject, true in tick.truth.positions.items() if tick.judged else ():
            moments = joint.moments(subject)
            score.add(moments.mean, moments.covariance, np.array(true))
    return score


@pytest.mark.parametrize("off", [False, True], ids=["as it is", "scale, bias and outliers added"])
def test_a_team_with_ranges_alone_is_as_good_as_one_filter_that_has_everything(off: bool, tmp_path: Path) -> None:
    """Starts known to 0.5 m and 0.1 rad, 40 s of each of three seeds."""
    results = []
    for seed in (1, 2, 3):
        file = UWB
        if off:
            file = tmp_path / f"spoilt{seed}.pyfg"
            spoilt(UWB, file, seed)
        scenario = RecordingFlags(pyfg=str(file)).scenario().changed("time", seconds=40.0).changed("world", seed=seed)
        team = recorded(scenario, Spoil(), after=0.0)
        results.append((team.rmse, team.coverage(), one_filter(scenario).rmse))
    team_rmse, covered, single = np.array(results).T
    assert np.sqrt(np.mean(team_rmse**2)) <= 1.3 * np.sqrt(np.mean(single**2))
    assert covered.mean() >= 0.9


def test_the_errors_that_the_pages_show_are_those_of_today() -> None:
    """Of the first seed."""
    assert ROWS is not None
    filters, joints = ([float(cell) for cell in row.split(" | ")] for row in ROWS.groups())
    scenario = RecordingFlags(pyfg=str(UWB)).scenario().changed("world", seed=1)
    assert recorded(scenario, Spoil(), after=0.0).rmse == pytest.approx(joints[0], rel=0.05)
    assert one_filter(scenario).rmse == pytest.approx(filters[0], rel=0.05)
    for *each, together in (filters, joints):
        assert together == pytest.approx(np.sqrt(np.mean(np.square(each))), abs=0.001)
    shown = f"The joint is {joints[-1]:.2f} m off in the mean of four starts, one filter that has all readings {filters[-1]:.2f} m"
    assert shown in " ".join(page("real-robots.md").split())
