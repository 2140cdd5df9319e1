"""Four recorded robots with UWB ranges to each other and to one anchor: the joint against one filter that has everything."""

from pathlib import Path

import numpy as np
import pytest

from tests.files import ROOT
from tests.sim_world.graph_teams import joint_of_a_team, new_scenario, one_filter
from tests.sim_world.graphs import spoilt

UWB = ROOT.parent / "shared" / "uwb" / "tiers.pyfg"
pytestmark = pytest.mark.skipif(not UWB.is_file(), reason="needs the recording in ../shared/uwb/tiers.pyfg")


@pytest.mark.parametrize("off", [False, True], ids=["as it is", "scale, bias and outliers added"])
def test_a_team_with_ranges_alone_is_as_good_as_one_filter_that_has_everything(off: bool, tmp_path: Path) -> None:
    """Starts known to 0.5 m and 0.1 rad, 40 s of each of three seeds."""
    results = []
    for seed in (1, 2, 3):
        file = UWB
        if off:
            file = tmp_path / f"spoilt{seed}.pyfg"
            spoilt(UWB, file, seed)
        scenario = new_scenario(file, seed, 40.0)
        results.append((*joint_of_a_team(scenario), *one_filter(scenario)))
    team, covered, single, _ = np.array(results).T
    assert np.sqrt(np.mean(team**2)) <= 1.3 * np.sqrt(np.mean(single**2))
    assert covered.mean() >= 0.9
