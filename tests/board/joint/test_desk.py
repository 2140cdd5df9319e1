"""The joint behind a board: each piece of evidence once, whoever passes it on, and a story for what it says."""

import math
import re

import numpy as np
import pytest
from pydantic import ValidationError

from blackboard.board.joint.queue import MAX_ROBOTS, MAX_WAITING
from blackboard.board.joint.room import MAX_OBJECTS
from blackboard.errors import Refused
from blackboard.opinion.gaussian.priors import found_in
from blackboard.opinion.gaussian.state import MAX_ERRORS
from blackboard.opinion.gaussian.vehicle import FORWARD, STATES
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import Forward, Forwarded, PackedVelocity, Seen
from blackboard.wire.gaussians import pack_evidence, pose_of, velocity_of
from robot_agent.config import RobotSection
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import sensors_of
from tests.board.joint.desks import MAKE, at, means, new_desk, settled, sighting
from tests.present import present
from tests.robot_agent.robots import readings

PLACED = Seen(subject="object/ball", kind="position", values=(5.0, 2.0), covariance=(0.04, 0.01, 0.04))


def test_robots_enter_by_their_states_and_objects_by_their_sightings() -> None:
    desk = new_desk()
    consensuses = settled(desk, 0, r1=at(10, 10, sees=sighting("object/ball", 5.0)), r2=at(20, 10))
    assert means(consensuses.values()) == {
        "object/ball": (15.0, 10.0),
        "robot/r1": (10.0, 10.0),
        "robot/r2": (20.0, 10.0),
    }
    ball, r1, _ = consensuses.values()
    assert [used.source for used in ball.used] == ["r1"]
    assert (ball.rule, ball.state, ball.conflict) == ("joint", None, False)
    assert r1.state is not None
    assert set(r1.ancestors) == {"r1", "r2"}


def test_an_object_is_agreed_on_finer_than_the_cells_of_its_belief() -> None:
    consensuses = settled(new_desk(), 0, r1=at(10, 10, sees=sighting("object/ball", 5.3)))
    pose = present(pose_of(consensuses["object/ball"].pose))
    assert pose.mean == pytest.approx((15.3, 10.0), abs=0.01)
    assert np.linalg.eigvalsh(pose.covariance)[0] > 0.0
    assert consensuses["robot/r1"].pose is None


def test_of_an_unnamed_sighting_a_consensus_says_whose_it_may_be() -> None:
    desk, unnamed_mate = new_desk(), sighting("robot/?", 10.0).model_copy(update={"mark": 4})
    for tick, sees in enumerate((None, unnamed_mate, unnamed_mate.model_copy(update={"range": 25.0}))):
        consensuses = settled(desk, tick, r1=at(10, 10, sees=sees), r2=at(20, 10))
        odds = [
            (share.source, share.time, share.mark, share.probability > 0.9) for share in consensuses["robot/r2"].unnamed
        ]
        assert odds == ([("r1", 0.2, 4, True)] if tick == 1 else [])
        assert consensuses["robot/r1"].unnamed == []
    assert desk.counters["unnamed_strange"] == 1
    assert desk.counters["unnamed_taken"] + desk.counters["unnamed_ambiguous"] == 1


def test_what_several_see_and_nobody_names_is_told_of_with_how_likely_it_is_there() -> None:
    desk = new_desk()
    settled(desk, 0, r1=at(5, 10), r2=at(10, 10))
    near, far = (sighting("person/?", away).model_copy(update={"mark": 0}) for away in (10.0, 15.0))
    for tick in (1, 2, 3):
        consensuses = settled(desk, tick, r1=at(5, 10, sees=far), r2=at(10, 10, sees=near))
    person = consensuses["person/1"]
    assert unpack(person.belief).mean() == pytest.approx((20.0, 10.0), abs=0.5)
    assert present(person.existence) > 0.99
    assert {used.source for used in person.used} == {"r1", "r2"}
    assert consensuses["robot/r1"].existence is None
    assert desk.counters["tracks_born"] == 1


def test_the_same_evidence_counts_once_whoever_passes_it_on() -> None:
    plain, echoed = new_desk(), new_desk()
    for tick in range(4):
        evidence = at(10, 10, travelled=float(tick), sees=sighting("object/ball", 5.0))
        plain.take_evidence("r1", tick, 0.2 * tick, evidence, own=True)
        for _ in range(3):
            echoed.take_evidence("r1", tick, 0.2 * tick, evidence, own=True)
        forward = Forward(board="b", sub_team="b", tick=tick, time=0.2 * tick, evidence=plain.forward(0.2 * tick))
        echoed.hear_forward(forward)
        assert echoed.others.has_heard(("b", "b"), tick)
        assert plain.settle(0.2 * tick, MAKE) == echoed.settle(0.2 * tick, MAKE)
    echoed.take_evidence("r1", 1, 0.8, at(3, 3), own=False)
    assert means(plain.settle(0.8, MAKE)) == means(echoed.settle(0.8, MAKE))


def test_what_arrives_late_is_settled_in_the_order_of_its_ticks() -> None:
    prompt, late = new_desk(), new_desk()
    for tick in range(3):
        evidence = at(10, 10, travelled=float(tick))
        in_time = settled(prompt, tick, r1=evidence)
        late.take_evidence("r1", tick, 0.2 * tick, evidence, own=True)
    assert means(settled(late, 2).values()) == means(in_time.values()) == {"robot/r1": (12.0, 10.0)}


def test_evidence_is_forwarded_once_and_only_that_of_the_own_robots() -> None:
    desk = new_desk()
    desk.take_evidence("r2", 0, 0.0, at(10, 10), own=True)
    desk.take_evidence("r1", 0, 0.0, at(10, 10), own=True)
    desk.take_evidence("r3", 0, 0.0, at(10, 10), own=False)
    assert [(passed.robot, passed.tick) for passed in desk.forward(0.0)] == [("r1", 0), ("r2", 0)]
    assert desk.forward(0.0) == []


def test_a_silent_robot_is_believed_less_and_then_not_published() -> None:
    desk = new_desk(max_age=3.0, drift=1.0)
    desk.take_evidence("r1", 0, 0.0, at(10, 10), own=True)
    widths = [float(np.trace(unpack(desk.settle(time, MAKE)[0].belief).covariance())) for time in (0.0, 1.0, 3.0)]
    assert np.diff(widths) == pytest.approx([2.0, 4.0], rel=0.05)
    assert desk.settle(3.1, MAKE) == []
    desk.take_evidence("r1", 9, 3.2, at(10, 10, travelled=1.0), own=True)
    assert means(desk.settle(3.2, MAKE)) == {"robot/r1": (11.0, 10.0)}


def test_a_robot_that_was_heard_lately_is_believed_to_have_gone_on_as_it_went() -> None:
    desk = new_desk(max_age=5.0, drift=1.0)

    def say(tick: int, time: float, way: float) -> None:
        evidence = at(10, 10, travelled=way)
        travelled = evidence.travelled.model_copy(update={"time": time})
        desk.take_evidence("r1", tick, time, evidence.model_copy(update={"travelled": travelled}), own=True)

    for tick in range(5):
        say(tick, 0.5 * tick, 1.0 * tick)
        desk.settle(0.5 * tick, MAKE)
    beliefs = [unpack(desk.settle(time, MAKE)[0].belief) for time in (2.0, 2.25, 2.5, 4.0)]
    assert [float(belief.mean()[0]) for belief in beliefs[:3]] == pytest.approx([14.0, 14.5, 15.0], abs=0.1)
    widths = [float(np.trace(belief.covariance())) for belief in beliefs]
    assert widths == sorted(widths)
    say(9, 4.1, 4.0)  # it had stopped after all
    assert means(desk.settle(4.1, MAKE)) == {"robot/r1": (14.0, 10.0)}


def test_who_contradicts_the_joint_is_named_with_the_reason() -> None:
    desk = new_desk()
    settled(desk, 0, r1=at(10, 10, sees=sighting("robot/r2", 5.0)), r2=at(15, 10))
    consensus = settled(desk, 1, r1=at(10, 10, sees=sighting("robot/r2", 15.0)), r2=at(15, 10))["robot/r2"]
    assert consensus.conflict
    (out,) = consensus.left_out
    assert out.source == "r1"
    reason = present(re.fullmatch(r"its sighting is (.*) sigmas from what the team believes \(limit 3.7\)", out.reason))
    assert float(reason[1]) > 3.7


def test_who_sees_an_object_at_two_places_is_told_as_two_camps() -> None:
    desk = new_desk()
    for tick in range(8):
        r1, r2 = (at(x, 10, sees=sighting("object/ball", 5.0)) for x in (10, 25))
        ball = settled(desk, tick, r1=r1, r2=r2)["object/ball"]
    assert ball.conflict
    assert sorted(camp.sources for camp in ball.camps) == [["r1"], ["r2"]]


def test_of_a_robot_whose_odometry_is_not_believed_and_whose_sensors_err_by_more_than_it_was_told_that_is_told() -> (
    None
):
    desk = new_desk()
    settled(desk, 0, r1=at(10, 10), r2=at(20, 10))
    desk.team.distrust.begin("robot/r1")
    desk.team.widened["robot/r1"] = (FORWARD,)
    told = {robot: of.parameters for robot, of in settled(desk, 1, r1=at(10, 10), r2=at(20, 10)).items()}
    assert [one.get("odometry distrusted") for one in told.values()] == [1.0, None]
    assert [found_in(one) for one in told.values()] == [{"way scale found": pytest.approx(1.0)}, {}]


def test_what_is_kept_is_bounded() -> None:
    desk = new_desk()
    for i in range(MAX_ROBOTS):
        desk.take_evidence(f"r{i}", 0, 0.0, at(10, 10), own=False)
    with pytest.raises(Refused, match="too-many"):
        desk.take_evidence("another", 0, 0.0, at(10, 10), own=False)
    for tick in range(1, MAX_WAITING + 5):
        desk.take_evidence("r1", tick, 0.0, at(10, 10), own=True)
    assert desk.counters["joint_dropped"] == 5  # to be settled
    assert len(desk.forward(0.0)) == MAX_WAITING + 4


def test_a_sighting_of_a_kind_that_is_not_known_is_left_out_and_counted() -> None:
    desk = new_desk()
    sightings = [Seen(subject="object/ball", kind="doppler", values=(1.0,)), PLACED]
    consensuses = settled(desk, 0, r1=at(10, 10).model_copy(update={"seen": sightings}))
    assert means(consensuses.values()) == {"robot/r1": (10.0, 10.0), "object/ball": (15.0, 12.0)}
    assert desk.counters["unknown_kinds"] == 1


def test_an_object_that_ranges_leave_in_two_places_is_agreed_to_be_in_one_of_them() -> None:
    desk = new_desk(objects_drift=0.1)
    ranged = Seen(subject="object/ball", kind="range", values=(10.0,), covariance=(0.01,))
    r1, r2 = (at(x, 15.0).model_copy(update={"seen": [ranged]}) for x in (8.0, 20.0))
    for tick in range(5):
        consensuses = settled(desk, tick, r1=r1, r2=r2)
    consensus = consensuses["object/ball"]
    ball = unpack(consensus.belief)
    assert ball.p[11:17, 20:26].sum() == pytest.approx(0.5, abs=0.1)
    assert ball.p[11:17, 4:10].sum() == pytest.approx(0.5, abs=0.1)
    assert consensus.parameters == {"places": 2.0}


def test_an_object_that_may_be_anywhere_by_now_is_said_to_be() -> None:
    """The joint said nothing of it, and opinions were agreed on instead: a ball was sure to be where it had been 12 s before."""
    desk, entropies = new_desk(objects_motion="roll"), []
    for tick in range(50):
        sees = sighting("object/ball", 5.0) if tick < 10 else None
        desk.take_evidence("r1", tick, tick, at(10, 10, sees=sees), own=True)
        entropies += [consensus.entropy for consensus in desk.settle(tick, MAKE) if consensus.subject == "object/ball"]
    assert len(entropies) == 50
    assert entropies[9:] == pytest.approx(sorted(entropies[9:]), abs=0.01)
    assert entropies[-1] == pytest.approx(math.log(desk.grid.size), abs=0.1)


def test_what_one_robot_may_put_into_the_joint_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = new_desk()
    monkeypatch.setattr("blackboard.board.joint.room.MAX_OBJECTS", 6)
    for tick in range(16):
        consensuses = settled(desk, tick, r1=at(10, 10, sees=sighting(f"object/o{tick}", 5.0)))
    assert len([subject for subject in consensuses if subject.startswith("object/")]) == 6
    assert desk.counters == {"joint_dropped": 10}


def test_what_a_greedy_robot_invents_leaves_room_for_what_others_see_and_its_newest_go_first() -> None:
    desk = new_desk()
    for tick in range(4):
        invented = [sighting(f"object/a{tick}-{i}", 2.0 + 0.1 * i) for i in range(64)]
        lies = at(10, 10).model_copy(update={"relatives": invented})
        others = {"r2": at(20, 10, sees=sighting("object/can", 5.0))} if tick == 3 else {}
        consensuses = settled(desk, tick, liar=lies, r1=at(20, 20, sees=sighting("object/ball", 5.0)), **others)
    assert {"object/ball", "object/can"} <= consensuses.keys()
    last = [subject for subject in settled(desk, 4, liar=lies, r1=at(20, 20)) if subject.startswith("object/a")]
    assert all(subject.startswith("object/a0-") for subject in last)


def test_an_object_that_nobody_has_seen_for_long_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = new_desk()
    monkeypatch.setattr("blackboard.board.joint.room.MAX_OBJECTS", 1)
    for tick, name in enumerate(["object/first", "object/second"]):
        time = tick * (desk.team.objects.kept + 1)
        desk.take_evidence("r1", tick, time, at(10, 10, sees=sighting(name, 5.0)), own=True)
        assert name in means(desk.settle(time, MAKE))


def test_invented_objects_with_new_lasting_errors_in_every_tick_do_not_make_the_joint_grow() -> None:
    desk = new_desk()
    sizes = []
    for tick in range(12):
        biases = [(0.1, 10.0**12), (0.1, 1.0), (0.2, 2.0), (0.2, 10.0**9)]
        invented = [
            sighting(f"object/o{i}", 2.0 + 0.1 * i).model_copy(update={"biases": biases, "group": f"{tick}-{i}"})
            for i in range(64)
        ]
        consensuses = settled(desk, tick, liar=at(10, 10).model_copy(update={"relatives": invented}), r1=at(20, 20))
        assert means(consensuses.values())["robot/r1"] == (20.0, 20.0)
        sizes.append(len(desk.team.joint.mean))
    assert max(sizes) <= 2 * STATES + 2 * MAX_OBJECTS + MAX_ERRORS
    assert desk.counters["joint_restarts"] == desk.counters["joint_left_out"] == 0


def test_numbers_that_would_break_the_joint_are_refused_and_the_others_are_taken() -> None:
    desk = new_desk()
    settled(desk, 0, r1=at(10, 10))
    wild = at(10, 10, travelled=1e12)
    moved = wild.travelled.model_copy(update={"turn": 1e12, "along": 1e12, "across": 1e12, "heading": 1e12})
    for broken in ({"travelled": moved, "state": None}, {"epoch": 400}):
        with pytest.raises(Refused, match="fields"):
            desk.take_evidence("r1", 1, 0.4, wild.model_copy(update=broken), own=True)
    desk.settle(0.2, MAKE)
    assert "robot/r2" in settled(desk, 2, r2=at(20, 20))


def test_a_robot_with_one_joint_of_its_own_agrees_with_its_filter() -> None:
    """With one robot, what the increments make of the joint is what its own filter believes (but for linearisation)."""
    own, desk = FirstHand("robot/r1", sensors_of(RobotSection())), new_desk()
    for tick in range(12):
        result = own.step(readings(tick, fix=(10, 10 + 0.1 * tick) if tick % 4 == 0 else None))
        desk.take_evidence("r1", tick, 0.5 * tick, pack_evidence(result), own=True)
        desk.settle(0.5 * tick, MAKE)
        assert own.belief is not None
        assert desk.team.pose("robot/r1").mean == pytest.approx(own.belief.mean, abs=1e-3)
        assert desk.team.pose("robot/r1").covariance == pytest.approx(own.belief.covariance, abs=2e-3)


def test_sums_that_shrink_and_epochs_to_come_are_refused() -> None:
    """A robot whose process was started again and that counts from the same epoch would have gone backwards in time."""
    desk = new_desk()
    desk.take_evidence("r1", 0, 0.0, at(10, 10), own=True)
    shrunk = at(10, 10).travelled.model_copy(update={"along": 0.001})
    with pytest.raises(Refused, match="backwards"):
        desk.take_evidence("r1", 1, 0.2, at(10, 10).model_copy(update={"travelled": shrunk}), own=True)
    with pytest.raises(Refused, match="future"):
        desk.take_evidence("r1", 1, 0.2, at(10, 10).model_copy(update={"epoch": 1 << 40}), own=True)
    began_anew = at(12, 10).model_copy(update={"travelled": shrunk, "epoch": 200})
    assert means(settled(desk, 1, r1=began_anew).values()) == {"robot/r1": (12.0, 10.0)}


def test_odometry_that_is_not_summed_is_refused_and_the_cure_is_named() -> None:
    """A robot of somebody else that tells each tick's odometry would stand still in the joint, and nobody would say why."""
    desk, packed = new_desk(), at(10, 10)
    step = packed.travelled.model_copy(update={"distance": 0.2, "time": 0.2})
    desk.take_evidence("r1", 0, 0.0, packed.model_copy(update={"travelled": step}), own=True)
    again = step.model_copy(update={"distance": 0.21})
    with pytest.raises(Refused, match="backwards: .* summed since the epoch began"):
        desk.take_evidence("r1", 1, 0.2, packed.model_copy(update={"travelled": again}), own=True)
    summed = step.model_copy(update={"distance": 0.41, "time": 0.4})
    desk.take_evidence("r1", 1, 0.2, packed.model_copy(update={"travelled": summed}), own=True)


@pytest.mark.parametrize("place", ["state", "nuisance"])
def test_a_scale_of_0_is_refused_and_the_cure_is_named(place: str) -> None:
    """Who has no error of its wheels has scales of 1. With 0 its robot would never move in the joint."""
    packed = at(10, 10)
    assert packed.state is not None
    mean = (*packed.state.mean[:3], 0.0, *packed.state.mean[4:])
    none = {
        "state": packed.state.model_copy(update={"mean": mean}),
        "nuisance": packed.nuisance.model_copy(update={"turn": 0.0}),
    }
    with pytest.raises(Refused, match=f"fields: .*{place}.* scale .* 1 is a scale without an error"):
        new_desk().take_evidence("r1", 0, 0.0, packed.model_copy(update={place: none[place]}), own=True)


@pytest.mark.parametrize("profile", [[(3.0, 0.1), (1.0, 0.2)], [(0.25, 7.0), (0.25, 8.0)]])
def test_a_profile_whose_distances_do_not_grow_is_refused_and_the_cure_is_named(
    profile: list[tuple[float, float]],
) -> None:
    packed = at(10, 10, sees=sighting("object/ball", 5.0)).model_copy(update={"profile": profile})
    with pytest.raises(Refused, match="fields: .*profile: give .*distance, variance.*"):
        new_desk().take_evidence("r1", 0, 0.0, packed, own=True)


def test_a_robot_whose_clock_was_set_back_counts_again_and_what_it_said_before_counts_once() -> None:
    """Epochs are numbered by the robot's own clock, which was 3 s ahead; the times are those of the board's."""
    desk = new_desk()
    ahead, right = (at(x, 10).model_copy(update={"epoch": epoch}) for x, epoch in ((10, 3000), (20, 500)))
    desk.take_evidence("r1", 0, 0.0, ahead, own=True, skew=30.0)
    desk.settle(0.0, MAKE)
    for tick, time in enumerate((0.5, 1.0)):
        desk.take_evidence("r1", tick, time, right, own=True)
        assert means(desk.settle(time, MAKE)) == {"robot/r1": (20.0, 10.0)}
    desk.take_evidence("r1", 0, 1.5, ahead, own=True, skew=30.0)
    desk.take_evidence("r1", 2, 0.9, right.model_copy(update={"epoch": 400}), own=True)
    assert means(desk.settle(1.5, MAKE)) == {"robot/r1": (20.0, 10.0)}
    assert [(passed.tick, passed.evidence.epoch) for passed in desk.forward(1.5)] == [(0, 3000), (0, 500), (1, 500)]


def test_a_robot_that_goes_back_to_an_epoch_it_left_is_not_heard() -> None:
    """Each change of the epoch lets a robot enter anew, so that one that alternates would be corrected by nobody."""
    desk = new_desk()
    first, second = (at(x, 10).model_copy(update={"epoch": epoch}) for x, epoch in ((10, 0), (20, 200)))
    for tick, said in enumerate((first, second, first, first)):
        consensuses = settled(desk, tick, r1=said)
    assert means(consensuses.values()) == {"robot/r1": (20.0, 10.0)}
    assert [passed.tick for passed in desk.forward(0.6)] == [0, 1]


def test_one_refused_robot_does_not_cost_the_others_of_a_forward() -> None:
    desk = new_desk()
    bad = Forwarded(robot="r1", tick=0, evidence=at(5, 5).model_copy(update={"epoch": 1 << 40}))
    good = Forwarded(robot="r2", tick=0, evidence=at(20, 10))
    with pytest.raises(Refused, match="future"):
        desk.hear_forward(Forward(board="board-b", sub_team="b", tick=0, time=0.0, evidence=[bad, good]))
    assert means(settled(desk, 0).values()) == {"robot/r2": (20.0, 10.0)}


def test_another_board_knows_when_the_evidence_that_is_passed_on_was_gathered() -> None:
    first, second = new_desk(), new_desk()
    first.take_evidence("r1", 0, 100.3, at(10, 10), own=True)
    (forwarded,) = first.forward(100.5)
    assert forwarded.age == pytest.approx(0.2)
    second.hear_forward(Forward(board="b", sub_team="b", tick=0, time=100.5, evidence=[forwarded]))
    (consensus,) = second.settle(100.6, MAKE)
    assert consensus.ancestors == {"r1": pytest.approx(100.3)}


def test_what_is_agreed_about_a_robot_has_its_velocity_while_it_is_heard() -> None:
    desk = new_desk()
    for tick in range(3):
        evidence = at(10, 10)
        moved = evidence.travelled.model_copy(update={"distance": 0.4 * tick, "time": 0.2 * tick, "turn": 0.02 * tick})
        (consensus,) = settled(desk, tick, r1=evidence.model_copy(update={"travelled": moved})).values()
    velocity = present(velocity_of(consensus.velocity))
    assert velocity.mean == pytest.approx([2.0 * math.cos(0.04), 2.0 * math.sin(0.04), 0.1])
    # along: the error of the way, 0.1 in 0.2 s at first and nothing since; across: 2 per second at a heading known to 0.05 rad
    assert velocity.covariance[1, 1] == pytest.approx((2.0 * 0.05) ** 2, rel=0.1)
    (silent,) = desk.settle(2.0, MAKE)
    assert silent.velocity is None


def test_a_velocity_that_is_none_is_refused_or_left_out() -> None:
    with pytest.raises(ValidationError, match="upper triangle"):
        PackedVelocity(mean=(1.0, 0.0), covariance=(1.0, 0.0, 1.0, 0.0, 0.0, 1.0))
    assert velocity_of(PackedVelocity(mean=(1.0, 0.0), covariance=(1.0, 5.0, 1.0))) is None
    assert velocity_of(None) is None


def test_a_robot_that_the_others_see_elsewhere_is_told_to_be_lost_rather_than_they() -> None:
    desk = new_desk()
    places, seen_at = {"r1": (10, 10), "r2": (20, 10), "r3": (10, 20)}, np.array([15, 14])
    for tick in range(8):
        for robot, place in places.items():
            x, y = seen_at - place
            there = sighting("robot/r2", math.hypot(x, y)).model_copy(update={"bearing": math.atan2(y, x)})
            desk.take_evidence(robot, tick, float(tick), at(*place, sees=None if robot == "r2" else there), own=True)
        desk.settle(float(tick), MAKE)
    lost = [desk.lost(f"robot/{robot}") or 0.0 for robot in places]
    assert lost[1] > 0.2 > max(lost[0], lost[2])
    assert desk.lost("object/ball") is None


@pytest.mark.parametrize("name", ["state", "returned"])
def test_what_a_robot_tells_or_returns_of_itself_is_bounded(name: str) -> None:
    told = present(at(10, 10).state)
    for wrong, reason in (
        ({"mean": (1e9, *told.mean[1:])}, "fields"),
        ({"mean": (*told.mean[:3], 0.0, *told.mean[4:])}, "fields"),
        ({"covariance": (-1.0, *told.covariance[1:])}, "mass"),
    ):
        evidence = at(10, 10).model_copy(update={name: told.model_copy(update=wrong)})
        with pytest.raises(Refused, match=f"^{reason}:"):
            new_desk().take_evidence("r1", 0, 0.0, evidence, own=True)
