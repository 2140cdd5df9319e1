"""Evidence as a message and back, and what of it is refused."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from blackboard.board.joint.evidence import unpack
from blackboard.errors import Refused
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Bias, Relative, measured
from blackboard.opinion.gaussian.vehicle import STATES, Motion, Nuisance
from blackboard.wire.codec import decode, encode
from blackboard.wire.evidence import Forward, PackedCamera, PackedIncrement, PackedPose, PackedState, Seen
from blackboard.wire.gaussians import (
    pack_evidence,
    pack_pose,
    pack_state,
    pose_of,
    unpack_increment,
    unpack_motion,
    unpack_nuisance,
    unpack_relatives,
    unpack_state,
)
from blackboard.wire.types import LARGEST
from tests.present import present
from tests.wire.messages import EVIDENCE, FORWARD, STATE, as_map


def told(*relatives: Relative) -> Evidence:
    return Evidence("robot/r1", 0, 0, Motion(), Nuisance(), relatives=relatives)


def test_evidence_is_read_back_as_it_was() -> None:
    (evidence,) = decode(Forward, encode(FORWARD)).evidence
    assert evidence.evidence == EVIDENCE
    assert pack_evidence(unpack("r1", 0, 0.0, EVIDENCE)) == EVIDENCE


def test_a_sighting_of_a_class_is_read_back_with_its_confidence_and_its_number() -> None:
    plain = Relative("robot/r1", "robot/?", 2.0, 0.0, 0.1, 0.1, confidence=0.75, mark=3)
    place = replace(measured("position", "robot/r1", "person/?", (1.0, 2.0), (0.1, 0.0, 0.1)), confidence=0.5, mark=0)
    packed = pack_evidence(told(plain, place))
    assert set(unpack_relatives(packed, "robot/r1")) == {plain, place}


def test_who_names_a_robot_cannot_say_that_it_did_not() -> None:
    named = Relative("robot/r1", "robot/r2", 2.0, 0.0, 0.1, 0.1, mark=3)
    (relative,) = unpack_relatives(pack_evidence(told(named)), "robot/r1")
    assert relative.mark is None


@pytest.mark.parametrize("subject", ["robot/?r", "landmark/?", "robot?", "robot/??", f"object/{'x' * 64}?"])
def test_what_is_no_class_is_refused(subject: str) -> None:
    with pytest.raises(ValidationError):
        Seen(subject=subject, kind="position", values=(1.0, 2.0), covariance=(0.1, 0.0, 0.1))


def test_beside_a_sighting_without_a_profile_the_others_have_the_variances_at_their_ranges() -> None:
    by_profile = Relative("robot/r1", "robot/r2", 2.0, 0.0, 9.0, 9.0, profile=((1.0, 0.5), (3.0, 0.3)))
    plain = Relative("robot/r1", "object/ball", 1.0, 0.0, 0.2, 0.1)
    packed = pack_evidence(told(by_profile, plain))
    first, second = unpack_relatives(packed, "robot/r1")
    assert (first.range_variance, first.bearing_variance) == pytest.approx((0.4, 0.1))
    assert (second.range_variance, second.bearing_variance, second.profile) == (0.2, 0.1, ())


def test_a_matrix_is_its_upper_triangle() -> None:
    matrix = np.add.outer(np.arange(9.0), np.arange(9.0)) + 50 * np.eye(9)
    state = unpack_state(PackedState(mean=tuple(STATE.mean), covariance=tuple(matrix[np.triu_indices(9)])))
    assert np.array_equal(state.covariance[:9, :9], matrix)
    assert not state.covariance[9:].any(), "a robot whose scales do not depend on the kind of motion"


def test_a_covariance_that_is_none_by_rounding_is_read_as_the_nearest_one() -> None:
    axis = np.eye(9)[0] * math.sqrt(0.5) + np.eye(9)[1] * math.sqrt(0.5)
    matrix = 1e6 * (np.eye(9) - (1.0 + 5e-10) * np.outer(axis, axis))  # -5e-4 along the axis
    state = unpack_state(PackedState(mean=(0.0,) * 9, covariance=tuple(matrix[np.triu_indices(9)])))
    assert np.linalg.eigvalsh(state.covariance).min() >= -1e-9
    assert np.allclose(state.covariance[:9, :9], matrix, atol=1e-3)
    assert np.array_equal(state.covariance, state.covariance.T)


def test_what_lasts_for_ever_is_sent_as_zero() -> None:
    packed = EVIDENCE.nuisance.model_copy(update={"memory": (0.0, 2.0, 0.0)})
    assert unpack_nuisance(packed).memory == (math.inf, 2.0, math.inf)


@pytest.mark.parametrize("entry", [(0, 0), (8, 8), (0, 1)])
def test_a_matrix_that_is_no_covariance_is_refused(entry: tuple[int, int]) -> None:
    matrix = np.eye(9)
    matrix[entry] = -1.0 if entry[0] == entry[1] else 2.0
    upper = tuple(matrix[np.triu_indices(9)])
    with pytest.raises(Refused, match=r"mass: state\.covariance has a negative eigenvalue"):
        unpack_state(PackedState(mean=(0.0,) * 9, covariance=upper))
    with pytest.raises(Refused, match=r"mass: increment\.information"):
        unpack_increment(PackedIncrement(reference=(0.0,) * 9, information=upper, vector=(0.0,) * 9))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 2 * LARGEST, -2 * LARGEST, "1", None])
@pytest.mark.parametrize("path", [("travelled", "distance"), ("state", "mean", 3), ("increment", "vector", 0)])
def test_a_number_that_is_none_or_too_large_is_refused(path: tuple[str | int, ...], value: object) -> None:
    import msgpack

    whole = as_map(FORWARD)
    place = whole["evidence"][0]["evidence"]
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(Refused, match="fields"):
        decode(Forward, msgpack.packb(whole))


@pytest.mark.parametrize(
    "error", [{"range_variance": 5e21}, {"bearing_variance": 1e13}, {"biases": (Bias(2e12, 5.0),)}]
)
def test_a_sighting_whose_error_no_message_holds_is_left_out(error: dict[str, Any]) -> None:
    sound = Relative("robot/r1", "object/ball", 2.0, 0.1, 0.01, 0.001)
    packed = pack_evidence(told(replace(sound, **error), sound))
    assert [relative.range_variance for relative in packed.relatives] == [0.01]


@pytest.mark.parametrize(
    ("kind", "values", "covariance", "why"),
    [
        ("range", (1.0, 2.0), (0.1,), "a range has 1 values, not 2"),
        ("range", (-1.0,), (0.1,), "not negative"),
        ("position", (1.0, 2.0), (), "the covariance of a position is 3 numbers"),
        ("position", (1.0, 2.0), (0.1, 0.2, 0.1), "must be positive definite"),
        ("bearing", (1.0,), (0.0,), "must be positive definite"),
        ("pose", (1.0, 2.0, 3.0), (0.1, 0.0, 0.0, -0.1, 0.0, 0.1), "must be positive definite"),
    ],
)
def test_a_sighting_of_a_kind_that_it_is_not_is_refused(
    kind: str, values: tuple[float, ...], covariance: tuple[float, ...], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        Seen(subject="robot/r2", kind=kind, values=values, covariance=covariance)


def test_a_sighting_of_an_unknown_kind_is_read_and_left_out() -> None:
    unknown = Seen(subject="robot/r2", kind="doppler", values=(1.0, 2.0), covariance=(0.1,))
    known = Seen(subject="robot/r3", kind="range", values=(1.0,), covariance=(0.1,))
    (relative,) = unpack_relatives(EVIDENCE.model_copy(update={"seen": [unknown, known], "relatives": []}), "robot/r1")
    assert (relative.subject, relative.kind) == ("robot/r3", "range")


def test_a_pose_is_read_from_a_state_that_is_sound() -> None:
    pose = present(pose_of(pack_state(STATE)))
    assert np.array_equal(pose.mean, [0.0, 1.0, 2.0])
    assert np.array_equal(pose.covariance, np.diag([1.0, 2.0, 3.0]))
    assert pose_of(None) is None
    assert pose_of(PackedState(mean=(0.0,) * 9, covariance=tuple((-np.eye(9))[np.triu_indices(9)]))) is None


def test_a_place_is_read_from_a_pose_that_is_sound() -> None:
    place = Moments(np.array([1.25, -2.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))
    pose = present(pose_of(pack_pose(place)))
    assert np.array_equal(pose.mean, place.mean)
    assert np.array_equal(pose.covariance, place.covariance)
    assert pose_of(PackedPose(mean=(0.0, 0.0), covariance=(1.0, 5.0, 1.0))) is None


def test_scales_by_kind_of_motion_travel_and_a_robot_without_them_sends_none() -> None:
    wide = Nuisance(sigmas=(0.1,) * 9, walks=(0.01,) * 6)
    block = Moments(np.arange(1.0, STATES + 1), np.diag(np.arange(1.0, STATES + 1)))
    motion = Motion(1.0, 0.2, 1.0, 1.0, 0.1, 0.1, 0.1, 0.5, 0.2, -0.3, 0.4)
    increment = Increment(block.mean, block.covariance, block.mean)
    packed = pack_evidence(Evidence("robot/r1", 0, 0, motion, wide, block, increment))
    assert unpack_motion(packed.travelled) == motion
    assert (unpack_nuisance(packed.nuisance).sigmas, unpack_nuisance(packed.nuisance).walks) == (
        wide.sigmas,
        wide.walks,
    )
    assert np.array_equal(unpack_state(present(packed.state)).covariance, block.covariance)
    assert np.array_equal(unpack_increment(present(packed.increment)).vector, block.mean)
    former = pack_evidence(Evidence("robot/r1", 0, 0, motion, Nuisance(), block))
    assert former.state is not None
    assert (len(former.state.mean), len(former.state.covariance), len(former.nuisance.sigmas)) == (9, 45, 6)
    assert unpack_nuisance(former.nuisance) == Nuisance()


def test_a_state_of_too_few_numbers_is_told_how_many_it_has() -> None:
    import msgpack

    whole = as_map(FORWARD)
    whole["evidence"][0]["evidence"]["state"]["mean"] = [1.0, 2.0, 0.0]
    with pytest.raises(Refused, match="give a list of 9 to 12, each a number"):
        decode(Forward, msgpack.packb(whole))


@pytest.mark.parametrize("sizes", [(9, 78), (12, 45), (10, 55), (11, 66)])
def test_rows_and_matrices_of_different_sizes_are_refused(sizes: tuple[int, int]) -> None:
    with pytest.raises(ValidationError, match="a state has 9 or 12 numbers"):
        PackedState(mean=(0.0,) * sizes[0], covariance=(0.0,) * sizes[1])


@pytest.mark.parametrize("factor", [(4.5, 0.1), (-4.5, 0.1), (0.0, -0.1), (float("nan"), 0.1), (0.0, float("inf"))])
def test_a_camera_that_is_more_than_sixteen_times_off_is_refused(factor: tuple[float, float]) -> None:
    camera = present(EVIDENCE.camera).model_dump()
    with pytest.raises(ValueError, match="bearing"):
        PackedCamera.model_validate(camera | {"bearing": factor})
