"""`make adversary`: search for the worst lie that one member can tell: random lies first, then changes of the worst ones.

Each lie is tried on a short team in a joint or with opinions (`blackboard.chaos.lies`), by how much the honest robots' or the objects'
agreed RMSE grows against the same seed without it. What is printed last belongs into the catalogue.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, get_args

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # each process has one core; before NumPy is loaded
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

from blackboard.chaos.lies import changes  # noqa: E402
from blackboard.chaos.lies.catalogue import Lie  # noqa: E402
from blackboard.chaos.lies.changes import Change  # noqa: E402
from blackboard.chaos.lies.scene import Whom  # noqa: E402
from blackboard.chaos.lies.table import row  # noqa: E402
from blackboard.chaos.lies.trial import try_lie  # noqa: E402
from blackboard.config import Scenario, load  # noqa: E402
from blackboard.lab.parallel import run_jobs  # noqa: E402
from blackboard.opinion.gaussian.relation import NUMBERS  # noqa: E402

BATCH = 8  # lies that are tried at once
KEPT = 4  # of the worst, which are changed
Found = tuple[float, Lie]  # how many times the error, and the lie


def draw_change(rng: np.random.Generator) -> Change:
    """A change with parameters of every size that makes sense."""

    def size(low: float, high: float) -> float:
        return float(10 ** rng.uniform(low, high))

    def offset(low: float = -2, high: float = 1.2) -> tuple[float, float]:
        far, angle = size(low, high), rng.uniform(0, 2 * math.pi)
        return far * math.cos(angle), far * math.sin(angle)

    whom = str(rng.choice(get_args(Whom)))
    sigma = None if rng.random() < 0.2 else size(-4, 0.5)
    drawn: Sequence[Change] = (
        changes.Off(offset(), offset(-2, 0)),
        changes.Sure(size(0, 3)),
        changes.Gains(offset(), size(-1, 9)),
        changes.Sees(whom, offset(), sigma, always=bool(rng.random() < 0.6)),  # type: ignore[arg-type]
        changes.Tells(
            str(rng.choice(list(NUMBERS))), whom, offset(), size(-4, 0.5), size(-2, 0), bool(rng.random() < 0.5)
        ),  # type: ignore[arg-type]
        changes.Unnames(),
        changes.Knows(whom, offset(), size(-1, 1)),  # type: ignore[arg-type]
        changes.EchoesTeam(size(-1, 1)),
        changes.Mirrors(),
        changes.Invents(int(rng.integers(1, 64)), bool(rng.random() < 0.5), bool(rng.random() < 0.5)),
        changes.WrongWheels(float(rng.normal(1, 2)), float(rng.normal(1, 2)), sigma),
        changes.Epochs(),
        changes.WrongClock(float(rng.normal(0, 3)), float(rng.normal(0, 0.3))),
        changes.Replays(size(-1, 1.5)),
    )
    return drawn[int(rng.integers(len(drawn)))]


def draw_lie(rng: np.random.Generator) -> Lie:
    """One to three changes, told all the time or in turns."""
    turns = {"on": float(rng.uniform(0.2, 3)), "off": float(rng.uniform(0.2, 3))} if rng.random() < 0.2 else {}
    return Lie("drawn", tuple(draw_change(rng) for _ in range(int(rng.integers(1, 4)))), **turns)


def neighbour(lie: Lie, rng: np.random.Generator) -> Lie:
    """A lie that differs a little: in its numbers, or by one change more, less or other."""
    altered, what = list(lie.changes), rng.random()
    at = int(rng.integers(len(altered)))
    if what < 0.15 and len(altered) < 4:
        altered.append(draw_change(rng))
    elif what < 0.3 and len(altered) > 1:
        del altered[at]
    elif what < 0.4:
        altered[at] = draw_change(rng)
    else:
        moved = {field.name: _moved(getattr(altered[at], field.name), rng) for field in fields(altered[at])}  # type: ignore[arg-type]
        altered[at] = replace(altered[at], **moved)  # type: ignore[type-var]
    return replace(lie, changes=tuple(altered))


def _moved(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, tuple):
        return tuple(_moved(part, rng) for part in value)
    return value * float(np.exp(rng.normal(0, 0.4))) if isinstance(value, float) else value


def search(scenario: Scenario, seed: int, count: int, rng: np.random.Generator) -> list[Found]:
    """Try so many lies, half of them drawn anew: the worst, the worst first. A line for each new worst."""
    scenario = scenario.changed("world", seed=seed)
    calm = try_lie(scenario, None, rng)
    worst: list[Found] = []
    for tried in range(0, count, BATCH):
        fresh = tried < count // 2 or not worst
        lies = [draw_lie(rng) if fresh else neighbour(worst[n % len(worst)][1], rng) for n in range(BATCH)]
        for lie, trial in zip(lies, run_jobs(try_lie, [(scenario, lie, rng.spawn(1)[0]) for lie in lies]), strict=True):
            result = row(scenario, seed, lie, calm, trial)
            error = max(result["robots"] or math.inf, result["objects"] or math.inf)
            if not worst or error > worst[0][0]:
                print(f"{tried + BATCH} of {count} tried: {error:.2f} {lie.changes}", flush=True)
            worst = sorted([*worst, (error, lie)], key=lambda tried: -tried[0])[:KEPT]
    return worst


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.adversary", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="lies")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each team")
    parser.add_argument("--fusion", choices=("joint", "opinions"), default="joint")
    args = parser.parse_args()
    scenario = load("demo").changed("time", seconds=args.seconds).changed("board", fusion=args.fusion)
    for error, lie in search(scenario, args.seed, args.count, np.random.default_rng(args.seed)):
        print(f"{error:.2f} {lie}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
