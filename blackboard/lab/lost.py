"""Whole teams one robot of which is led astray, and the probability of being lost that their boards tell of each robot. Pure."""

import math
from collections.abc import Sequence
from typing import Any

from blackboard.config import Scenario
from blackboard.judge.forecasts import OUTSIDE, Forecasts
from blackboard.judge.samples import Sample
from blackboard.lab.team import InProcessTeam
from blackboard.lab.team_cases import variant
from blackboard.process.columns import cell, columns

BEGINS = 5.0  # seconds
#: What leads a robot astray, as [[fault]] tables; lengths are of a grid with 50 cells along its edge.
LEADS: dict[str, tuple[dict[str, Any], ...]] = {
    "nothing": (),
    "odometry creeps": ({"kind": "drift", "sensor": "odometry", "rate": 0.05},),
    "compass creeps": ({"kind": "drift", "sensor": "compass", "rate": 0.03},),
    "fixes creep": ({"kind": "drift", "sensor": "fix", "rate": 0.4},),
    "sensors freeze": ({"kind": "freeze", "what": "sensors"},),
    "it lies": ({"kind": "lie", "offset": [6.0, 4.0]},),
}


def jobs(teams: Sequence[Scenario], variants: int) -> list[tuple[str, Scenario]]:
    """What leads astray, and the scenario of a run: each team, variant and lead."""
    jobs = []
    for team in teams:
        robot, edge = team.team.robots[0], team.grid.cell * max(team.grid.shape) / 50
        for number in range(variants):
            for lead, tables in LEADS.items():
                faults = [{**_scaled(table, edge), "robot": robot, "start": BEGINS} for table in tables]
                jobs.append((lead, variant(Scenario({**team.tables, "fault": faults}, team.where), number)))
    return jobs


def judge(lead: str, scenario: Scenario) -> Forecasts:
    """The forecasts about all robots of a run."""
    forecasts = Forecasts()

    def take(sample: Sample) -> None:
        if not math.isnan(sample.lost):
            forecasts.add(sample.lost, sample.region > OUTSIDE)

    InProcessTeam(scenario, record=take).run()
    return forecasts


def report(leads: Sequence[str], parts: Sequence[Forecasts]) -> dict[str, Any]:
    """Each lead's runs together, and all of them."""
    by_lead = {
        lead: Forecasts.merged(part for name, part in zip(leads, parts, strict=True) if name == lead).summary()
        for lead in dict.fromkeys(leads)
    }
    return {"all": Forecasts.merged(parts).summary(), "leads": by_lead}


def text(table: dict[str, Any]) -> str:
    """A line for each lead, and the calibration of all."""
    rows = [("what leads a robot astray", "samples", "lost", "told", "AUROC", "Brier")]
    for name, forecast in {**table["leads"], "all": table["all"]}.items():
        if forecast:
            numbers = (forecast["share"], forecast["told"], forecast["auroc"], forecast["brier"])
            rows.append((name, str(forecast["n"]), *(cell(number, "{:.3f}") for number in numbers)))
    calibration = [("told from", "to", "samples", "told", "lost")]
    for one in table["all"].get("calibration", ()):
        calibration.append(
            (f"{one['from']:g}", f"{one['to']:g}", f"{one['n']}", f"{one['told']:.3f}", f"{one['share']:.3f}")
        )
    return "\n".join([*columns(rows, numbers=range(1, 6)), "", *columns(calibration, numbers=range(5))])


def _scaled(table: dict[str, Any], edge: float) -> dict[str, Any]:
    """A fault whose lengths are of a cell of a 50th of the grid's edge (unit)."""
    if table.get("sensor") == "fix":
        return {**table, "rate": table["rate"] * edge}
    return {**table, "offset": [edge * x for x in table["offset"]]} if "offset" in table else dict(table)
