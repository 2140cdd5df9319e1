"""Which opinions may be multiplied."""

from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion, split, union

BELIEF = uniform(Grid((2,)))
names = st.sampled_from("abcdef")


def said_by(source: str, others: set[str], time: float) -> Opinion:
    ancestors: dict[str, float] = {name: time for name in {source, *others}}  # noqa: C420
    return Opinion(source, BELIEF, ancestors)


opinions = st.lists(
    st.builds(
        lambda source, others, time: Opinion(source, BELIEF, dict.fromkeys({source, *others}, time)),
        names,
        st.sets(names, max_size=3),
        st.floats(0, 10),
    ),
    min_size=1,
    max_size=8,
)


@given(opinions)
def test_independent_opinions_share_no_ancestor_and_nothing_is_lost(said: list[Opinion]) -> None:
    independent, overlapping = split(said)
    ancestors = [name for opinion in independent for name in opinion.ancestors]
    assert len(ancestors) == len(set(ancestors))
    assert independent
    assert len(independent) + len(overlapping) == len(said)
    for opinion in overlapping:
        assert not set(ancestors).isdisjoint(opinion.ancestors)


@given(opinions)
def test_first_hand_opinions_come_first(said: list[Opinion]) -> None:
    alone = {o.source for o in said if len(o.ancestors) == 1}
    independent, _ = split(said)
    assert alone <= {o.source for o in independent if len(o.ancestors) == 1}


@given(opinions, st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_matter(said: list[Opinion], random: object) -> None:
    shuffled = list(said)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    key = lambda part: sorted((o.source, sorted(o.ancestors)) for o in part)  # noqa: E731
    assert [key(p) for p in split(said)] == [key(p) for p in split(shuffled)]


def test_union_keeps_the_latest_time_of_each_ancestor() -> None:
    first, second = Opinion("b", BELIEF, {"b": 1.0, "c": 5.0}), Opinion("a", BELIEF, {"a": 2.0, "c": 3.0})
    assert list(union([first.ancestors, second.ancestors]).items()) == [("a", 2.0), ("b", 1.0), ("c", 5.0)]
