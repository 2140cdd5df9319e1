"""Sub-teams that overlap: in the exchange each robot's evidence counts once, through one of its sub-teams.

What holds, for any cover of the robots by sub-teams, with the same reports:

- the first-hand part of the agreed belief is, to the bit, the agreed belief of the partition in which each robot is only in its home,
  the first by name of its sub-teams;
- the agreed belief is at least as sharp as that, because the sub-teams' whole beliefs are averaged in by the weight that minimises
  entropy; and where the rule multiplies all (independence 1, no gate that bites) it has the entropy of one board that hears everybody.
"""

from collections.abc import Mapping

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.belief import Belief
from blackboard.wire.messages import Consensus
from tests.board.reports import at, new_board, only, report

PRODUCT = {"independence": 1.0, "gate": 50.0}
OPINIONS = {
    "r1": at(18, 14, 4), "r2": at(19, 15, 3.5), "r3": at(18, 16, 3), "r4": at(20, 15, 5), "r5": at(19, 14, 4.5),
}  # fmt: skip
Cover = Mapping[str, tuple[str, ...]]  # sub-team -> its robots


def home(cover: Cover, robot: str) -> str:
    return min(sub_team for sub_team, robots in cover.items() if robot in robots)


def agreed(cover: Cover, opinions: Mapping[str, Belief] = OPINIONS, **rule: object) -> Consensus:
    """What the boards of a cover agree on, which is the same at each of them."""
    boards = {s: new_board(s, **rule) for s in cover}
    for sub_team, robots in cover.items():
        for robot in robots:
            boards[sub_team].hear(report(robot, opinions[robot]), 0.0)
    said = [
        consensus
        for sub_team, board in boards.items()
        for consensus in board.settle(0, 0.0, lambda robot, s=sub_team: home(cover, robot) == s)  # type: ignore[misc]
    ]
    agreed_on = []
    for board in boards.values():
        for consensus in said:
            board.hear_consensus(consensus, 0.0)
        agreed_on.append(only(board.exchange(0, 0.0)).model_copy(update={"board": "", "sub_team": ""}))
    assert all(other == agreed_on[0] for other in agreed_on)
    return agreed_on[0]


def partition(cover: Cover) -> Cover:
    """The same robots, each in its home alone."""
    kept = {s: tuple(robot for robot in robots if home(cover, robot) == s) for s, robots in cover.items()}
    return {sub_team: robots for sub_team, robots in kept.items() if robots}


def first_hand(consensus: Consensus) -> tuple[object, object]:
    part = consensus.firsthand
    return (consensus.belief, set(consensus.ancestors)) if part is None else (part.belief, set(part.ancestors))


def test_the_evidence_of_a_robot_beside_a_shared_one_is_not_lost() -> None:
    """Three robots, the second in both sub-teams: 3.679 nats without the third one's evidence, 3.366 with it, in the issue's case."""
    whole = agreed({"a": ("r1", "r2", "r3")}, **PRODUCT)
    cover = agreed({"a": ("r1", "r2"), "b": ("r2", "r3")}, **PRODUCT)
    without = agreed({"a": ("r1", "r2")}, **PRODUCT)
    assert without.entropy > whole.entropy + 0.2
    assert cover.entropy == pytest.approx(whole.entropy, abs=0.02)


def test_a_sub_team_with_no_robot_of_its_own_adds_nothing() -> None:
    cover = {"a": ("r1", "r2", "r4"), "b": ("r2", "r3"), "c": ("r3", "r1")}
    assert partition(cover).keys() == {"a", "b"}
    assert first_hand(agreed(cover)) == first_hand(agreed(partition(cover)))
    assert agreed(cover, **PRODUCT).entropy == pytest.approx(
        agreed({"a": ("r1", "r2", "r3", "r4")}, **PRODUCT).entropy, abs=0.02
    )


covers = st.dictionaries(
    st.sampled_from("abcd"),
    st.sets(st.sampled_from(sorted(OPINIONS)), min_size=1).map(lambda s: tuple(sorted(s))),
    min_size=1,
)


@settings(max_examples=25, deadline=None)
@given(covers, st.sampled_from([{}, PRODUCT, {"rule": "logarithmic"}]))
def test_any_cover_agrees_as_its_partition_does(cover: Cover, rule: dict[str, object]) -> None:
    overlapping, apart = agreed(cover, **rule), agreed(partition(cover), **rule)
    assert first_hand(overlapping)[1] == first_hand(apart)[1]
    if len(cover) > 1 and len(partition(cover)) > 1:
        assert first_hand(overlapping) == first_hand(apart)
    assert overlapping.entropy <= apart.entropy + 0.02
    if rule:
        everybody = {"a": tuple(sorted({robot for robots in cover.values() for robot in robots}))}
        assert overlapping.entropy == pytest.approx(agreed(everybody, **rule).entropy, abs=0.05)
