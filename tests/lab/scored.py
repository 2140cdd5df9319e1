"""What `blackboard score` wrote of the recorded team: tests/golden/score.csv, the rows of the team.

    blackboard score --mrclam DIR --start 1248446200 --seconds 600 --protocol all --summary score.csv
    grep -E '^protocol|,team,' score.csv > tests/golden/score.csv

tests/lab/test_score_page.py holds the pages to it, tests/long/test_recorded.py runs some of it again.
"""

import csv

from tests.files import ROOT

Row = dict[str, str]


def scored() -> dict[tuple[str, str], Row]:
    """The numbers of the team by protocol and way."""
    with (ROOT / "tests" / "golden" / "score.csv").open(encoding="utf-8") as file:
        return {(row["protocol"], row["way"]): row for row in csv.DictReader(file)}
