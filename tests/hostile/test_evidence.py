"""One robot of four lies in its evidence with any numbers that a message can hold: the honest ones keep their places in the joint."""

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from blackboard.errors import Refused
from blackboard.opinion.gaussian.contacts import Claim, Contacts
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import FARTHEST, Moments, squared_distance
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance
from blackboard.wire.evidence import PackedEvidence, PackedRelative
from blackboard.wire.gaussians import pack_evidence
from tests.board.joint.desks import MAKE, absurd, at, means, new_desk, wild
from tests.present import present

PLACES = {"r1": (10.0, 10.0), "r2": (15.0, 10.0), "r3": (20.0, 10.0)}
#: Of 1060 seeds those that ended a tick of the joint for everybody, made it begin anew, moved an honest robot, or had one left out.
FOUND = [21, 31, 54, 86, 100, 129, 133, 178, 211, 215, 237, 260, 293, 486, 1002, 1020]
ANEW = [26, 100, 146, 268]  # the same where each of the liar's ticks begins a new epoch


def honest(tick: int, name: str) -> PackedEvidence:
    """A robot that stands, and sees the others where they are."""
    x, y = PLACES[name]
    relatives = [
        PackedRelative(
            subject=f"robot/{other}",
            range=abs(place[0] - x),
            bearing=0.0 if place[0] > x else float(np.pi),
            range_variance=0.04,
            bearing_variance=0.0004,
        )
        for other, place in PLACES.items()
        if other != name
    ]
    said = at(x, y)
    sums = {"time": 0.2 * tick, "along": 0.01 * tick, "across": 0.0001 * tick}
    return said.model_copy(update={"relatives": relatives, "travelled": said.travelled.model_copy(update=sums)})


def lie(rng: np.random.Generator, tick: int) -> PackedEvidence:
    """Honest evidence with a few absurd numbers. ValueError: no message can hold them."""
    said: dict[str, Any] = honest(tick, "r2").model_dump()
    said["state"]["mean"] = (15.0, 14.0, *said["state"]["mean"][2:])
    said["epoch"] = int(rng.integers(3))
    for _ in range(int(rng.integers(1, 4))):
        _spoil(rng, said)
    return PackedEvidence.model_validate(said)


def _spoil(rng: np.random.Generator, said: dict[str, Any]) -> None:
    what, value = int(rng.integers(8)), float(wild(rng))
    size, relatives, nuisance = abs(value), said["relatives"], said["nuisance"]
    if what == 0:
        said["travelled"][str(rng.choice(["distance", "turn"]))] = value
    elif what == 1:
        said["travelled"][str(rng.choice(["time", "moving", "along", "across", "heading"]))] += size
    elif what == 2:
        at = int(rng.integers(6))
        nuisance["sigmas"] = (*nuisance["sigmas"][:at], size, *nuisance["sigmas"][at + 1 :])
    elif what == 3:
        at = int(rng.integers(3))
        memory = size * float(rng.choice([1, 1e-300]))
        nuisance["memory"] = (*nuisance["memory"][:at], memory, *nuisance["memory"][at + 1 :])
    elif what == 4:
        relative = relatives[int(rng.integers(len(relatives)))]
        field = str(rng.choice(["range", "range_variance", "bearing_variance", "age", "bearing"]))
        relative[field] = value if field == "bearing" else size
    elif what == 5:
        relative = relatives[int(rng.integers(len(relatives)))]
        relative["biases"] = [(size, float(rng.choice([5e-324, 1e-9, 1, 1e12])))]
        relative["group"] = str(rng.choice(["", "g"]))
    elif what == 6:
        if rng.random() < 0.3:
            said["state"]["mean"] = tuple(wild(rng, 9))
        said["state"]["covariance"] = tuple(np.array(said["state"]["covariance"]) * size)
    elif what == 7:
        said["profile"] = (
            [(0.0, size), (5.0, abs(float(wild(rng))))] if rng.random() < 0.5 else [(5.0, 0.0), (0.0, 0.0)]
        )
        if rng.random() < 0.5:
            root = wild(rng, 81).reshape(9, 9) * 1e-6
            information = tuple((root @ root.T)[np.triu_indices(9)])
            said["increment"] = {
                "reference": tuple(wild(rng, 9)),
                "information": information,
                "vector": tuple(wild(rng, 9)),
            }


@pytest.mark.parametrize(
    "seed",
    [*FOUND, *(pytest.param(seed, marks=pytest.mark.hostile) for seed in range(1000, 1060) if seed not in FOUND)],
)
def test_a_liar_s_numbers_cost_the_honest_robots_nothing_of_their_places(
    seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    lives_through(seed, caplog)


@pytest.mark.parametrize("seed", ANEW)
def test_nor_do_those_of_one_that_begins_anew_each_tick(seed: int, caplog: pytest.LogCaptureFixture) -> None:
    lives_through(seed, caplog, anew=True)


def lives_through(seed: int, caplog: pytest.LogCaptureFixture, *, anew: bool = False) -> None:
    rng, desk, liar = np.random.default_rng(seed), new_desk(), ("r0", "r9")[seed % 2]
    for tick in range(20):
        for name in PLACES:
            desk.take_evidence(name, tick, 0.2 * tick, honest(tick, name), own=True)
        if tick >= 3:
            with suppress(Refused, ValueError):
                said = absurd(rng) if rng.random() < 0.3 else lie(rng, tick)
                said = said.model_copy(update={"epoch": 10 * tick}) if anew else said
                desk.take_evidence(liar, tick, 0.2 * tick, said, own=True)
        places = means(desk.settle(0.2 * tick, MAKE))
        for name, place in PLACES.items():
            assert np.hypot(*np.subtract(places[f"robot/{name}"], place)) < 3.0
    assert desk.counters["joint_restarts"] == desk.counters["failed"] == 0
    assert not [name for name in PLACES if f"robot/{name} " in caplog.text]


@pytest.mark.parametrize("seed", range(12))
def test_a_liar_has_no_more_say_in_a_new_joint_by_what_it_returns_than_by_what_it_tells_first_hand(seed: int) -> None:
    moved = {name: farthest(np.random.default_rng(seed), name) for name in ("state", "returned")}
    assert moved["returned"] <= moved["state"] + 0.2


def farthest(rng: np.random.Generator, name: str) -> float:
    """How far a fourth robot moves an honest one that enters a joint with it, by a false place in its state or what it returns."""
    desk, false = new_desk(), present(at(*rng.uniform(0, 30, 2)).state)
    covariance = tuple((np.array(false.covariance) * 10.0 ** rng.uniform(-8, 0)).tolist())
    lie = {name: false.model_copy(update={"covariance": covariance})}
    for tick in range(20):
        for honest_name in PLACES:
            said = honest(tick, honest_name)
            desk.take_evidence(
                honest_name, tick, 0.2 * tick, said.model_copy(update={"returned": said.state}), own=True
            )
        desk.take_evidence("r0", tick, 0.2 * tick, honest(tick, "r2").model_copy(update=lie), own=True)
        places = means(desk.settle(0.2 * tick, MAKE))
    return max(float(np.hypot(*np.subtract(places[f"robot/{name}"], place))) for name, place in PLACES.items())


def test_a_robot_with_absurd_readings_says_what_a_message_can_hold_and_is_refused() -> None:
    far = Moments(np.full(9, 1e300), np.eye(9) * 1e13)
    increment = Increment(far.mean, far.covariance, far.mean)
    said = pack_evidence(Evidence("robot/r1", 0, 0, Motion(distance=-1e15, along=1e20), Nuisance(), far, increment))
    with pytest.raises(Refused, match="fields"):
        new_desk().take_evidence("r1", 0, 0.0, said, own=True)


def test_claims_without_any_error_and_huge_ones_are_compared_without_an_exception() -> None:
    nothing, huge = np.zeros((2, 2)), np.full((2, 2), 1e12)
    claims = [
        Claim(np.array([x, 0.0]), first, second)
        for x in (0.0, 1e12)
        for first in (nothing, huge)
        for second in (nothing, huge)
    ]
    contacts = Contacts()
    with np.errstate(all="raise"):
        for _ in range(3):
            contacts.judge({f"r{i}": claim for i, claim in enumerate(claims)})
    assert contacts.contradict("r0", "r4")
    assert squared_distance(np.zeros(2), nothing) == 0.0
    assert squared_distance(np.array([np.nan, 0.0]), np.eye(2)) == FARTHEST
