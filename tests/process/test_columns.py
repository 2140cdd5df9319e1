"""Rows in columns: they stand under each other, and in a narrow place columns fall away in their order."""

from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.columns import LEAST_LAST, cell, columns, markdown_table

ROWS = [
    ("name", "kind", "tick", "said"),
    ("r1", "robot", "7", "all is well and this is long"),
    ("board-a", "board", "12", "-"),
]
WORDS = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=9)


def test_columns_stand_under_each_other() -> None:
    lines = columns(ROWS)
    assert [line.index(word) for line, word in zip(lines, ("kind", "robot", "board"), strict=True)] == [9] * 2 + [0]
    assert lines[2].index("12") == lines[0].index("tick")


def test_numbers_end_under_each_other() -> None:
    assert [line[:20].split()[-1] for line in columns(ROWS, numbers=(2,))] == ["tick", "7", "12"]


def test_a_table_of_markdown_has_a_rule_below_its_head() -> None:
    assert markdown_table([("a", "b"), ("c", cell(None, "{:.1f}"))]) == ["| a | b |", "|---|---|", "| c | - |"]


def test_columns_fall_away_in_their_order_and_the_last_is_cut() -> None:
    fall = ("tick", "kind")
    assert columns(ROWS, 80, fall)[1].split()[:3] == ["r1", "robot", "7"]
    narrow = columns(ROWS, 30, fall)
    assert narrow[0].split() == ["name", "kind", "said"]
    assert narrow[1].endswith("...")
    assert columns(ROWS, 9 + LEAST_LAST, fall)[0].split() == ["name", "said"]


@given(st.lists(st.tuples(WORDS, WORDS, WORDS), min_size=1, max_size=6), st.integers(4, 60))
def test_no_line_is_wider_than_its_place(rows: list[tuple[str, str, str]], width: int) -> None:
    lines = columns([("a", "b", "c"), *rows], width, ("b",))
    assert len(lines) == len(rows) + 1
    assert max(map(len, lines)) <= width
