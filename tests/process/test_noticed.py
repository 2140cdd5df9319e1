"""What the tables of rounds do not print, against what it should be."""

from __future__ import annotations

from blackboard.process.rounds import TABLES


def test_a_phase_counts_as_late_where_time_ends_what_an_answer_should_have_ended() -> None:
    late = {
        (name, pace.value, phase) for name, table in TABLES.items() for (pace, phase), row in table.items() if row.late
    }
    assert late == {
        ("board", "realtime", "reports"),
        ("board", "realtime", "exchange"),
        ("board", "lockstep", "reports"),
        ("board", "lockstep", "exchange"),
        ("robot", "lockstep", "agreed"),
        ("world", "lockstep", "tick"),
    }
