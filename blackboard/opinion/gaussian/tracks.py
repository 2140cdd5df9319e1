"""Which unnamed things there are: tracks that begin with unnamed sightings, grow surer with more, and die. Pure.

A track has an existence probability (integrated probabilistic data association: Musicki, Evans, Stankovic, IEEE TAC 39(6), 1994; for
several tracks of one frame Musicki and Evans, IEEE TAES 40(3), 2004). A sighting is evidence for it; so is against it a frame that
shows nothing where its observer has been seeing such things. Something may be hidden from an observer for a while, so the second
frame without it says less than the first: the "Markov chain two" of the first paper, for each observer.

One robot has one vote: what its frames say is added up in nats of its own, and bounded. So a ghost of one liar does not outlast the
robots that look at its place.

What a frame of clutter is like is found out for each observer and class: how much of what it sees of known tracks, how far it sees
(`views`), and how many of the tracks that it began turned out to be of something.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from statistics import median

from blackboard.opinion.classes import numbered, stem
from blackboard.opinion.gaussian.assignment import CLASSES, CLEAR, Rate, keep
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.views import Place, View

#: Nats: the most that one observer's frames say for a track, as for an object that rolls (`walks`), and against it. Two that look
#: there and see nothing outweigh one that sees it, and one does not: it may be hidden from that one for good.
FOR, AGAINST = 10.0, -5.0
MEMORY = 2.0  # seconds after which a frame without it counts for 1/e: what hides a thing is past by then
STAYS = 60.0  # seconds for which something is there, in the mean: nobody sees it leave where nobody looks
# Seconds for which an observer can see a thing, and then not: who crosses its way is past by then.
SEEN, HIDDEN = 20.0, 2.0
VISIBLE = SEEN / (SEEN + HIDDEN)
LIKELY = 0.5  # of what is likelier so than not
NAMED = 0.99  # of existence: from there on a track has a name, and fewer than one in a hundred is false
RAREST, OFTENEST = 0.01, 0.5  # of the tracks that an observer begins, those that are of something, at least and at most
GIVEN_UP = -3.0  # nats of all frames, from which on a track without a name is dropped
#: A track is not published while the sigma of its place is larger than this share of the distance at which such things are seen.
LOST = 1 / 6
AGAIN = 2  # clear sightings from which on a track that was lost is told of again: one may be of nothing
FLEETING, KEPT = 2.0, 60.0  # seconds without a sighting, after which a track without a name, and one with, is dropped
ROOM = 16  # tracks that one observer alone has seen
NOWHERE = math.inf, 0.0, 0.0  # a place that no frame shows, so that none speaks against a track there
MAX_TRACKS = 64  # that several have seen, or one
FAINTEST = 0.01  # of a track that is in view: below that a frame says nothing of it


@dataclass(frozen=True)
class Vote:
    """What an observer's frames say of a track: nats for its existence, and how likely the observer can see it if it exists."""

    evidence: float = 0.0
    visible: float = VISIBLE
    seen: bool = False  # whether it ever saw it
    looked: bool = False  # whether it looked there in the last tick

    def passed(self, dt: float) -> Vote:
        """After `dt` seconds: what speaks against it is forgotten once nobody looks there any more."""
        stays = self.evidence if self.looked or self.evidence > 0 else self.evidence * math.exp(-dt / MEMORY)
        back = math.exp(-dt * (1.0 / SEEN + 1.0 / HIDDEN))
        return Vote(stays, VISIBLE + back * (self.visible - VISIBLE), self.seen)


@dataclass(frozen=True)
class Track:
    """A track of a class, as `person/?`; `prior` is in nats, `votes` are by observer."""

    kind: str
    prior: float
    votes: Mapping[str, Vote]
    named: bool = False
    unseen: float = 0.0  # seconds since somebody saw it
    age: float = 0.0  # seconds since it began
    shown: int = 0  # frames that have clearly shown it since it was lost, or had a name

    @property
    def evidence(self) -> float:
        """What all frames say together, nats."""
        return math.fsum(vote.evidence for vote in self.votes.values())

    @property
    def existence(self) -> float:
        """The probability that it exists."""
        return 1.0 / (1.0 + math.exp(-self.prior - self.evidence))

    def passed(self, dt: float) -> Track:
        """After `dt` seconds, in which it may have gone: that takes the same share from all votes for it, and then from the prior."""
        votes = {observer: vote.passed(dt) for observer, vote in self.votes.items()}
        track = replace(self, votes=votes, unseen=self.unseen + dt, age=self.age + dt)
        surplus = _nats(track.existence) - _nats(track.existence * math.exp(-dt / STAYS))
        behind = math.fsum(max(0.0, vote.evidence) for vote in votes.values())
        kept = 1.0 - min(1.0, surplus / behind) if behind else 1.0
        votes = {
            o: replace(vote, evidence=vote.evidence * kept) if vote.evidence > 0 else vote for o, vote in votes.items()
        }
        return replace(track, votes=votes, prior=self.prior - max(0.0, surplus - behind))

    @property
    def observers(self) -> set[str]:
        """Who has seen it."""
        return {observer for observer, vote in self.votes.items() if vote.seen}


@dataclass
class Tracks(Copyable):
    """Mutable; `pass_time` once per tick, `judge` once per frame, in an order that depends on names only.

    `room` is for how many tracks that one observer alone has seen; `label` stands in the names that are given, before the number.
    """

    room: int = ROOM
    label: str = ""  # of the names that are given here, before the number
    _tracks: dict[str, Track] = field(default_factory=dict)  # by the name of their block in the joint
    _views: dict[tuple[str, str], View] = field(default_factory=dict)  # by observer and class
    # The same: of the tracks begun, those that got a name.
    _real: dict[tuple[str, str], Rate] = field(default_factory=dict)
    _numbers: dict[str, int] = field(default_factory=dict)  # class -> the last number that was given
    # How names begin -> the last number that was given before this board started.
    _before: dict[str, int] = field(default_factory=dict)
    _over: tuple[str, ...] = ()  # the names of those that are over, the newest last
    _begun: int = 0

    def __contains__(self, block: object) -> bool:
        return block in self._tracks

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._tracks))

    def anew(self) -> Tracks:
        """No tracks, and no number that was ever given."""
        return Tracks(
            self.room,
            self.label,
            _numbers=dict(self._numbers),
            _before=dict(self._before),
            _over=self._over,
            _begun=self._begun,
        )

    def existence(self, block: str) -> float | None:
        """The probability that what a track is of exists; None of all that is no track."""
        return self._tracks[block].existence if block in self._tracks else None

    def kind(self, block: str) -> str:
        """The class of what a track is of, as `person/?`; nothing of all that is no track."""
        return self._tracks[block].kind if block in self._tracks else ""

    def age(self, block: str) -> float:
        """Seconds since a track began."""
        return self._tracks[block].age

    def is_named(self, block: str) -> bool:
        """Whether a track has a name that nothing else has."""
        return self._tracks[block].named

    def is_told(self, block: str) -> bool:
        """Whether a track has a name, likelier exists than not, and is not lost."""
        track = self._tracks[block]
        return track.named and track.shown >= AGAIN and track.existence > LIKELY

    def lose(self, block: str, sigma: float) -> None:
        """A track is lost where its place is not known to `LOST` any more (sigma, unit): it has to be found again."""
        track = self._tracks[block]
        seen = [view.farthest for (_, kind), view in sorted(self._views.items()) if kind == track.kind]
        if track.named and seen and sigma > LOST * median(seen):
            self._tracks[block] = replace(track, shown=0)

    def expected(self, observer: str, block: str) -> float:
        """How likely an observer's frame shows a track, before it is looked at."""
        track = self._tracks[block]
        visible = track.votes.get(observer, Vote()).visible
        return self._view(observer, track.kind).detects * visible * track.existence

    def is_alone(self, observer: str, block: str) -> bool:
        """Whether an observer alone has seen a track."""
        return block in self._tracks and self._tracks[block].observers == {observer}

    def observers(self, block: str) -> frozenset[str]:
        """Who has seen a track."""
        return frozenset(self._tracks[block].observers)

    def area(self, observer: str, kind: str) -> float:
        """How large a part of the map an observer sees things of a class in (unit^2)."""
        return self._view(observer, kind).area

    def in_view(self, observer: str, block: str, place: Place) -> float:
        """How likely a track is where an observer looks, relative to which it is at a place."""
        return self._view(observer, self._tracks[block].kind).share(place)

    def _view(self, observer: str, kind: str) -> View:
        return self._views.get((observer, kind), View())

    # --- in -------------------------------------------------------------------------------------------------------------

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._tracks = {block: track.passed(dt) for block, track in self._tracks.items()}

    def look(self, observer: str, kind: str, distance: float, bearing: float) -> None:
        """An observer sees something of a class at a distance (unit) and a bearing (rad)."""
        view = self._view(observer, kind)
        reach, side = view.reach.plus(distance), view.side.plus(abs(bearing))
        keep(self._views, (observer, kind), replace(view, reach=reach, side=side))

    def on_frame(self, observer: str, shown: Collection[str], time: float) -> set[str]:
        """Take an observer's tick that ended at a team time (s): the classes of which it has a frame.

        These are the classes that it has `shown`, and those of which it is time for one that shows nothing.
        """
        for kind in sorted(shown):
            keep(self._views, (observer, kind), self._view(observer, kind).shown(time))
        its = {kind: view for (robot, kind), view in self._views.items() if robot == observer}
        looked = {kind for kind, view in its.items() if kind not in shown and view.looks(time)}
        for kind in looked:
            self._views[observer, kind] = replace(its[kind], looked_at=time)
        return looked.union(shown)

    def judge(self, observer: str, places: Mapping[str, Place], seen: Mapping[str, float]) -> None:
        """Take a frame of an observer: where tracks are from it, and with which probabilities it shows them."""
        for block in sorted(places):
            track, share = self._tracks[block], seen.get(block, 0.0)
            view = self._view(observer, track.kind)
            detects, within = view.detects, view.share(places[block])
            holds = view.holds(places[block])
            if within < FAINTEST and not share:
                continue
            vote = track.votes.get(observer, Vote())
            before = track.existence
            after = share + (1.0 - share) * _unseen(before, detects * vote.visible * within)
            news = _nats(after) - _nats(before)
            evidence = min(FOR, max(AGAINST, vote.evidence + news))
            visible = share + (1.0 - share) * _unseen(vote.visible, detects * within)
            looked = holds or share > 0.0
            votes = {**track.votes, observer: Vote(evidence, visible, vote.seen or share >= LIKELY, looked)}
            is_shown = share >= LIKELY
            unseen = 0.0 if is_shown else track.unseen
            self._tracks[block] = replace(track, votes=votes, unseen=unseen, shown=track.shown + (share >= CLEAR))
            if holds and self.is_told(block):
                detected = view.detected.plus(share, after * visible)
                keep(self._views, (observer, track.kind), replace(view, detected=detected))

    def begin(self, observer: str, kind: str) -> str | None:
        """Begin a track of a class with a sighting, and return the name of its block; None where there is no room for it."""
        alone = sum(self.is_alone(observer, block) for block in self._tracks)
        if alone >= self.room or len(self._tracks) >= MAX_TRACKS:
            return None
        self._begun += 1
        block = f"{stem(kind)}?{self._begun}"
        prior = _nats(min(OFTENEST, max(RAREST, self._real.get((observer, kind), Rate()).rate)))
        self._tracks[block] = Track(kind, prior, {observer: Vote(visible=1.0, seen=True)})
        return block

    def to_be_named(self) -> list[str]:
        """The blocks of tracks that are sure enough to be told of, sorted."""
        return [block for block in self if not self._tracks[block].named and self._tracks[block].existence >= NAMED]

    def name(self, block: str, used: Callable[[str], bool]) -> str:
        """Give a track a name that nothing had before."""
        name = self.new_name(block, used)
        self.call(block, name)
        return name

    def new_name(self, block: str, used: Callable[[str], bool], others: Collection[str] = ()) -> str:
        """A name for a track: its class and the next number that is not `used`, which is never given again.

        The first is the one behind those that `others` have, and that `remember` was told of.
        """
        kind = self._tracks[block].kind
        begins = f"{stem(kind)}{self.label}"
        given = [number for name, number in map(numbered, others) if name == begins]
        number = self._numbers.get(kind) or max([*given, self._before.get(begins, 0)])
        number += 1
        while used(name := f"{begins}{number}"):
            number += 1
        self._numbers[kind] = number
        return name

    def remember(self, numbers: Mapping[str, int]) -> None:
        """Somebody has heard of tracks with these numbers, by how their names begin: the largest of each count."""
        for begins, number in numbers.items():
            has_room = begins in self._before or len(self._before) < CLASSES
            if has_room and numbered(f"{begins}{number}") == (begins, number):
                self._before[begins] = max(number, self._before.get(begins, 0))

    def call(self, block: str, name: str) -> None:
        """A track has a name from now on, or another one."""
        track = self._tracks.pop(block)
        if not track.named:
            self._learn(track, 1.0)
        self._over = tuple(over for over in self._over if over != name)
        self._tracks[name] = replace(track, named=True, shown=track.shown if track.named else AGAIN)

    def ended(self) -> list[str]:
        """The blocks of tracks that are over, sorted."""
        return [block for block in self if self._is_over(self._tracks[block])]

    def _is_over(self, track: Track) -> bool:
        if not track.observers:
            return True
        if not track.named:
            return track.unseen > FLEETING or track.evidence < GIVEN_UP
        return track.unseen > KEPT or track.existence < 1.0 - CLEAR

    def is_over(self, name: str) -> bool:
        return name in self._over

    def drop(self, block: str) -> None:
        """A track is over."""
        track = self._tracks.pop(block)
        if track.named:
            self._over = (*self._over[1 - MAX_TRACKS :], block)
        if not track.named:
            self._learn(track, 0.0)

    def _learn(self, track: Track, real: float) -> None:
        """Who saw a track that turned out to be of something, or not, learns from that what the next one will be worth."""
        for observer in sorted(track.observers):
            key = observer, track.kind
            keep(self._real, key, self._real.get(key, Rate()).plus(real))

    def without(self, observers: Collection[str]) -> None:
        """From now on these have no vote."""
        for block, track in self._tracks.items():
            votes = {observer: vote for observer, vote in track.votes.items() if observer not in observers}
            self._tracks[block] = replace(track, votes=votes)


def _unseen(probability: float, detects: float) -> float:
    """How likely something is so that would have been seen with the probability `detects`, and was not."""
    return probability * (1.0 - detects) / (1.0 - probability * detects)


def _nats(probability: float) -> float:
    """The log odds of a probability, within what is told apart from 0 and 1."""
    probability = min(1.0 - 1e-12, max(1e-12, probability))
    return math.log(probability / (1.0 - probability))
