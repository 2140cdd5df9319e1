"""What a board without a joint makes of sightings that name a class: which of them are of one thing. Pure.

A sighting and a subject overlap: the product of the two beliefs over all places says how much likelier the sighting is of that subject
than of something anywhere. All sightings of a robot's tick are different things, so they are assigned together (`assignment.py`).
What is clearly of a subject that has a name becomes the robot's opinion about it. What most likely is of nobody known begins a track
(`gaussian/tracks.py`), whose place is that of the sightings that were taken for it.

A board names its tracks by its sub-team, as `person/a-1`, so that no other board gives that name to something else. What only another
sub-team knows has the name that is known there. Of two that turn out to be of one thing the name that sorts first is kept, and who
took over the name of another thing gives it another one.
No frame speaks against a track, because a board does not know where a robot looked.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from blackboard.board.entries import Entry
from blackboard.board.unnamed import counters
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.belief import Belief
from blackboard.opinion.believed import MAX_SOURCES
from blackboard.opinion.classes import could_be, stem
from blackboard.opinion.gaussian.assignment import CLEAR, MOST, posterior
from blackboard.opinion.gaussian.naming import FAINT, IN_VIEW, Naming, Odds, Unnamed, clear
from blackboard.opinion.gaussian.tracks import LIKELY, MEMORY, NOWHERE, Tracks
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Report

LONGEST = 16  # characters of a sub-team's name in the names of its tracks

Entries = dict[str, dict[str, Entry]]  # by subject and robot


@dataclass(frozen=True, eq=False)
class UnnamedOpinion:
    """What a robot saw and cannot name: `subject` is the class; `mark` its number in its tick."""

    observer: str
    subject: str
    mark: int
    confidence: float
    belief: Belief


@dataclass(frozen=True, eq=False)
class Frame:
    """The unnamed sightings of a robot's tick at a team time (s), and where it says that it is itself."""

    tick: int
    time: float
    own: Belief
    sightings: tuple[UnnamedOpinion, ...]


@dataclass
class Clusters:
    """Mutable; the order in which frames are heard changes nothing. Times are team time in seconds."""

    grid: Grid
    ageing: Ageing
    sub_team: str
    unnamed: list[Unnamed] = field(default_factory=list)  # what became of the sightings that were settled last
    tally: Counter[str] = field(default_factory=Counter)  # for a status: what happened then
    _waiting: dict[str, Frame] = field(default_factory=dict)  # by robot: its newest frame
    _settled: dict[str, float] = field(default_factory=dict)  # by robot: the time of its newest frame that was settled
    _members: Entries = field(default_factory=dict)  # by track: the newest opinion of each robot
    _places: dict[str, tuple[float, Belief]] = field(default_factory=dict)  # by track: when it was seen last, and where
    #: Of a track and what is known elsewhere: how likely they were the same, in the mean over time.
    _alike: dict[tuple[str, str], float] = field(default_factory=dict)
    #: By subject and robot: the time (s) of the newest opinion that was settled.
    _said: dict[tuple[str, str], float] = field(default_factory=dict)
    _time: float | None = None

    def __post_init__(self) -> None:
        self.tracks = Tracks(label=f"{self.sub_team[:LONGEST]}-")
        self.naming = Naming(self.grid.volume * self.grid.size)

    def hear_report(self, report: Report) -> None:
        """Take the unnamed sightings of a robot's tick. Refused: "grid", "mass"."""
        robot, newest = report.source, self._settled.get(report.source, -math.inf)
        waits = robot in self._waiting
        if not report.unnamed or report.time <= (self._waiting[robot].time if waits else newest):
            return
        if not waits and len(self._waiting) >= MAX_SOURCES:
            return
        seen = tuple(
            UnnamedOpinion(robot, unnamed.kind, unnamed.mark, unnamed.confidence, unpack(unnamed.belief, self.grid))
            for unnamed in report.unnamed
        )
        self._waiting[robot] = Frame(report.tick, report.time, unpack(report.belief, self.grid), seen)

    @property
    def is_idle(self) -> bool:
        """Whether there are neither tracks nor unnamed sightings that wait."""
        return not self._waiting and not list(self.tracks)

    # --- settle ---------------------------------------------------------------------------------------------------------

    def settle(self, now: float, max_age: float, here: Mapping[str, Belief], others: Mapping[str, Belief]) -> Entries:
        """Judge all frames that wait: what robots say of subjects that have names. Opinions are forgotten after `max_age`.

        `here` is where the subjects are now that this sub-team knows, `others` where other sub-teams have what they know.
        """
        dt = 0.0 if self._time is None else max(0.0, now - self._time)
        self._time, self.unnamed, self.tally = now, [], Counter()
        self.tracks.pass_time(dt)
        self._end(now, max_age)
        places = {block: self._now(block, now) for block in self.tracks} | dict(here)
        entries: Entries = {}
        for robot, frame in sorted(self._waiting.items()):
            self._judge(frame, places, entries)
            self._settled[robot] = frame.time
        self._settled = {robot: time for robot, time in self._settled.items() if time >= now - max_age}
        self._waiting = {}
        self._rename(dt, places, others)
        self.tally.update(counters(self.unnamed))
        told = {block: members for block, members in self._members.items() if members and self.tracks.is_told(block)}
        return self._without_older(entries | told, now - max_age)

    def _without_older(self, entries: Entries, since: float) -> Entries:
        """Leave out an opinion that is older than one of the same robot and subject that was settled before.

        Two tracks may have had the same name one after the other. Times before `since` are forgotten.
        """
        self._said = {pair: time for pair, time in self._said.items() if time >= since}
        newest = {
            subject: {
                robot: entry
                for robot, entry in by_robot.items()
                if entry.time >= self._said.get((subject, robot), -math.inf)
            }
            for subject, by_robot in entries.items()
        }
        self._said |= {
            (subject, robot): entry.time for subject, by_robot in newest.items() for robot, entry in by_robot.items()
        }
        return {subject: by_robot for subject, by_robot in newest.items() if by_robot}

    def existence(self, subject: str) -> float | None:
        """The probability that what a track is of exists; None of all that is no track of this board, and of robots."""
        return None if subject.startswith("robot/") else self.tracks.existence(subject)

    def _now(self, block: str, now: float) -> Belief:
        seen, belief = self._places[block]
        return self.ageing.spread(belief, block, now - seen)

    def _judge(self, frame: Frame, places: dict[str, Belief], entries: Entries) -> None:
        """Take a frame: what is of a track becomes a member of it, what is of another subject is put into `found`."""
        robot, strange = frame.sightings[0].observer, list[UnnamedOpinion]()
        odds, shown = self._odds(frame, places, {f"robot/{robot}"}), dict[str, float]()
        for sighting, its in zip(frame.sightings, odds, strict=True):
            share = its.subjects
            best: str = max(sorted(share), key=lambda one: share[one], default="")
            told = {one: p for one, p in share.items() if one not in self.tracks or self.tracks.is_named(one)}
            self.unnamed.append(Unnamed(robot, frame.time, sighting.mark, told, clear(told)))
            for block in share.keys() & set(self.tracks):
                shown[block] = min(1.0, shown.get(block, 0.0) + share[block])
            if best in self.tracks and share[best] >= LIKELY:
                self._join(best, frame, sighting)
            elif best and share[best] >= CLEAR:
                entries.setdefault(best, {})[robot] = _entry(frame, sighting)
            elif its.is_new:
                strange.append(sighting)
        self._look(frame)
        self.tracks.judge(robot, dict.fromkeys(shown, NOWHERE), shown)
        new = list[UnnamedOpinion]()
        for sighting in strange:
            densities = [self._overlap(sighting, one.belief) for one in new if one.subject == sighting.subject]
            if self.naming.is_second(sighting, densities):
                continue
            begun = self.tracks.begin(robot, sighting.subject)
            if begun is None:
                self.tally["unnamed_left_out"] += 1
            else:
                new.append(sighting)
                self._join(begun, frame, sighting)
                places[begun] = sighting.belief

    def _odds(self, frame: Frame, places: Mapping[str, Belief], without: Collection[str]) -> list[Odds]:
        """Of each sighting the subjects that it may be of: those with which it overlaps more than with something anywhere."""
        densities = {}
        for row, sighting in enumerate(frame.sightings):
            for subject, belief in places.items():
                if could_be(sighting.subject, subject) and subject not in without:
                    density = self._overlap(sighting, belief)
                    densities[row, subject] = density if density > 1.0 else 0.0
        shown = {}
        for _, subject in densities:
            exists = self.tracks.existence(subject)
            chance = IN_VIEW * (1.0 if exists is None else exists)
            shown[subject] = chance / (1.0 - chance)
        return self.naming.weigh(frame.sightings, densities, shown)

    def _overlap(self, sighting: UnnamedOpinion, belief: Belief) -> float:
        """How much likelier a sighting is of what a belief is about than of something anywhere."""
        area = min(self.naming.area, self.tracks.area(sighting.observer, sighting.subject))
        return area / self.grid.volume * float((sighting.belief.p * belief.p).sum())

    def _look(self, frame: Frame) -> None:
        """Learn how far a robot sees things, all around it: the board knows where it is, and not where it looks."""
        own = frame.own.mean()
        for sighting in frame.sightings:
            self.tracks.look(
                sighting.observer, sighting.subject, float(np.linalg.norm(sighting.belief.mean() - own)), math.pi
            )

    # --- tracks ---------------------------------------------------------------------------------------------------------

    def _join(self, block: str, frame: Frame, sighting: UnnamedOpinion) -> None:
        self._members.setdefault(block, {})[sighting.observer] = _entry(frame, sighting)
        self._places[block] = frame.time, sighting.belief

    def _end(self, now: float, max_age: float) -> None:
        """Forget opinions that are too old, and tracks that are over."""
        for block, members in self._members.items():
            young = {robot: entry for robot, entry in members.items() if entry.time >= now - max_age}
            self._members[block] = young
            if not young:
                self.tracks.lose(block, math.inf)
        for block in self.tracks.ended():
            self._drop(block)

    def _drop(self, block: str) -> None:
        self.tally["tracks_died"] += self.tracks.is_named(block)
        self.tracks.drop(block)
        del self._members[block], self._places[block]

    # --- names ----------------------------------------------------------------------------------------------------------

    def _rename(self, dt: float, places: Mapping[str, Belief], others: Mapping[str, Belief]) -> None:
        """Name the tracks that are sure, by what others call them; and take the other name where they call it otherwise.

        A named one is the same as another one where that was likely in the mean over time: what passes by is not.
        """
        apart = [
            block
            for block in self.tracks
            if block in others and not self._is_mine(block) and _density(places[block], others[block]) < 1
        ]
        for block in apart:
            self._call(block, self._new(block, others))
        mine = {block: (self.tracks.kind(block), places[block]) for block in self.tracks if block in places}
        unknown = {
            other: belief for other, belief in others.items() if other not in places and other not in self.tracks
        }
        shares = _same(mine, unknown, lambda one, other: True) | _same(mine, places, self._may_be_one)
        kept = math.exp(-dt / MEMORY)
        means = {pair: kept * self._alike.get(pair, 0.0) + (1.0 - kept) * share for pair, share in shares.items()}
        self._alike = {pair: mean for pair, mean in means.items() if mean > FAINT}
        for block, other in sorted(self._alike):
            there = other in unknown or other in self.tracks
            first = other.startswith("robot/") or other < block
            if (
                block in self.tracks
                and self.tracks.is_named(block)
                and there
                and first
                and means[block, other] >= LIKELY
            ):
                self._call(block, other)
        for block in self.tracks.to_be_named():
            same = [
                other for other in unknown if other not in self.tracks and shares.get((block, other), 0.0) >= LIKELY
            ]
            self._call(block, same[0] if same else self._new(block, others))
            self.tally["tracks_born"] += 1

    def _may_be_one(self, one: str, other: str) -> bool:
        """Whether two tracks of this board are one that has a name, and another: no robot has seen both in one frame lately."""
        if one == other or other not in self.tracks or not self.tracks.is_named(other):
            return False
        mine, its = self._members[one], self._members[other]
        return all(mine[robot].time != its[robot].time for robot in mine.keys() & its.keys())

    def _is_mine(self, name: str) -> bool:
        """Whether a track has a name that this board gives."""
        return self.tracks.is_named(name) and name.startswith(f"{stem(self.tracks.kind(name))}{self.tracks.label}")

    def _new(self, block: str, others: Collection[str]) -> str:
        return self.tracks.new_name(block, lambda name: name in others or name in self._members)

    def _call(self, block: str, name: str) -> None:
        """A track gets a name, and what is known of it with it; where another track has the name, the two are one."""
        members, place = self._members.pop(block), self._places.pop(block)
        if name in self.tracks:
            self.tracks.drop(block)
            both = [*members.items(), *self._members[name].items()]
            members = dict(sorted(both, key=lambda member: member[1].time))
            place = max(place, self._places[name], key=lambda option: option[0])
        else:
            self.tracks.call(block, name)
        self._members[name], self._places[name] = members, place


def _entry(frame: Frame, sighting: UnnamedOpinion) -> Entry:
    return Entry(
        frame.tick, frame.time, (Opinion(sighting.observer, sighting.belief, {sighting.observer: frame.time}),)
    )


def _density(one: Belief, other: Belief) -> float:
    """How much likelier two beliefs are about one place than about two."""
    return one.grid.size * float((one.p * other.p).sum())


def _same(
    ones: Mapping[str, tuple[str, Belief]], others: Mapping[str, Belief], may_be: Callable[[str, str], bool]
) -> dict[tuple[str, str], float]:
    """Of pairs of a thing of a class and another one how likely they are the same; each is one of them at most."""
    rows, columns = sorted(ones), sorted(others)
    weights = np.zeros((len(rows), len(columns)))
    for (row, one), (column, other) in _pairs(rows, columns):
        kind, belief = ones[one]
        if could_be(kind, other) and may_be(one, other):
            weights[row, column] = min(MOST, _density(belief, others[other]))
    weights[weights <= 1.0] = 0.0
    shares = posterior(weights)
    return {(one, other): float(shares[row, column]) for (row, one), (column, other) in _pairs(rows, columns)}


def _pairs(rows: Iterable[str], columns: Iterable[str]) -> list[tuple[tuple[int, str], tuple[int, str]]]:
    return [(row, column) for row in enumerate(rows) for column in enumerate(columns)]
