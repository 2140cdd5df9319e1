"""Runs of a team of two robots whose errors are known, as a bench keeps them."""

import math
from dataclasses import replace

from blackboard.judge.samples import Sample
from blackboard.lab import bench

HERE = Sample(1, 1.0, "r1", "a", "robot/r1", "agreed", 0.0, 0.0, 0.0, 0.0, -1.0, 0.25, 0.01, 2.0, 0.0)


def at(time: float, error: float = 0.0, **more: object) -> Sample:
    return replace(HERE, tick=int(time), time=time, mean_x=error, error=error, **more)  # type: ignore[arg-type]


CARD = {
    "verdict": "PASS",
    "reasons": ["x"],
    "hash": "h",
    "ticks": 2,
    "wall_s": 3.2,
    "missing": {},
    "messages": {"refused": {}},
}


def run(protocol: str, fusion: str, error: float, **card: object) -> bench.Run:
    samples = []
    for time in (1.0, 2.0):
        for robot, away in (("r1", error), ("r2", 3 * error)):
            about = {
                "robot": robot,
                "subject": f"robot/{robot}",
                "landmark_age": 3.0 + time if robot == "r2" else math.inf,
            }
            samples += [at(time, 9.0, level="solo", **about), at(time, 5.0, level="consensus", **about)]
            samples += [at(time, away, **about), at(time, 7.0, **{**about, "subject": "object/ball"})]
    return bench.Run(protocol, fusion, samples, {**CARD, **card}, 2, "folder", 5.0)


def ideal_run(protocol: str, error: float) -> bench.Run:
    made = run(protocol, "ideal", error)
    return replace(made, samples=[sample for sample in made.samples if sample.level == "agreed"], card=None)
