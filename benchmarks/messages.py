"""What does a team lose that may say few messages? `python benchmarks/messages.py`, with `--scenario FILE --seeds 5 6 --rates 10`.

Five robots of the demo in two sub-teams with a joint, in lockstep, with everything and with `[robot.send] rate`, on the same readings.
The log score is that of what is agreed, in nats, the mean over robots and objects. What everything has and a rate lacks counts
as a belief of which nothing is known. Messages and bytes are those of reports, all robots together; a robot's statuses, which only a
world's clock needs in each tick, are not counted.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import ratios  # noqa: F401  # so that this runs on its own

from blackboard.config import Scenario, load
from blackboard.lab.team import Team
from blackboard.opinion.scores import log_score
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, Truth

ROBOTS = {"a": ["r1", "r2", "r3"], "b": ["r4", "r5"]}


@dataclass
class Watch:
    """Spies on a team: log scores of what sub-team a's board has agreed, by subject and tick, and the bytes of each report."""

    scenario: Scenario
    scores: dict[tuple[str, int], float] = field(default_factory=dict)
    sizes: list[int] = field(default_factory=list)
    _truths: dict[int, Truth] = field(default_factory=dict)

    def __call__(self, envelope: Envelope) -> None:
        if envelope.kind is not Kind.PUT:
            return
        if keys.REPORT.match(envelope.key):
            self.sizes.append(len(envelope.key) + len(envelope.payload))
        elif keys.TRUTH.match(envelope.key):
            truth = decode(Truth, envelope.payload)
            self._truths[truth.tick] = truth
        elif (parts := keys.AGREED.match(envelope.key)) and parts["sub_team"] == "a":
            said = decode(Consensus, envelope.payload)
            place = self._truths[said.tick].positions.get(said.subject)
            cell = None if place is None else self.scenario.grid.index(place)
            if cell is not None:
                self.scores[said.subject, said.tick] = log_score(unpack(said.belief, self.scenario.grid).p, cell)


def watched(scenario: Scenario) -> Watch:
    team, watch = Team(scenario), Watch(scenario)
    team.bus.spies.append(watch)
    team.run()
    return watch


def lost(everything: Watch, few: Watch) -> dict[str, float]:
    """Nats of log score that are lost, by subject."""
    uniform = -math.log(everything.scenario.grid.size)
    by_subject: dict[str, list[float]] = {}
    for asked, score in everything.scores.items():
        by_subject.setdefault(asked[0], []).append(score - few.scores.get(asked, uniform))
    return {subject: float(np.mean(losses)) for subject, losses in sorted(by_subject.items())}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102, 103, 104])
    parser.add_argument("--rates", type=float, nargs="+", default=[25.0, 15.0, 10.0, 7.0, 5.0])
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args(arguments)
    scenario = load(args.scenario).changed("time", seconds=args.seconds)
    if args.scenario == "demo":
        scenario = scenario.changed("team", sub_teams=ROBOTS)
    everything = {seed: watched(scenario.changed("world", seed=seed)) for seed in args.seeds}
    print("rate Hz   messages/s   bytes/s a robot   largest   nats lost: robots, objects, all   by seed")
    for rate in (math.inf, *args.rates):
        losses, runs = [], list[Watch]()
        for seed, whole in everything.items():
            slow = scenario.changed("world", seed=seed).changed("robot", send={"rate": rate})
            runs.append(whole if math.isinf(rate) else watched(slow))
            losses.append(lost(whole, runs[-1]))
        sizes = [size for run in runs for size in run.sizes]
        seconds = args.seconds * len(runs)
        kinds = [
            [x for by_subject in losses for s, x in by_subject.items() if s.startswith(kind)]
            for kind in ("robot", "object", "")
        ]
        means = ", ".join(f"{np.mean(kind):+.3f}" if kind else "-" for kind in kinds)
        by_seed = ", ".join(f"{np.mean(list(by_subject.values())):+.2f}" for by_subject in losses)
        each = sum(sizes) / seconds / len(scenario.team.robots)
        print(
            f"{rate:7g} {len(sizes) / seconds:12.1f} {each:17.0f} {max(sizes):9d}   {means:>32}   {by_seed}", flush=True
        )


if __name__ == "__main__":
    main()
