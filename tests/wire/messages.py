"""One message of each model with every field said, and the key it belongs on."""

from typing import Any

import msgpack
import numpy as np

from blackboard.opinion.belief import gaussian
from blackboard.opinion.gaussian.cameras import CameraFound
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.mounts import CompassReading
from blackboard.opinion.gaussian.relation import Bias, Relative, measured
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.evidence import Forward, Forwarded, PackedPose, PackedTrack, Seen
from blackboard.wire.gaussians import pack_evidence
from blackboard.wire.memory import Memory, PackedLearner, PackedMemory, PackedNewest, PackedStanding
from blackboard.wire.messages import (
    Clock,
    Consensus,
    Disk,
    Fix,
    Informed,
    Journal,
    LeftOut,
    Odometry,
    Readings,
    Refusal,
    Report,
    Sighting,
    Solo,
    Status,
    Truth,
    UnnamedBelief,
    UnnamedSighting,
    Used,
)
from blackboard.wire.types import Message

BELIEF = pack(gaussian(Grid((9, 7), 0.5, (1.0, -2.0), "m"), (3.0, 0.0), 0.2))
INFORMED = Informed(belief=BELIEF, ancestors={"r1": 1.0, "r2": 0.5})
CLOCK = Clock(
    run="x1", tick=3, time=0.6, mode="lockstep", robots={"a": ["r1"]}, settled={"a": ["object/ball"]}, end=True
)
READINGS = Readings(
    run="x1",
    robot="r1",
    tick=3,
    time=0.6,
    odometry=Odometry(distance=0.1, turn=-0.2, dt=0.2),
    compass=1.5,
    fix=Fix(position=(1.0, 2.0), sigma=0.3, heading=0.1, heading_sigma=0.2),
    sightings=[Sighting(subject="landmark/l7", range=2.0, bearing=0.5, landmark=(4.0, 5.0), age=0.05)],
    seen=[Seen(subject="landmark/l8", kind="range", values=(2.0,), covariance=(0.01,), landmark=(4.0, 5.0), age=0.05)],
)
TRUTH = Truth(run="x1", tick=3, time=0.6, positions={"robot/r1": (1.0, 2.0)})
SOLO = Solo(robot="r1", tick=3, time=0.6, beliefs={"robot/r1": BELIEF})
REPORT = Report(
    source="r1",
    subject="object/ball",
    tick=3,
    time=0.6,
    belief=BELIEF,
    ancestors={"r1": 0.6},
    informed=INFORMED,
    unnamed=[UnnamedBelief(kind="person/?", belief=BELIEF, mark=1, confidence=0.9)],
)
CONSENSUS = Consensus(
    board="a1",
    sub_team="a",
    level="consensus",
    subject="object/ball",
    tick=3,
    time=0.6,
    belief=BELIEF,
    ancestors={"r1": 0.6},
    firsthand=INFORMED,
    used=[Used(source="r1", weight=1.0, age=0.2, entropy=2.5, how="independent")],
    left_out=[LeftOut(source="r9", reason="silent for 10.2 s")],
    components=[1.0],
    entropy=2.5,
    conflict=True,
    rule="cooperative",
    parameters={"k": 2.0},
    pose=PackedPose(mean=(4.25, 3.5), covariance=(0.04, 0.01, 0.02)),
    unnamed=[UnnamedSighting(source="r1", time=0.6, mark=2, probability=0.995, taken=True)],
)
AGREED = CONSENSUS.model_copy(update={"level": "agreed"})
STATE = Moments(np.arange(9.0), np.diag(np.arange(1.0, 10.0)))
EVIDENCE = pack_evidence(
    Evidence(
        "robot/r1",
        2,
        0,
        Motion(1.0, 0.5, 0.2, 0.2, 0.01, 0.001, 0.002),
        Nuisance(0.9, 0.95, (0.05, 0.03, 0.003, 0.008, 0.25, 0.02), (0.003, 0.0, 0.0002), (300.0, 2.3, 300.0)),
        STATE,
        Increment(np.arange(9.0), np.eye(9), np.ones(9)),
        (
            Relative(
                observer="robot/r1",
                subject="robot/r2",
                range=2.0,
                bearing=-0.5,
                range_variance=0.01,
                bearing_variance=0.001,
                age=0.05,
                biases=(Bias(0.1, 7.0),),
                group="post",
                profile=((1.0, 0.5), (3.0, 0.25)),
            ),
            measured("position", "robot/r1", "object/ball", (1.0, 2.0), (0.1, 0.05, 0.2), 0.05),
            measured("range", "robot/r1", "robot/r3", (3.0,), (0.1,), 0.05, (Bias(0.1, 7.0),), "uwb"),
        ),
        returned=STATE,
        camera=CameraFound((0.03, 0.07, 0.02), (0.5, 0.2), (-0.25, 0.1)),
        compass=CompassReading(0.3, 0.05, 1.25, 2.0, 0.125, 0.02, -0.5),
    )
)
FORWARD = Forward(
    board="a1",
    sub_team="a",
    tick=3,
    time=0.6,
    evidence=[Forwarded(robot="r1", tick=3, evidence=EVIDENCE)],
    since=0.2,
    tracks=[PackedTrack(name="person/7", mean=(1.0, 2.0), covariance=(0.5, 0.1, 0.25))],
)
STATUS = Status(
    process="r1",
    kind="robot",
    tick=3,
    time=0.6,
    phase="reported",
    subjects=["object/ball"],
    counters={"sent": 4},
    refused={"mass": 1},
    ages={"r2": 0.1},
    settings={"rule": "cooperative", "k": 2.0},
    tracks={"person/": 7},
)
REFUSAL = Refusal(
    board="a1", sub_team="a", robot="r1", time=0.6, subject="object/ball", reason="grid", text="another", count=3
)
JOURNAL = Journal(
    board="a1",
    sub_team="a",
    began=1e9,
    first=7,
    events=[(1e9, "alive", "cop/t/a/board/a1"), (1e9 + 0.1, "put", "0123456789abcdef"), (1e9 + 0.2, "wake", "")],
    memory="0123456789abcdef",
)
MEMORY = Memory(
    board="a1",
    sub_team="a",
    run="x1",
    tick=3,
    time=0.6,
    consensus=PackedMemory(
        learner=PackedLearner(
            sources=["r1", "r2"],
            heard={"r1": 0.6, "r2": 0.6},
            since={"r1": 0.2},
            counts=b"\x01",
            samples=np.float32(0.5).tobytes() + np.float16([1.0, np.nan]).tobytes(),
            newest=[PackedNewest(subject="object/ball", time=0.6, sources=b"\x00\x01", means=np.arange(4.0).tobytes())],
        ),
        standings=[
            PackedStanding(
                source="r1",
                heard=0.6,
                share=0.5,
                seconds=3,
                sigmas=2.0,
                since=0.2,
                pending=np.array([-4.0, 1.0]).tobytes(),
            )
        ],
        judged={"object/ball": 0.6},
        second=0.2,
        camps={"object/ball": [["r1"], ["r2"]]},
    ),
    agreed=PackedMemory(learner=PackedLearner()),
)

#: A topic's name -> the parts of a key of it, and a message for it.
EXAMPLES: dict[str, tuple[dict[str, str], Message]] = {
    "clock": ({"team": "t"}, CLOCK),
    "reading": ({"team": "t", "robot": "r1"}, READINGS),
    "truth": ({"team": "t"}, TRUTH),
    "solo": ({"team": "t", "robot": "r1"}, SOLO),
    "report": ({"team": "t", "sub_team": "a", "source": "r1", "subject": "object/ball"}, REPORT),
    "consensus": ({"team": "t", "sub_team": "a", "subject": "object/ball"}, CONSENSUS),
    "agreed": ({"team": "t", "sub_team": "a", "subject": "object/ball"}, AGREED),
    "forward": ({"team": "t", "sub_team": "a", "board": "a1"}, FORWARD),
    "memory": ({"team": "t", "sub_team": "a", "board": "a1"}, MEMORY),
    "journal": ({"team": "t", "sub_team": "a", "board": "a1"}, JOURNAL),
    "refused": ({"team": "t", "sub_team": "a", "robot": "r1"}, REFUSAL),
    "status": ({"team": "t", "sub_team": "a", "process": "r1"}, STATUS),
    "disk": ({"team": "t", "recorder": "recorder"}, Disk(recorder="recorder", trouble="full", missing=7)),
}
TOPICS = {topic.name: topic for topic in keys.TOPICS}


def as_map(message: Message) -> dict[str, Any]:
    """A message as msgpack's own types, every field said: what a foreign robot might send."""
    whole: dict[str, Any] = msgpack.unpackb(msgpack.packb(message.model_dump()))
    return whole
