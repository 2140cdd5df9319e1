"""The joint belief of a team: robots with their lasting errors, and objects. Increments in, marginals out.

Each tick is settled once with all evidence that came in time, in an order that depends on names only: so the order of
arrival changes nothing. What was settled is never taken again (`_news`): a repeated report is ignored, a lost one loses
its evidence, and no evidence is counted twice.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from blackboard.errors import Degenerate
from blackboard.opinion.belief import Belief
from blackboard.opinion.chi_squared import DOUBT, GATE, quantile, wilson_hilferty
from blackboard.opinion.classes import could_be, is_class
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.coalitions import KNOWN, PREDICTION, Choice, about, choose
from blackboard.opinion.gaussian.contacts import Claim, Contacts
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.evidence import Evidence, Tally, Verdict
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.innovations import Innovations, Source
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.naming import Naming, Unnamed, clear
from blackboard.opinion.gaussian.offsets import Offsets
from blackboard.opinion.gaussian.relation import UNSTEADY, BiasBlock, Relative, forget_biases, linearise
from blackboard.opinion.gaussian.rings import SURE, Place, Ring, line_of
from blackboard.opinion.gaussian.trust import Trust
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, STATES, Motion, Nuisance, correct, drive, speed
from blackboard.opinion.gaussian.walks import LEAST, Model, Walks
from blackboard.opinion.grid import Grid

ABSURD = 1e10  # of any variance: what is known of nothing has 1e6, and motion adds to that
PATIENCE = 5  # increments of a robot that are left out in a row, before its block is widened
MAX_ERRORS = 20  # lasting errors of one observer's sightings: those that were used last
LATELY = 2.0  # seconds after which what a robot did counts for 1/e in how fast it is told to go on
MAX_RINGS = 16  # objects of which only ranges or bearings are known
FADED = 5.0  # time constants after which a lasting error that no sighting used is dropped: 0.7 % of it is left
#: Times the covariance of a robot that enters again: its mates keep what they learned of it before. Half of it counts, as in a
#: covariance intersection with equal weights (Julier and Uhlmann, ACC 1997).
AGAIN = 2.0
ALONE = 4  # objects that one robot alone has seen and that tell it how it moved: together less than its odometry does
WIDENED = (3.0, 0.3)  # sigmas added then: of the position, times its own; of the heading, radians


Doubt = dict[
    str, tuple[float, Relative]
]  # subjects that a sighting may be of, with their odds and the sighting as one of them


@dataclass(frozen=True)
class Objects:
    """How objects move: random walks (unit / sqrt(s)) before they are seen, then by a model. `kept`: seconds without a sighting."""

    drift: float = 0.5
    drifts: Mapping[str, float] = field(default_factory=dict)  # of those that move otherwise, by name, as `can`
    kept: float = 60.0
    model: Model = "learn"
    models: Mapping[str, Model] = field(default_factory=dict)  # of those that move otherwise, by name, as `can`

    def model_of(self, subject: str) -> Model:
        """How an object, named as `object/can`, moves."""
        return self.models.get(subject.partition("/")[2], self.model)

    def drift_of(self, subject: str) -> float:
        """The configured drift of an object, such as `object/can`; one that stands still may be kicked all the same."""
        return max(self.drifts.get(subject.partition("/")[2], self.drift), LEAST * self.drift)


@dataclass(frozen=True)
class Known:
    """What is settled of a robot: its epoch, the sum of its motions, and how many increments in a row were left out.

    `motion` is what was added to the sum last, until a team time (s), `lately` the same of the last seconds (`LATELY`).
    """

    epoch: int
    travelled: Motion
    left_out: int = 0
    motion: Motion = field(default_factory=Motion)
    lately: Motion = field(default_factory=Motion)
    time: float = 0.0


@dataclass
class TeamJoint:
    """Mutable; `settle` once per tick. Robots and objects are named as subjects: `robot/r1`, `object/ball`."""

    objects: Objects = field(default_factory=Objects)
    joint: Joint = field(default_factory=Joint)
    tally: Tally = field(default_factory=Tally)
    trust: Trust = field(default_factory=Trust)
    contacts: Contacts = field(default_factory=Contacts)
    innovations: Innovations = field(default_factory=Innovations)
    offsets: Offsets = field(default_factory=Offsets)
    walks: Walks = field(default_factory=Walks)
    limits: Limits = field(default_factory=Limits)
    naming: Naming = field(default_factory=Naming)
    rings: dict[str, Ring] = field(default_factory=dict)  # of objects of which only ranges or bearings alone are known
    elapsed: float = 0.0  # seconds that were settled
    rule: Coalition = field(default_factory=Coalition)  # chooses between evidence that contradicts each other
    tick: int = -1
    _left_out: frozenset[str] = frozenset()  # robots that the majority contradicts, as the tick began
    _refuted: frozenset[str] = frozenset()  # robots that `contacts` has left out since they entered
    _known: dict[str, Known] = field(default_factory=dict)
    _seen: dict[str, float] = field(default_factory=dict)  # object -> seconds since it was sighted
    #: Observer -> the lasting errors of its sightings -> seconds since one with it was taken, the longest first.
    _used: dict[str, dict[BiasBlock, float]] = field(default_factory=dict)

    def copy(self) -> TeamJoint:
        """The same, which may be changed without changing this one; what is not changed in place is shared."""
        return replace(
            self,
            joint=self.joint.copy(),
            tally=replace(
                self.tally,
                verdicts=list(self.tally.verdicts),
                choices=dict(self.tally.choices),
                unnamed=list(self.tally.unnamed),
            ),
            trust=self.trust.copy(),
            contacts=self.contacts.copy(),
            innovations=self.innovations.copy(),
            offsets=self.offsets.copy(),
            walks=self.walks.copy(),
            limits=self.limits.copy(),
            naming=self.naming.copy(),
            rings={subject: ring.copy() for subject, ring in self.rings.items()},
            _known=dict(self._known),
            _seen=dict(self._seen),
            _used={observer: dict(used) for observer, used in self._used.items()},
        )

    # --- in -------------------------------------------------------------------------------------------------------------

    def settle(self, tick: int, dt: float, reports: Iterable[Evidence]) -> list[Verdict]:
        """Take the evidence of one tick of `dt` seconds; a tick that is settled already changes nothing.

        Degenerate: some evidence leaves no Gaussian that can be kept. The team is in no defined state then.
        """
        if tick <= self.tick:
            self.tally.repeated += sum(1 for _ in reports)
            return []
        self.tick = tick
        news = self._aligned(self._news(tick, reports))
        self.tally.verdicts, self.tally.unnamed = [], []
        refuted = self.contacts.left_out()
        self._refuted |= refuted
        self._leave_out(self.trust.left_out() | refuted)
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            self._take(dt, news)
        for robot, evidence in news.items():
            known = self._known[robot]
            motion = evidence.travelled.since(known.travelled)
            lately = known.lately.times(math.exp(-motion.dt / LATELY)).plus(motion)
            self._known[robot] = Known(known.epoch, evidence.travelled, known.left_out, motion, lately, evidence.time)
        self._forget_objects()
        self._close_rings()
        return self.tally.verdicts

    def _take(self, dt: float, news: Mapping[str, Evidence]) -> None:
        self.limits.pass_time(dt)
        motions = self._predict(dt, news)
        entered = {robot for robot, evidence in news.items() if self._enter(evidence)}
        all_news = self._bounded(news, set(motions) - entered)
        news = {robot: it.named() for robot, it in all_news.items()}
        heard = entered | set(motions)
        entered |= self._compare(news, motions)
        with self._blaming(""):
            self.tally.choices = self._choose(news, motions, entered)
        for robot in sorted(set(motions) - entered):
            with self._blaming(robot):
                self._multiply(news[robot])
        aside = self._aside() if self.limits.sharpest else frozenset()
        for robot, evidence in news.items():
            with self._blaming(robot):
                self._hear(evidence, motions, heard)
                for relative in sorted(
                    evidence.relatives, key=lambda r: (r.subject, r.age, r.range, r.bearing, r.kind)
                ):
                    if relative.observer == robot and relative.subject in aside and robot in heard:
                        self._set_aside(relative, motions)
                    elif relative.observer == robot:
                        self._relate(relative, motions, heard)
        unclear: dict[str, list[Doubt]] = {}
        for robot, evidence in all_news.items():
            with self._blaming(robot):
                unclear[robot] = []
                clearly = self._identified(evidence, all_news, motions, unclear[robot]) if robot in heard else []
                likeliest = [max(doubt.values(), key=lambda it: it[0])[1] for doubt in unclear[robot]]
                self._hear(replace(evidence, relatives=(*clearly, *likeliest)), motions, heard)
                for relative in clearly:
                    self._relate(relative, motions, heard)
        for robot, doubts in unclear.items():
            with self._blaming(robot):
                for doubt in doubts:
                    self._take_in_the_mean(doubt, motions)

    def _hear(self, evidence: Evidence, motions: Mapping[str, Motion], heard: set[str]) -> None:
        """Hold all that a robot sees of its mates in a tick against where the joint has them, before any of it moves them."""
        robot, noise = evidence.robot, self.innovations.variance((evidence.robot, "relative"))
        if robot not in heard or robot in self._left_out or not self.knows(robot):
            return
        mates = {mate for mate in heard - {robot} if self.knows(mate)}
        seen = [it for it in evidence.relatives if it.observer == robot and it.subject in mates]
        found = [(it.subject, linearise(self.joint, it, motions).widened(noise)) for it in seen]
        self.offsets.hear(robot, self.joint, found)

    def _bounded(self, news: Mapping[str, Evidence], known: set[str]) -> dict[str, Evidence]:
        """The evidence of a tick, as much of it as its robots' sensors can know; `known` are the robots whose increments count."""
        bounded = {}
        for robot, it in news.items():
            with self._blaming(robot):
                increment = it.increment
                if robot in known:
                    learned = self.innovations.variance((robot, "increment"))
                    increment = self.limits.increment(robot, increment, learned, it.belief)
                relatives = tuple(
                    relative
                    if is_class(relative.subject)  # how far away it is depends on what it is
                    else self.limits.sighting(relative, self._distance(relative))
                    for relative in it.relatives
                )
                bounded[robot] = replace(it, increment=increment, relatives=relatives)
        return bounded

    def _identified(
        self, evidence: Evidence, news: Mapping[str, Evidence], motions: Mapping[str, Motion], unclear: list[Doubt]
    ) -> list[Relative]:
        """Of the unnamed sightings of a robot those that clearly are of a known subject, as sightings of it, the newest of each.

        What an observer sees in one frame, at one age, are different things. `unclear` gets those that may be of several, and which
        these are, where no clearer or newer one of the tick is of any of them. Of a frame with two of these it gets none: a liar could
        take all its mates along in one tick, before it is doubted.
        """
        observer, found, doubts = evidence.robot, dict[str, Relative](), list[tuple[float, Doubt]]()
        named = {it.subject for it in evidence.relatives if not is_class(it.subject)}
        unnamed = [it for it in evidence.relatives if is_class(it.subject) and it.observer == observer]
        unnamed = [it if it.mark is not None else replace(it, mark=number) for number, it in enumerate(unnamed)]
        ends = {robot: known.time for robot, known in self._known.items()} | {r: it.time for r, it in news.items()}
        moved = {robot: known.motion for robot, known in self._known.items()} | dict(motions)
        for age in sorted({it.age for it in unnamed}):
            frame = sorted((it for it in unnamed if it.age == age), key=lambda it: it.mark or 0)
            there = {observer} | {it.subject for it in evidence.relatives if it.age == age}
            subjects = sorted({*self._known, *self._seen} - there)
            candidates = []
            for it in frame:
                of = [
                    replace(it, subject=one, ahead=ends.get(one, evidence.time) - evidence.time)
                    for one in subjects
                    if could_be(it.subject, one)
                ]
                candidates.append({one.subject: self.limits.sighting(one, self._distance(one)) for one in of})
            odds: list[dict[str, float] | None] = [None] * len(frame)
            if self.knows(observer):
                odds = self.naming.judge(self.joint, frame, candidates, moved, self.knows)
            for it, its, share in zip(frame, candidates, odds, strict=True):
                taken = clear(share)
                self.tally.unnamed.append(Unnamed(observer, evidence.time, it.mark or 0, share, taken))
                if taken is not None and taken not in named:
                    found.setdefault(taken, its[taken])
                elif taken is None and share:
                    doubts.append((age, {one: (p, its[one]) for one, p in share.items()}))
        used = named | set(found)
        for age in sorted({age for age, _ in doubts}):
            fresh = [doubt for its_age, doubt in doubts if its_age == age and not used & set(doubt)]
            used |= {one for doubt in fresh for one in doubt}
            unclear += fresh if len(fresh) == 1 else []
        return [found[subject] for subject in sorted(found)]

    def _take_in_the_mean(self, doubt: Doubt, motions: Mapping[str, Motion]) -> None:
        """Take a sighting of which it is not clear whose it is: the joint is the mean over all that it may be of, or nobody known.

        Mean and covariance are those of the mixture, so that the doubt widens what is believed (the probabilistic data association
        filter, Bar-Shalom and Tse, Automatica 11(5), 1975).
        """
        observer = next(iter(doubt.values()))[1].observer
        if observer in self._left_out or not all(self.knows(one) and one in {*motions, *self._seen} for one in doubt):
            return
        for _, relative in doubt.values():
            self.joint.begin(linearise(self.joint, relative, motions).priors)
        parts = []
        for share, relative in doubt.values():
            after = self.joint.copy()
            if relative.subject not in self._left_out and not self._contradict(observer, relative.subject):
                correct(after, linearise(after, relative, motions), self._moved_by(observer, relative.subject))
            parts.append((share, after))
        parts.append((max(0.0, 1.0 - sum(share for share, _ in parts)), self.joint.copy()))
        mean = sum((share * part.mean for share, part in parts), np.zeros_like(self.joint.mean))
        covariance = np.zeros_like(self.joint.covariance)
        for share, part in parts:
            covariance += share * (part.covariance + np.outer(part.mean - mean, part.mean - mean))
        self.joint.mean, self.joint.covariance = mean, 0.5 * (covariance + covariance.T)
        for _, relative in doubt.values():
            self._note_errors(relative)

    def _aside(self) -> frozenset[str]:
        """The objects that one robot alone has seen, but for the first `ALONE` of each robot."""
        observers, aside, number = self.trust.by_subject(), set[str](), Counter[str]()
        for name in self._seen:
            if len(of := observers.get(name, ())) == 1:
                number.update(of)
                if number[min(of)] > ALONE:
                    aside.add(name)
        return frozenset(aside)

    def _set_aside(self, relative: Relative, motions: Mapping[str, Motion]) -> None:
        """An object is where the newest sighting puts it, and that tells its observer nothing.

        Many objects that go where their observer goes would tell it, and its mates, that it stands.
        """
        observer, subject = relative.observer, relative.subject
        if observer in self._left_out or not relative.places:
            return
        place = self.projected(relative, motions.get(observer, Motion()))
        self.joint.drop(subject)
        self.joint.add(subject, place)
        self._seen[subject] = 0.0
        self._judge(Verdict(observer, subject, "relative", 0.0, 2, True))

    def _distance(self, relative: Relative) -> float:
        """How far away a subject is: as it was measured, or else as the joint has it; 0 where nobody knows."""
        ends = relative.observer, relative.subject
        if relative.kind != "bearing":
            return relative.range
        if not all(end in self.joint for end in ends):
            return 0.0
        one, other = (self.joint.mean[self.joint.blocks[end]][AXES] for end in ends)
        return float(np.hypot(*(one - other)))

    def _news(self, tick: int, reports: Iterable[Evidence]) -> dict[str, Evidence]:
        """One report per robot, of this tick and not of an epoch that is over, sorted by name."""
        news: dict[str, Evidence] = {}
        for evidence in sorted(reports, key=lambda e: (e.robot, e.epoch, e.tick)):
            known = self._known.get(evidence.robot)
            over = known is not None and evidence.epoch < known.epoch
            if (
                evidence.tick != tick
                or over
                or (evidence.robot in news and news[evidence.robot].epoch == evidence.epoch)
            ):
                self.tally.repeated += 1
            else:
                news[evidence.robot] = evidence
        return news

    def _aligned(self, news: dict[str, Evidence]) -> dict[str, Evidence]:
        """With the sightings of robots whose tick ended at another time than the observer's saying so."""
        ends = {robot: known.time for robot, known in self._known.items()} | {r: it.time for r, it in news.items()}
        if len(set(ends.values())) < 2:
            return news
        return {
            robot: replace(
                it,
                relatives=tuple(replace(r, ahead=ends.get(r.subject, it.time) - it.time) for r in it.relatives),
            )
            for robot, it in news.items()
        }

    def _predict(self, dt: float, news: Mapping[str, Evidence]) -> dict[str, Motion]:
        """Move every robot that is known and was heard by all that it has travelled since; let biases and objects drift."""
        motions = {}
        for robot, evidence in news.items():
            known = self._known.get(robot)
            if robot not in self.joint or known is None or known.epoch != evidence.epoch:
                continue
            with self._blaming(robot):
                motions[robot] = evidence.travelled.since(known.travelled)
                drive(self.joint, robot, motions[robot], evidence.nuisance)
                self.limits.drive(robot, motions[robot], evidence.nuisance)
        self._forget_errors(dt)
        self.offsets.pass_time(dt)
        self.elapsed += dt
        for name in self._seen:
            self._shift(name, self.walks.pass_time(name, self.objects.drift_of(name), dt, self.objects.model_of(name)))
            self._seen[name] += dt
        return motions

    def _shift(self, subject: str, way: Moments) -> None:
        """An object goes a way, shape (2,), whose covariance is (2, 2)."""
        self.joint.move(subject, self.joint.moments(subject).mean + way.mean, np.eye(2), way.covariance)

    def _enter(self, evidence: Evidence) -> bool:
        """A robot enters with its first-hand belief, once per epoch: what it adds later are increments.

        A new epoch rests on new evidence alone, so its belief is independent of everything in the joint. A robot that is
        not in the joint though its epoch is not new (a board that was restarted) enters in the same way. What was learned of a robot
        stays: who could begin with a clean record would do so after each lie.
        """
        robot, known = evidence.robot, self._known.get(evidence.robot)
        if known is None or known.epoch < evidence.epoch:
            self._known[robot] = Known(evidence.epoch, evidence.travelled)
            self._drop(robot)
            self.contacts.begin(robot)
        if robot in self.joint or evidence.belief is None:
            return False
        self.joint.add(robot, self.limits.entering(robot, evidence.belief))
        return True

    def _leave_out(self, robots: frozenset[str]) -> None:
        """From now on, take nothing of these robots; the objects that one newly left out has seen enter again without it."""
        for robot in sorted(robots - self._left_out):
            for name in [name for name in self._seen if robot in self.trust.observers(name)]:
                self._drop(name)
                self.trust.forget(name)
                self.walks.forget(name)
                del self._seen[name]
        self._left_out = robots

    def _compare(self, news: Mapping[str, Evidence], motions: Mapping[str, Motion]) -> set[str]:
        """Hold the robots' first-hand beliefs against each other, about themselves and all that they saw.

        Two robots that agreed and now contradict each other have spoilt each other's place in the joint: both enter again by
        their first-hand beliefs, of which only half counts. So does a robot that is no longer contradicted: its place in the joint
        rests on what was, nobody has corrected it since, and `trust` judged it by that place. Who entered is returned.
        Of who is refuted here nothing counts from this tick on: its mates have just become less sure of their places.
        """
        said: dict[str, dict[str, Claim]] = {}
        for robot, evidence in news.items():
            if evidence.belief is None or np.trace(evidence.belief.covariance[AXES, AXES]) > KNOWN:
                continue
            with self._blaming(robot):
                self.contacts.correct(robot, evidence.belief, evidence.increment)
                if self.contacts.is_reckoned(robot):
                    continue
                own = evidence.belief
                said.setdefault(robot, {})[robot] = Claim(own.mean[AXES], own.covariance[AXES, AXES], np.zeros((2, 2)))
                for relative in evidence.relatives:
                    if relative.observer == robot and relative.subject != robot and relative.places:
                        claim = claimed(own, relative, motions.get(robot))
                        said.setdefault(relative.subject, {})[robot] = claim
        parted: set[str] = set()
        for _, by_source in sorted(said.items()):
            parted |= self.contacts.judge(by_source)
        refuted = self.contacts.left_out() if parted or self._refuted else frozenset()
        self._leave_out(self._left_out | refuted)
        back = self._refuted - refuted
        back = frozenset(robot for robot in back if robot in said.get(robot, {}))
        self._refuted -= back
        for robot in sorted(back):
            self.trust.forget(robot)
            self.offsets.forget(robot)
        again = {robot for robot in parted | back if robot in self.joint}
        for robot in sorted(again):
            self._drop(robot)
            belief = news[robot].belief
            assert belief is not None
            entering = self.limits.entering(robot, belief)
            self.joint.add(robot, Moments(entering.mean, AGAIN * entering.covariance))
        return again

    def _choose(
        self, news: Mapping[str, Evidence], motions: Mapping[str, Motion], entered: set[str]
    ) -> dict[str, Choice]:
        """For each robot whose place some evidence contradicts: who is believed about it.

        Where a coalition of the evidence wins over the prediction (the robot was carried away, or entered with a lie), its place
        is forgotten.
        """
        found = {}
        heard = entered | set(motions)
        made: dict[int, Factor | None] = {}  # by the id of a piece of evidence, of the joint as it is
        for robot in sorted(heard):
            pieces = self._pieces(robot, news, heard, entered) if self.knows(robot) else {}
            if len(pieces) < 2:
                continue
            factors = self._factors(robot, pieces, motions, made)
            if not any(self._is_doubtful(factor) for factor in factors.values()):
                continue
            said = {source: about(self.joint, robot, piece, motions) for source, piece in pieces.items()}
            opinions = {source: place for source, place in said.items() if place is not None}
            if len(opinions) > 1:
                predicted = self.marginal(robot)
                choice = choose({PREDICTION: predicted, **opinions}, self.rule)
                if choice.outvoted and not self._is_refuted([factors[name] for name in sorted(choice.members)]):
                    continue  # what they say agrees with the prediction once the errors that they share are counted
                found[robot] = choice
                if choice.outvoted:
                    away = [opinions[name].mean - predicted.mean for name in choice.members]
                    self._widen(robot, float(np.hypot(*np.mean(away, axis=0))))
                    made.clear()
                    self.trust.forget(robot)
                    self.offsets.forget(robot)
                    self.tally.outvoted += 1
        return found

    def _factors(
        self,
        robot: str,
        pieces: Mapping[str, Increment | Relative],
        motions: Mapping[str, Motion],
        made: dict[int, Factor | None],
    ) -> dict[str, Factor]:
        """The factors of pieces of evidence, by source, without those that say nothing; what is made already is taken from there."""
        for piece in pieces.values():
            if id(piece) in made:
                continue
            if isinstance(piece, Relative):
                made[id(piece)] = linearise(self.joint, piece, motions)
            else:
                made[id(piece)] = likelihood(self.joint, robot, piece)
        found = {source: made[id(piece)] for source, piece in pieces.items()}
        return {source: factor for source, factor in found.items() if factor is not None}

    def _pieces(
        self, robot: str, news: Mapping[str, Evidence], heard: set[str], entered: set[str]
    ) -> dict[str, Increment | Relative]:
        """The evidence about a robot's place, by its source: the robot itself, or the other end of a sighting."""
        found: dict[str, Increment | Relative] = {}
        for evidence in news.values():
            for relative in evidence.relatives:
                ends = {relative.observer, relative.subject}
                if relative.observer != evidence.robot or robot not in ends or len(ends) < 2 or ends & self._left_out:
                    continue
                (other,) = ends - {robot}
                if other in heard and self.knows(other) and (relative.places or other not in found):
                    found[other] = relative
        own = news[robot].increment
        if own is not None and robot not in entered:
            found[robot] = own
        return found

    def _is_doubtful(self, factor: Factor) -> bool:
        """Whether a piece of evidence hardly agrees with what is predicted."""
        found = self.joint.innovation(factor)
        return found.squared > quantile(DOUBT, found.freedom)

    def _is_refuted(self, factors: list[Factor]) -> bool:
        """Whether some evidence together is beyond the 99.9 % quantile, all that its errors share in the joint considered."""
        found = self.joint.innovation(*factors)
        return found.squared > wilson_hilferty(GATE, found.freedom)

    def _outvoted(self, robot: str, source: str) -> tuple[str, ...]:
        """The members of the coalition that is believed about a robot's place, where a source is not among them."""
        choice = self.tally.choices.get(robot)
        if choice is None or len(choice.members) < 2 or source in choice.members:
            return ()
        return tuple(sorted(choice.members))

    def _contradict(self, observer: str, subject: str) -> bool:
        """Whether two robots contradict each other first-hand, and no coalition that contradicts one of them is believed."""
        if not self.contacts.contradict(observer, subject):
            return False
        for robot, source in ((subject, observer), (observer, subject)):
            choice = self.tally.choices.get(robot)
            if choice is not None and choice.outvoted and source in choice.members:
                return not all(self.contacts.contradict(robot, member) for member in choice.members - {robot})
        return True

    def _drop(self, subject: str) -> None:
        """Forget a subject, and the lasting errors of what it saw and of sightings of it."""
        for block in list(self.joint.blocks):
            if block == subject or (isinstance(block, tuple) and subject in block[1:3]):
                self.joint.drop(block)
                if isinstance(block, tuple):
                    del self._used[block[1]][block]

    def _multiply(self, evidence: Evidence) -> None:
        """Take an increment into the joint, if the gate lets it through."""
        robot = evidence.robot
        factor = None if evidence.increment is None else likelihood(self.joint, robot, evidence.increment)
        if factor is None:
            return
        factor, squared = self._weighed((robot, "increment"), factor)
        by, freedom = self._outvoted(robot, robot), len(factor.residual)
        taken = squared <= quantile(GATE, freedom) and not by
        self._judge(Verdict(robot, robot, "increment", squared, freedom, taken, by))
        if taken:
            correct(self.joint, factor, self._moved_by(robot))
        left_out = 0 if taken else self._known[robot].left_out + 1
        if left_out >= PATIENCE:
            self._widen(robot)
            left_out = 0
        self._known[robot] = replace(self._known[robot], left_out=left_out)

    def _moved_by(self, *robots: str) -> list[Block] | None:
        """What evidence about some robots moves: places and lasting errors of those whose sightings are doubted; None: all."""
        doubted = {robot for robot in robots if self.offsets.doubts(robot)}
        if not doubted:
            return None
        return [it for it in self.joint.blocks if (it[1] if isinstance(it, tuple) else it) in doubted]

    def _weighed(self, source: Source, factor: Factor) -> tuple[Factor, float]:
        """A factor with the noise that its source's evidence has shown to have, and the squared distance of that."""
        self.innovations.judge(source, self.joint.innovation(factor).squared, len(factor.residual))
        factor = factor.widened(self.innovations.variance(source))
        return factor, self.joint.innovation(factor).squared

    def _widen(self, robot: str, away: float = 0.0) -> None:
        """Widen position and heading of a robot that may have moved, by `away` (unit) or so, as its odometry did not measure."""
        block = self.joint.moments(robot)
        noise = np.zeros((STATES, STATES))
        position, heading = WIDENED
        noise[AXES, AXES] = position**2 * block.covariance[AXES, AXES] + away**2 * np.eye(2)
        noise[HEADING, HEADING] = heading**2
        self.joint.move(robot, block.mean, np.eye(STATES), noise)

    def _relate(self, relative: Relative, motions: Mapping[str, Motion], heard: set[str]) -> None:
        """Take a relative belief into the joint; an object of which nothing is known enters with its first sighting."""
        observer, subject = relative.observer, relative.subject
        robot = subject.startswith("robot/")
        if observer not in heard or subject == observer or (robot and subject not in self.joint):
            return
        if subject not in self.joint and observer in self._left_out:
            return
        if not relative.places and not (self.knows(observer) and self.knows(subject)):
            self.tally.silent += 1
            room = subject in self.rings or len(self.rings) < MAX_RINGS
            if not robot and subject not in self.joint and self.knows(observer) and room:
                ring = self.rings.setdefault(subject, Ring(self.drift_of(subject)))
                ring.add(line_of(self.joint.moments(observer), relative, motions.get(observer), self.elapsed))
            return
        if robot and subject not in heard:
            known = self._known[subject]
            if not 0.0 <= relative.age + relative.ahead <= known.motion.dt:  # how far it had moved then is not known
                self.tally.silent += 1
                return
            motions = {**motions, subject: known.motion}
        factor = linearise(self.joint, relative, motions)
        if not robot and observer not in self._left_out and len(factor.residual) >= 2:  # a range alone is no place
            pushed = self.walks.judge(subject, self._placed(subject, factor))
            if pushed is not None and subject in self.joint:
                self._shift(subject, pushed)
                factor = linearise(self.joint, relative, motions)
        factor, squared = self._weighed((observer, "relative"), factor)
        by = self._outvoted(subject, observer) or self._outvoted(observer, subject)
        freedom = len(factor.residual)
        agrees = squared <= quantile(GATE, freedom) and not by and not self._contradict(observer, subject)
        if (
            not robot
        ):  # of two robots that contradict each other, the one that placed the object first is believed about it
            agrees = agrees and not any(self.contacts.contradict(observer, o) for o in self.trust.observers(subject))
        taken = agrees and not {observer, subject} & self._left_out
        if relative.mark is None and (taken or subject in self.joint):  # a wrong name is held against nobody
            self.trust.judge(observer, subject, agrees)
        self._judge(Verdict(observer, subject, "relative", squared, freedom, taken, by))
        if taken:
            correct(self.joint, factor, self._moved_by(observer, subject))
            self._note_errors(relative)
            if not robot:
                self._seen[subject] = 0.0

    def _placed(self, subject: str, factor: Factor) -> Moments:
        """Where a sighting alone puts an object, shape (2,) and (2, 2): all that its observer is unsure of is counted."""
        rows = dict(factor.jacobians)
        by = rows.pop(subject)
        before = self.joint.moments(subject) if subject in self.joint else factor.priors[subject]
        spread = self.joint.innovation(replace(factor, jacobians=rows)).covariance
        weighed = by.T @ np.linalg.inv(spread)
        covariance = np.linalg.inv(weighed @ by)
        return Moments(before.mean + covariance @ weighed @ factor.residual, covariance)

    def _note_errors(self, relative: Relative) -> None:
        """The lasting errors of a sighting were of use; of an observer's those that were not for the longest go first."""
        used = self._used.setdefault(relative.observer, {})
        for block in relative.blocks():
            used.pop(block, None)
            used[block] = 0.0
        for block in list(used)[:-MAX_ERRORS]:
            self.joint.drop(block)
            del used[block]

    def _forget_errors(self, dt: float) -> None:
        """Let all lasting errors forget for `dt` seconds, and drop those of which nothing is left to know."""
        forget_biases(self.joint, dt)
        for used in self._used.values():
            for block in list(used):
                used[block] += dt
                if used[block] > FADED * block[3]:
                    self.joint.drop(block)
                    del used[block]

    @contextmanager
    def _blaming(self, robot: str) -> Iterator[None]:
        """Degenerate: after what a robot says the joint is none any more, or absurd; whose block is absurd is to blame."""
        try:
            yield
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise Degenerate(robot, f"what {robot} says leaves no Gaussian that can be kept: {error}") from error
        variances = self.joint.covariance.diagonal()
        bad = ~((variances >= 0) & (variances <= ABSURD) & (np.abs(self.joint.mean) <= ABSURD))
        if bad.any():
            (owner,) = (b for b, place in self.joint.blocks.items() if place.start <= int(bad.argmax()) < place.stop)
            owner = owner[1] if isinstance(owner, tuple) else owner
            robot = owner if owner in self._known else robot
            raise Degenerate(robot, f"what {robot} says leaves a state that is absurd")

    def _judge(self, verdict: Verdict) -> None:
        self.tally.verdicts.append(verdict)
        self.tally.gated += not verdict.taken

    def _forget_objects(self) -> None:
        """Drop the objects that were not sighted for long, and those that most observers see elsewhere."""
        gone = [n for n, age in self._seen.items() if age > self.objects.kept or self.trust.misplaced(n)]
        for name in gone:
            self._drop(name)
            self.trust.forget(name)
            self.walks.forget(name)
            del self._seen[name]

    def _close_rings(self) -> None:
        """Let an object enter once its rings and rays leave one place; its error is then taken for independent of all others."""
        for subject, ring in list(self.rings.items()):
            places = ring.places() if ring.newest == self.elapsed else ()
            if subject in self.joint or self.elapsed - ring.newest > self.objects.kept:
                del self.rings[subject]
            elif places and places[0].weight > SURE:
                self.joint.add(subject, places[0].moments)
                self._seen[subject] = 0.0
                del self.rings[subject]

    def projected(self, relative: Relative, motion: Motion) -> Moments:
        """Where a sighting puts its subject, of which nothing else is known: mean, shape (2,), and covariance, shape (2, 2).

        `motion` is the observer's in the tick. KeyError: the observer is not in the joint.
        """
        claim = claimed(self.joint.moments(relative.observer), relative, motion)
        return Moments(claim.mean, claim.lasting + claim.fresh)

    # --- out ------------------------------------------------------------------------------------------------------------

    def subjects(self) -> list[str]:
        """All robots and objects whose position is known, sorted, without the robots that are left out.

        Where such a robot is, the joint has from itself alone, and the others contradict it.
        """
        names = [b for b in self.joint.blocks if isinstance(b, str)]
        return sorted(n for n in names if self.knows(n) and n not in self._left_out)

    def doubtful(self) -> dict[str, tuple[Place, ...]]:
        """Of the objects that are not in the joint, those that are in one of a few places, as two rings leave them."""
        found = {subject: ring.places() for subject, ring in sorted(self.rings.items())}
        return {subject: places for subject, places in found.items() if places}

    def knows(self, subject: str) -> bool:
        """Whether the joint holds a position of the subject that is not flat."""
        if subject not in self.joint:
            return False
        x, covariance = self.joint.blocks[subject].start, self.joint.covariance
        return bool(covariance[x, x] + covariance[x + 1, x + 1] < KNOWN)

    def marginal(self, subject: str) -> Moments:
        """Mean and covariance of a subject's position; KeyError where it is not in the joint."""
        block = self.joint.moments(subject)
        return Moments(block.mean[AXES], block.covariance[AXES, AXES])

    def ahead(self, robot: str, age: float) -> Moments | None:
        """Where a robot that was heard last some seconds ago is if it goes on: as fast as lately, and turning as in its last motion.

        None of what is no robot, and of one that has told no motion. KeyError where it is not in the joint.
        """
        known = self._known.get(robot)
        if known is None or known.motion.dt <= 0:
            return None
        lately, last = age / known.lately.dt, age / known.motion.dt
        even = known.lately.times(lately)
        turning = replace(even, turn=last * known.motion.turn, driven=last * known.motion.driven)
        # an error of the speed lasts for all of the way that is told by it
        along = lately * even.along + (UNSTEADY * even.distance) ** 2
        alone = Joint()
        alone.add(robot, self.joint.moments(robot))
        drive(
            alone,
            robot,
            replace(turning, along=along, across=even.across + (UNSTEADY * even.distance) ** 2),
            Nuisance(),
        )
        after = alone.moments(robot)
        return Moments(after.mean[AXES], after.covariance[AXES, AXES])

    def velocity(self, subject: str) -> Moments | None:
        """Velocity (unit / s), and of a robot its rate of turn (rad / s), shape (3,); of an object that rolls shape (2,)."""
        known = self._known.get(subject)
        if known is not None and subject in self.joint:
            return speed(self.joint.moments(subject), known.motion)
        return self.walks.velocity(subject) if subject in self.joint else None

    def drift_of(self, subject: str) -> float:
        """The random walk of an object (unit / sqrt(s)), as its sightings show it."""
        return self.walks.drift(subject, self.objects.drift_of(subject))

    def pose(self, robot: str) -> Moments:
        """The whole block of a robot, shape (12,) and (12, 12): where its first-hand filter may linearise."""
        return self.joint.moments(robot)

    def drawn(self, subject: str, grid: Grid) -> Belief:
        """The marginal on the team's grid."""
        return draw(grid, self.marginal(subject))


@lru_cache(maxsize=256)  # what rests on first-hand evidence alone is the same in all joints of one process
def claimed(observer: Moments, relative: Relative, motion: Motion | None) -> Claim:
    """Where a sighting that places its subject puts it, by an observer's block and its motion in the tick."""
    alone = Joint()
    alone.add(relative.observer, observer)
    seen = linearise(alone, relative, {} if motion is None else {relative.observer: motion})
    rows = dict(seen.jacobians)
    back = np.linalg.inv(rows.pop(relative.subject))  # of nothing known, the sighting alone decides
    lasting = alone.innovation(replace(seen, jacobians=rows, noise=np.zeros((2, 2)))).covariance
    place = seen.priors[relative.subject].mean + back @ seen.residual
    return Claim(place, back @ lasting @ back.T, back @ seen.noise @ back.T)
