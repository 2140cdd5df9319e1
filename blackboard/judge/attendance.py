"""Samples that were expected and could not be judged, because a robot was not there or a belief was missing. Pure.

In every judged tick a robot is expected to have a belief about its own place, and its board the consensus and the agreed one. A
belief about an object is expected only after the robot has seen it; from then on also of the team.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

GONE = 5.0  # seconds without a sample, after which a robot counts as gone: who comes back is settled again within that time


@dataclass
class Attendance:
    """Counts samples; `note_missing` of each of them, in order of time. Mutable."""

    judged: Counter[str] = field(default_factory=Counter)  # subject -> samples
    lacking: Counter[str] = field(default_factory=Counter)  # subject -> samples that were due
    missing: dict[str, Counter[str]] = field(default_factory=dict)  # subject -> level -> samples, due or not
    _since: dict[str, float] = field(default_factory=dict)  # robot -> team time since which every sample was lacking
    _last: dict[str, float] = field(default_factory=dict)  # robot -> team time at which a sample of it was due last
    _until: float = 0.0  # team time of the newest sample
    _heard: dict[str, float] = field(default_factory=dict)  # robot -> team time of its newest solo
    _away: dict[str, float] = field(default_factory=dict)  # robot -> the same, of those that were not heard since
    _back: dict[str, float] = field(default_factory=dict)  # robot -> team time at which it was back after it was gone

    def note_missing(self, subject: str, time: float, missing: Collection[str]) -> None:
        """Take a sample of a subject at a team time (s), and the levels whose beliefs are missing."""
        self._until = self._last[subject] = time
        if not missing:
            self.judged[subject] += 1
            self._since.pop(subject, None)
            return
        self.missing.setdefault(subject, Counter()).update(missing)
        if subject.startswith("robot/") or ("agreed" in missing and "solo" not in missing):
            self.lacking[subject] += 1
            self._since.setdefault(subject, time)

    def note_heard(self, robots: Collection[str], time: float) -> None:
        """Take which robots had a belief about their own place at a team time (s). In order of time."""
        for robot in self._heard.keys() - robots:
            self._away.setdefault(robot, self._heard[robot])
        for robot in robots:
            if time - self._away.pop(robot, time) > GONE:
                self._back[robot] = time
            self._heard[robot] = time

    def is_settled(self, robot: str, time: float) -> bool:
        """Whether a robot that was gone has been back for `GONE` seconds. Before, it may honestly not know where it is."""
        return time - self._back.get(robot, -math.inf) >= GONE

    def reasons(self, subjects: Iterable[str], most: float) -> list[str]:
        """Of which subjects more than the share `most` of the samples is missing, and which robots were gone at the end.

        Of a robot that was never judged at all the verdict says so by itself. A robot that the scenario does not name and that has
        left is expected no more.
        """
        reasons = []
        for subject in subjects:
            lacking, n, robot = self.lacking[subject], self.judged[subject], subject.startswith("robot/")
            share = lacking / max(1, lacking + n)
            if share > most and (n or not robot):
                levels = ", ".join(f"{level} {count}" for level, count in sorted(self.missing[subject].items()))
                text = f"{subject}: {100 * share:.1f} % of its samples are missing ({levels}), at most {100 * most:g} %"
                reasons.append(text)
            if (
                robot
                and n
                and self._last[subject] == self._until
                and self._until - self._since.get(subject, self._until) > GONE
            ):
                reasons.append(f"{subject}: missing from {self._since[subject]:g} s to the end at {self._until:g} s")
        return reasons
