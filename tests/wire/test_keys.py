"""THE topic table: keys in, parts out, and nothing wild."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.wire import keys
from blackboard.wire.messages import MODELS

name = st.text("abcXYZ019_.-", min_size=1, max_size=64)
subject = st.builds("{}/{}".format, st.sampled_from(["robot", "object", "landmark"]), name)
parts = st.fixed_dictionaries(
    {
        "team": name,
        "sub_team": name,
        "source": name,
        "robot": name,
        "board": name,
        "process": name,
        "recorder": name,
        "subject": subject,
    }
)


@given(topic=st.sampled_from(keys.TOPICS), parts=parts)
def test_a_key_of_a_topic_is_found_again(topic: keys.Topic, parts: dict[str, str]) -> None:
    key = topic.key(**parts)
    parsed = keys.parse(key)
    assert parsed is not None
    assert parsed[0] is topic
    assert topic.key(**parsed[1]) == key
    assert all(parts[part] == value for part, value in parsed[1].items())


@given(topic=st.sampled_from(keys.TOPICS), parts=parts, part=st.integers(0, 9), wild=st.sampled_from("*?#$ /\n"))
def test_a_key_with_anything_wild_in_it_is_none(topic: keys.Topic, parts: dict[str, str], part: int, wild: str) -> None:
    key = topic.key(**parts)
    chunks = key.split("/")
    for bad in (wild, "**", "", chunks[part % len(chunks)] + wild):
        assert keys.parse("/".join([*chunks[: part % len(chunks)], bad, *chunks[part % len(chunks) + 1 :]])) is None


@given(key=st.text(max_size=60))
def test_any_text_is_parsed_or_none(key: str) -> None:
    parsed = keys.parse(key)
    assert parsed is None or parsed[0].key(**parsed[1]) == key


@pytest.mark.parametrize("topic", keys.TOPICS, ids=lambda topic: topic.name)
def test_every_topic_carries_a_token_or_a_message_that_there_is(topic: keys.Topic) -> None:
    assert topic.message == "token" or topic.message in MODELS


@pytest.mark.parametrize("topic", keys.TOPICS, ids=lambda topic: topic.name)
def test_every_topic_says_who_writes_whose_name_it_carries_and_how_often(topic: keys.Topic) -> None:
    assert topic.writers
    assert set(topic.writers) | set(topic.readers) <= set(get_args(keys.Role))
    assert topic.period in get_args(keys.Period)
    assert (topic.period == "while it runs") == (topic.message == "token")
    assert (topic.owner == "") == (topic.writers == ("world",))  # a team has one world
    assert not topic.owner or f"{{{topic.owner}}}" in topic.pattern


def test_no_robot_may_read_the_truth() -> None:
    assert "robot" not in keys.TRUTH.readers


@pytest.mark.parametrize(
    ("key", "token"),
    [
        ("cop/t/world/clock", "cop/t/world/alive"),
        ("cop/t/world/truth", "cop/t/world/alive"),
        ("cop/t/score/solo/r1", "cop/t/b/member/r1"),
        ("cop/t/a/report/r1/object/ball", "cop/t/a/member/r1"),
        ("cop/t/a/status/r1", "cop/t/a/member/r1"),
        ("cop/t/a/status/x", "cop/t/a/board/x"),
        ("cop/t/a/forward/x", "cop/t/a/board/x"),
        ("cop/t/a/consensus/object/ball", "cop/t/a/board/x"),
        ("cop/t/a/agreed/object/ball", "cop/t/a/board/x"),
    ],
)
def test_a_key_is_written_by_who_holds_the_token(key: str, token: str) -> None:
    assert keys.writer(key) in keys.identities(token)
    for other in ("cop/u/a/member/r1", "cop/t/c/board/x", "cop/t/a/member/r2", "cop/u/world/alive"):
        assert keys.writer(key) not in keys.identities(other)


def test_what_is_no_key_is_written_by_nobody() -> None:
    assert [keys.writer(key) for key in ("a", "cop/t/*/status/r1", "cop/t/a/status/" + "x" * 9999)] == [None] * 3
    assert keys.identities("cop/t/a/status/r1") == ()
