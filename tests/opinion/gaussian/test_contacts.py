"""Contacts: honest pairs agree, a liar contradicts whoever sees it, and one misread sighting changes nothing."""

import numpy as np
import pytest

from blackboard.opinion.gaussian.contacts import MISREAD, Contacts
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Nuisance, entering
from tests.opinion.gaussian.claims import PLACE, contradictions, corrected, own, seen_at


def test_honest_pairs_hardly_ever_contradict_each_other() -> None:
    assert np.mean([any(contradictions(lambda _: 0.0, seed, 12)) for seed in range(200)]) < 0.03


def test_a_liar_is_found_out_by_a_single_witness() -> None:
    runs = np.array([contradictions(lambda _: 8.0, seed, 12) for seed in range(200)])
    assert runs[:, 4].mean() > 0.7, "within the first five sightings"
    assert runs[:, -1].mean() > 0.97


def test_what_lasts_does_not_become_certain_by_being_repeated() -> None:
    """Two robots that stay off by 2.5 sigma together, and learn nothing, say the same a hundred times."""
    contacts = Contacts()
    for _ in range(100):
        contacts.judge({"one": own(np.array([2.5 * PLACE * 2**0.5, 0.0])), "other": seen_at(np.zeros(2))})
    assert not contacts.contradict("one", "other")


@pytest.mark.parametrize("claims", [1, MISREAD])
def test_misread_sightings_of_a_pair_that_agrees_change_nothing(claims: int) -> None:
    contacts = Contacts()
    for at in [0.0] * 5 + [30.0] * claims + [0.0] * 5:
        contacts.judge({"one": own(np.zeros(2)), "other": seen_at(np.array([at, 0.0]))})
        assert not contacts.contradict("one", "other")


def test_a_robot_that_begins_to_lie_is_found_out_and_both_are_named_once() -> None:
    contacts, parted = Contacts(), []
    for at in [0.0] * 20 + [12.0] * 10:
        parted.append(contacts.judge({"one": own(np.array([at, 0.0])), "other": seen_at(np.zeros(2))}))
    assert parted.count({"one", "other"}) == 1
    assert sum(map(len, parted)) == 2
    assert contacts.contradict("other", "one")


def test_a_pair_that_contradicts_from_the_first_has_spoilt_nothing() -> None:
    contacts = Contacts()
    assert contacts.judge({"one": own(np.array([30.0, 0.0])), "other": seen_at(np.zeros(2))}) == set()
    assert contacts.contradict("one", "other")


def test_a_robot_that_begins_anew_is_believed_again_once_it_agrees_for_long() -> None:
    """Else it would begin anew after each lie."""
    contacts = Contacts()
    apart = {"one": own(np.array([30.0, 0.0])), "other": seen_at(np.zeros(2)), "third": seen_at(np.zeros(2))}
    contacts.judge(apart)
    contacts.begin("one")
    assert contacts.contradict("one", "other")
    assert not contacts.contradict("other", "third")
    agreeing = apart | {"one": own(np.zeros(2))}
    for _ in range(10):
        contacts.begin("one")
        contacts.judge(agreeing)
    assert not contacts.contradict("one", "other")


def test_a_pair_is_judged_once_by_all_that_both_spoke_of_in_a_tick() -> None:
    """One robot's tick that contradicts in one thing and agrees in the next has parted nobody."""
    sigma, contacts = PLACE * 2**0.5, Contacts()
    before, far, near = (
        {"one": own(np.zeros(2)), "other": seen_at(np.array([at * sigma, 0.0]))} for at in (2.6, 4.6, 1.2)
    )
    contacts.judge(before)
    contacts.begin("one")
    contacts.begin("other")
    assert contacts.copy().judge(far) == {"one", "other"}
    assert contacts.judge(far, near) == set()


def contacts_of(contradicting: str, agreeing: str) -> Contacts:
    """Robots a to z, of which pairs such as "ab" contradict each other or agree."""
    contacts = Contacts()
    for pairs, apart in ((contradicting, 30.0), (agreeing, 0.0)):
        for pair in pairs.split():
            first, second = pair[0], pair[1]
            contacts.judge({first: own(np.zeros(2)), second: seen_at(np.array([apart, 0.0]))})
    return contacts


@pytest.mark.parametrize(
    ("contradicting", "agreeing", "doubted", "out"),
    [
        ("", "ab bc", "", ""),
        ("ax", "ab", "", "x"),  # one witness, whom another robot confirms
        ("ax", "", "", ""),  # one word against another
        ("ax bx", "", "", "x"),
        ("ax bx cx dx", "ab cd", "", "x"),
        ("ax ay bx by", "ab xy", "", ""),  # two camps
        ("ax bx ay by cy", "ab bc xy", "", "xy"),
        ("ax", "ab xy", "", ""),
        ("ax", "ab", "a", ""),  # the only witness is doubted
        ("ax", "ab", "x", "x"),
        ("ax bx", "ab", "a", "x"),
        ("ax", "", "ax", ""),
    ],
)
def test_who_is_contradicted_by_better_confirmed_robots_that_are_not_doubted_is_left_out(
    contradicting: str, agreeing: str, doubted: str, out: str
) -> None:
    assert contacts_of(contradicting, agreeing).left_out(doubted) == set(out)


@pytest.mark.parametrize(("since", "out"), [("", set()), ("ob", {"l"})], ids=["before", "since"])
def test_what_confirmed_a_robot_before_it_parted_from_another_one_says_nothing_of_which_has_changed(
    since: str, out: set[str]
) -> None:
    """A liar whom a mate had confirmed while it was honest was believed, and the only robot that saw it was left out for seconds."""
    contacts = Contacts()
    here, far = own(np.zeros(2)), own(np.array([30.0, 0.0]))
    for at in (here, here, far, far, far):
        contacts.pass_time(1.0)
        contacts.judge({"l": at, "o": seen_at(np.zeros(2))})
        if at is here:
            contacts.judge({"l": here, "a": seen_at(np.zeros(2))})
    if since:
        contacts.judge({"o": here, "b": seen_at(np.zeros(2))})
    assert contacts.contradict("l", "o")
    assert contacts.left_out() == out


def believed(sigma: float) -> Moments:
    return entering(Moments(np.zeros(3), np.diag([sigma**2, sigma**2, 0.01])), Nuisance())


@pytest.mark.parametrize("gain", [0.02, 0.3, 0.9])
def test_a_robot_whose_place_is_corrected_again_and_again_is_a_witness(gain: float) -> None:
    """Whatever its evidence is worth: the variance grows by as much as each correction takes away."""
    contacts = Contacts()
    information = np.zeros((STATES, STATES))
    information[AXES, AXES] = np.eye(2) * gain / PLACE**2
    for _ in range(200):
        contacts.correct("one", believed(PLACE), Increment(np.zeros(STATES), information, np.zeros(STATES)))
        assert not contacts.is_reckoned("one")


def test_a_robot_that_goes_by_its_odometry_is_none_until_it_is_corrected() -> None:
    contacts = Contacts()
    reckoned = []
    for sigma in (1.0, 1.5, 1.9, 2.1, 3.0):
        contacts.correct("one", believed(sigma), None)
        reckoned.append(contacts.is_reckoned("one"))
    assert reckoned == [False, False, False, True, True]
    corrected(contacts, "one", 0.1)
    assert not contacts.is_reckoned("one")
    assert not contacts.is_reckoned("nobody")


@pytest.mark.parametrize("reckons", ["one", "other"])
def test_an_earlier_contradiction_is_held_against_nobody_while_one_of_the_two_goes_by_its_odometry_alone(
    reckons: str,
) -> None:
    """Sightings by the other robot are what corrects dead reckoning, and dead reckoning is no evidence against the other robot."""
    contacts, there = Contacts(), own(np.zeros(2))
    contacts.judge({"one": own(np.array([30.0, 0.0])), "other": there, "third": there})
    assert contacts.left_out() == {"one"}
    assert contacts.contradict("one", "other")
    for sigma in (1.0, 3.0):
        contacts.correct(reckons, believed(sigma), None)
    assert not contacts.contradict("one", "other")
    assert contacts.contradict("one", "third") == (reckons == "other")
    assert contacts.left_out() == frozenset()
    corrected(contacts, reckons, 0.1)
    assert contacts.contradict("one", "other")
    assert contacts.left_out() == {"one"}


def test_a_copy_knows_who_goes_by_odometry_alone_and_changes_nothing_of_the_original() -> None:
    """A board goes back to a copy where somebody's numbers break a tick."""
    contacts = Contacts()
    corrected(contacts, "r1", 0.9)
    contacts.correct("r1", entering(Moments(np.zeros(3), 9 * np.eye(3)), Nuisance()), None)
    assert contacts.is_reckoned("r1")
    copy = contacts.copy()
    assert copy.is_reckoned("r1")
    copy.begin("r1")
    assert not copy.is_reckoned("r1")
    assert contacts.is_reckoned("r1")
