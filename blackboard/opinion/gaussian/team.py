"""The joint belief of a team: robots with their lasting errors, and objects. Increments in, marginals out.

Each tick is settled once with all evidence that came in time, in an order that depends on names only: so the order of
arrival changes nothing. What was settled is never taken again (`_news`): a repeated report is ignored, a lost one loses
its evidence, and no evidence is counted twice.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.cameras import by_mates, scaled
from blackboard.opinion.gaussian.choosing import choose_evidence
from blackboard.opinion.gaussian.comparing import compare, enter, multiply, take_compass
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.evidence import Evidence, Verdict, end_of_tick
from blackboard.opinion.gaussian.finding import predict_entered, widen_priors
from blackboard.opinion.gaussian.identifying import Doubt, identified, take_in_the_mean
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.late import with_way
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.rings import RingPlace
from blackboard.opinion.gaussian.sightings import batches, close_rings, see, seen_by_one
from blackboard.opinion.gaussian.state import Known, TeamState
from blackboard.opinion.gaussian.tracking import end_tick, pass_absent
from blackboard.opinion.gaussian.vehicle import AXES, FLAT, LATELY, STATES, UNSTEADY, Motion, Nuisance, drive, speed
from blackboard.opinion.grid import Grid

TIMED = 1e-3  # seconds: how exactly the times of sightings and motions are known
OFTEN = 1.5  # A sighting waits only for a subject whose ticks are at most so many times as long as the observer's.


@dataclass
class TeamJoint(TeamState):
    """Mutable; `settle` once per tick."""

    _doubted: frozenset[str] = frozenset()  # who was a tick ago
    _unbelieved: frozenset[tuple[str, str]] = frozenset()  # `_unbelieved_now` of the last tick
    _disputed: frozenset[str] = frozenset()  # objects that two equally large groups saw at two places a tick ago

    def settle(self, tick: int, dt: float, reports: Iterable[Evidence]) -> list[Verdict]:
        """Take the evidence of one tick of `dt` seconds; a tick that is settled already changes nothing.

        Where a robot is found out to keep one side, or to tell nothing new, what it has moved is taken back. Who keeps one side may
        be turned, or its wheels measure nothing: its odometry is not believed for now (`distrust`). Taken back is also what it has
        moved an object that more robots see elsewhere, or that it alone has led farther than that goes. What an object has moved is
        taken back where a dispute about it begins, and what two robots have moved each other that keep seeing each other aside.

        Degenerate: some evidence leaves no Gaussian that can be kept. The team is in no defined state then.
        """
        if tick <= self.tick:
            self.tally.repeated += sum(1 for _ in reports)
            return []
        self._settle(tick, dt, self._aligned(self._news(tick, reports)))
        doubted = frozenset(robot for robot in self.known if self.doubts(robot))
        for robot in sorted(doubted - self._doubted):
            self._take_back(robot)
        self._doubted = doubted
        unbelieved = self._unbelieved_now()
        for robot, subject in sorted(unbelieved - self._unbelieved):
            self.influence.take_back(self.joint, robot, subject)
        self._unbelieved = unbelieved
        disputed = {subject: camps for subject in self.disputes.disputed() if (camps := self.disputing(subject))}
        for subject in sorted(disputed.keys() - self._disputed):
            self.influence.take_back(self.joint, subject, told_by=frozenset().union(*disputed[subject]))
        self._disputed = frozenset(disputed)
        return self.tally.verdicts

    def _unbelieved_now(self) -> frozenset[tuple[str, str]]:
        """Pairs of robot and object: it is outvoted about the object's place, or moved it too far while no other saw it.

        And two robots that keep seeing each other aside, in both directions.
        """
        outvoted = (
            (robot, subject)
            for subject in self.disputes.disputed()
            for robot in self.disputes.seeing(subject)
            if self.is_heard(robot) and self.majority(robot, subject) < 0
        )
        apart = self.offsets.apart
        return (
            frozenset(outvoted)
            | self.disputes.led()
            | {both for one, other in apart for both in ((one, other), (other, one))}
        )

    def _take_back(self, robot: str) -> None:
        """What a robot has moved is where it was without it, and how the objects move that it saw is to be learned anew."""
        self.influence.take_back(self.joint, robot)
        if self.offsets.doubts(robot) and self.offsets.aims and robot in self.joint:
            self.distrust.begin(robot)
        self.offsets.forget_scores()
        for subject in self.trust.judged(robot) & set(self.seen):
            self.walks.forget(subject)

    def _settle(self, tick: int, dt: float, news: dict[str, Evidence]) -> None:
        self.tick = tick
        self.tally.verdicts, self.tally.unnamed, self.tally.tracks = [], [], Counter()
        refuted = self.refuted_now()
        self.refuted |= refuted
        self.leave_out(self.trust.left_out() | refuted)
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            self._take(dt, news)
        for robot, evidence in news.items():
            known = self.known[robot]
            motion = evidence.travelled.since(known.travelled).after(known.motion, evidence.time - known.time)
            predict_entered(self, robot, motion, evidence.nuisance)
            lately = known.lately.times(math.exp(-motion.dt / LATELY)).plus(motion)
            told = evidence.travelled, known.left_out, motion, lately, evidence.time, evidence.nuisance, evidence.camera
            self.known[robot] = Known(known.epoch, *told, known.turned)
        for robot in news:
            if robot in self.distrust and self.knows(robot):
                with self.blaming(robot):
                    self.distrust.judge(robot, self.joint.moments(robot), self.speeds.usual(robot))
        widen_priors(self)
        self._widen_strayed()
        self.forget_objects()
        end_tick(self)
        close_rings(self)
        self.joint.gather()

    def _widen_strayed(self) -> None:
        """Widen the pose of who has strayed, by no more than the width of the map."""
        unheard = {robot for robot in self.known if not self.is_heard(robot) or robot in self.distrust}
        for robot, away in self.strayed.end_tick(len(self.known), unheard).items():
            if self.knows(robot):
                self.widen(robot, min(away, math.sqrt(self.naming.area)))
                self.distrust.begin(robot)
                self.trust.forget(robot)
                self.offsets.forget(robot)

    def _take(self, dt: float, news: Mapping[str, Evidence]) -> None:
        self.limits.pass_time(dt)
        observers = self.trust.by_subject()
        walking = {name for name in self.seen if self.walks_as_told(name) and len(observers.get(name, ())) > 1}
        self.influence.pass_time(dt, walking)
        motions = self._predict(dt, news)
        entered = {robot for robot, evidence in news.items() if enter(self, evidence)}
        all_news = {
            robot: replace(evidence, relatives=tuple(with_way(self, relative) for relative in evidence.relatives))
            for robot, evidence in self._bounded(news, set(motions) - entered).items()
        }
        news = {robot: evidence.named() for robot, evidence in all_news.items()}
        heard = entered | set(motions)
        entered |= compare(self, news, motions)
        with self.blaming(""):
            self.tally.choices = choose_evidence(self, news, motions, entered)
        for robot in sorted(set(motions) - entered):
            with self.blaming(robot):
                take_compass(self, news[robot])
                multiply(self, news[robot])
        apart = seen_by_one(self) if self.limits.sharpest else frozenset()
        # Only where the sightings of each robot are taken alone is it known what it moves.
        alone = self.influence.is_counted(len(self.known))
        for part in ([evidence] for evidence in news.values()) if alone else batches(news.values()):
            see(self, part, motions, heard, apart=apart)
        self._take_unnamed(all_news, motions, heard)

    def _take_unnamed(self, news: Mapping[str, Evidence], motions: Mapping[str, Motion], heard: set[str]) -> None:
        unclear: dict[str, list[Doubt]] = {}
        for robot, evidence in news.items():
            if evidence.named() is evidence and not any(self.tracks):
                continue
            with self.blaming(robot):
                unclear[robot] = []
                clearly = identified(self, evidence, news, motions, unclear[robot]) if robot in heard else []
                likeliest = [max(doubt, key=lambda option: option[0])[1] for doubt in unclear[robot]]
                see(self, [replace(evidence, relatives=tuple(clearly))], motions, heard, likeliest)
        for robot, doubts in unclear.items():
            with self.blaming(robot):
                for doubt in doubts:
                    take_in_the_mean(self, doubt, motions)

    def _bounded(self, news: Mapping[str, Evidence], known: set[str]) -> dict[str, Evidence]:
        """The evidence of a tick, as much of it as its robots' sensors can know; `known` are the robots whose increments count."""
        if not self.limits.sharpest:
            return dict(news)
        bounded = {}
        for robot, evidence in news.items():
            with self.blaming(robot):
                increment = evidence.increment
                if robot in known:
                    self.limits.on_compass(robot, evidence.compass)
                    learned = self.innovations.variance((robot, "increment"))
                    gained = self.limits.without_echo(robot, increment, evidence.belief)
                    if gained is not increment:
                        self.add_verdict(Verdict(robot, robot, "echo", 0.0, 1, taken=False))
                    increment = self.limits.increment(robot, gained, learned, evidence.belief)
                relatives = tuple(
                    relative
                    if is_class(relative.subject)  # how far away it is depends on what it is
                    else self.limits.sighting(relative, self.distance(relative))
                    for relative in evidence.relatives
                )
                bounded[robot] = replace(evidence, increment=increment, relatives=relatives)
        return bounded

    def _news(self, tick: int, reports: Iterable[Evidence]) -> dict[str, Evidence]:
        """One report per robot, of this tick and not of an epoch that is over, sorted by name."""
        news: dict[str, Evidence] = {}
        for evidence in sorted(reports, key=lambda e: (e.robot, e.epoch, e.tick)):
            known = self.known.get(evidence.robot)
            over = known is not None and known.is_over(evidence.epoch, evidence.time)
            if (
                evidence.tick != tick
                or over
                or (evidence.robot in news and news[evidence.robot].epoch == evidence.epoch)
            ):
                self.tally.repeated += 1
            else:
                news[evidence.robot] = evidence
        return {robot: self._by_mates(evidence) for robot, evidence in news.items()}

    def _by_mates(self, evidence: Evidence) -> Evidence:
        """The same, with sightings scaled by what robots of one make know of their cameras' noise (`cameras`)."""
        own, nuisance = evidence.camera, evidence.nuisance
        if own is None or not nuisance.alike:
            return evidence
        mates = [
            known.camera
            for robot, known in sorted(self.known.items())
            if known.camera is not None and known.nuisance == nuisance and robot not in {evidence.robot, *self.left_out}
        ]
        by = by_mates(own, mates, nuisance.alike)
        if by == (1.0, 1.0):
            return evidence
        return replace(evidence, relatives=tuple(scaled(relative, *by) for relative in evidence.relatives))

    def _aligned(self, news: dict[str, Evidence]) -> dict[str, Evidence]:
        """With the sightings of robots whose tick ended at another time than the observer's saying so, but for those that wait."""
        ends = {robot: known.time for robot, known in self.known.items()} | {
            r: evidence.time for r, evidence in news.items()
        }
        if len(set(ends.values())) < 2 and not self.early:
            return news
        return {robot: self._without_early(evidence, ends, news) for robot, evidence in news.items()}

    def _without_early(self, evidence: Evidence, ends: Mapping[str, float], news: Mapping[str, Evidence]) -> Evidence:
        """Without sightings of robots that tell later how they moved until then: those come with the observer's next evidence.

        Who tells its motion less often than the observer is not waited for.
        """
        robot, now = evidence.robot, evidence.time
        known, (then, early) = self.known.get(robot), self.early.pop(robot, (now, ()))
        since = now - known.time if known is not None and known.epoch == evidence.epoch else 0.0
        relatives = [replace(r, age=r.age + now - then) for r in early] if since > 0 else []
        waiting = list[Relative]()
        for relative in evidence.relatives:
            subject = self.known.get(relative.subject)
            is_early = ends.get(relative.subject, now) < now - relative.age - TIMED
            waits = (
                is_early and relative.subject not in news and subject is not None and subject.motion.dt <= OFTEN * since
            )
            (waiting if waits else relatives).append(relative)
        if waiting:
            self.early[robot] = now, tuple(waiting)
        end = end_of_tick(news.values())
        return replace(evidence, relatives=tuple(replace(r, ahead=ends.get(r.subject, end) - now) for r in relatives))

    def _predict(self, dt: float, news: Mapping[str, Evidence]) -> dict[str, Motion]:
        """Move every robot that is known and was heard by all that it has travelled since; let biases and objects drift."""
        motions = {}
        for robot, evidence in news.items():
            known = self.known.get(robot)
            if robot not in self.joint or known is None or known.epoch != evidence.epoch:
                continue
            with self.blaming(robot):
                motion = evidence.travelled.since(known.travelled)
                unheard = motion.unheard(motion.dt - (known.motion.dt or motion.dt))
                since = evidence.time - known.time
                seconds = min((span for span in (motion.dt, since) if span > 0), default=0.0)
                pose = self.joint.moments(robot).covariance
                told, usual = self.speeds.on_motion(robot, unheard, seconds, pose), self.speeds.usual(robot)
                believed = self.distrust.on_motion(robot, told, max(dt, since), evidence.nuisance, usual)
                motions[robot] = believed.after(known.motion, since)
                drive(self.joint, robot, motions[robot], evidence.nuisance)
                self.limits.drive(robot, motions[robot], evidence.nuisance)
        self.forget_errors(dt)
        self.trust.pass_time(dt)
        self.contacts.pass_time(dt)
        self.offsets.pass_time(dt)
        self.freshness.pass_time(dt)
        self.disputes.pass_time(dt)
        self.tracks.pass_time(dt)
        pass_absent(self, dt)
        self.elapsed += dt
        for name in self.seen:
            self.pass_object(name, dt)
            self.seen[name] += dt
        return motions

    # --- out ---

    def subjects(self) -> list[str]:
        """All robots and objects whose position is known, sorted, without the robots that are left out, and tracks that are not sure.

        Where such a robot is, the joint has from itself alone, and the others contradict it.
        """
        names = [b for b in self.joint.blocks if isinstance(b, str) and self.knows(b) and b not in self.left_out]
        return sorted(b for b in names if b not in self.tracks or self.tracks.is_told(b))

    def anywhere(self) -> list[str]:
        """The named objects, sorted, that the joint knew a place of, and whose variance has since grown beyond `KNOWN`."""
        lost = [name for name in self.seen if not (name in self.tracks or self.knows(name))]
        return sorted(name for name in lost if np.trace(self.marginal(name).covariance) < FLAT)

    def doubtful(self) -> dict[str, tuple[RingPlace, ...]]:
        """Of the objects whose place is not known, those that are in one of a few places, as two rings leave them."""
        by_subject = {subject: ring.places() for subject, ring in sorted(self.rings.items())}
        return {subject: places for subject, places in by_subject.items() if places}

    def ahead(self, robot: str, age: float) -> Moments | None:
        """Where a robot that was heard last some seconds ago is if it goes on: as fast as lately, and turning as in its last motion.

        None of what is no robot, and of one that has told no motion. KeyError where it is not in the joint.
        """
        known = self.known.get(robot)
        if known is None or known.motion.dt <= 0:
            return None
        lately, last = age / known.lately.dt, age / known.motion.dt
        even = known.lately.times(lately)
        turning = replace(even, turn=last * known.motion.turn, driven=last * known.motion.driven)
        # an error of the speed lasts for all of the way that is told by it
        along = lately * even.along + (UNSTEADY * even.way) ** 2
        alone = Joint()
        alone.add(robot, self.joint.moments(robot))
        drive(alone, robot, replace(turning, along=along, across=even.across + (UNSTEADY * even.way) ** 2), Nuisance())
        after = alone.moments(robot)
        return Moments(after.mean[AXES], after.covariance[AXES, AXES])

    def velocity(self, subject: str) -> Moments | None:
        """Velocity (unit / s), and of a robot its rate of turn (rad / s), shape (3,); of an object that rolls shape (2,)."""
        known = self.known.get(subject)
        if known is not None and subject in self.joint:
            return speed(self.joint.moments(subject), known.motion)
        return self.walks.velocity(subject) if subject in self.joint else None

    def pose(self, robot: str) -> Moments:
        """The whole block of a robot, shape (12,) and (12, 12): where its first-hand filter may linearise."""
        return self.joint.moments(robot)

    def poses(self, robots: Sequence[str]) -> Moments:
        """Whole blocks of robots, shape (k, 12) and (k, 12, 12)."""
        index = self.joint.indices(robots, STATES)
        return Moments(self.joint.mean[index], self.joint.among_each(index))

    def drawn(self, subject: str, grid: Grid) -> Belief:
        """The marginal on the team's grid."""
        return draw(grid, self.marginal(subject))
