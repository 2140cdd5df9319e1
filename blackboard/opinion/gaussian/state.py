"""What a joint holds of a team, and the steps that change it in one place: robots and objects enter, are moved, widened, dropped."""

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from blackboard.errors import Degenerate
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.absent import Absent
from blackboard.opinion.gaussian.cameras import CameraFound
from blackboard.opinion.gaussian.coalitions import KNOWN
from blackboard.opinion.gaussian.contacts import Contacts
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.disputes import Disputes
from blackboard.opinion.gaussian.distrust import Distrust
from blackboard.opinion.gaussian.evidence import UnusedCounts, Verdict
from blackboard.opinion.gaussian.freshness import Freshness
from blackboard.opinion.gaussian.influence import Influence
from blackboard.opinion.gaussian.innovations import Innovations, Source
from blackboard.opinion.gaussian.joint import Block, Expected, Factor, Innovation, Joint, Moments, squared_distance
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.mounts import Beyond, Mount, north_of
from blackboard.opinion.gaussian.naming import Naming
from blackboard.opinion.gaussian.offsets import Offsets
from blackboard.opinion.gaussian.relation import BiasBlock, Relative, forget_biases
from blackboard.opinion.gaussian.rings import Ring
from blackboard.opinion.gaussian.speeds import Speeds
from blackboard.opinion.gaussian.strayed import Strayed
from blackboard.opinion.gaussian.tracks import Tracks
from blackboard.opinion.gaussian.trust import Trust
from blackboard.opinion.gaussian.vehicle import ANYWHERE, AXES, HEADING, STATES, Motion, Nuisance
from blackboard.opinion.gaussian.walks import LEAST, Model, Walks
from blackboard.opinion.grid import Array

ABSURD = 1e10  # of any variance: what is known of nothing has 1e6, and motion adds to that
MAX_ERRORS = 20  # lasting errors of one observer's sightings: those that were used last
FADED = 5.0  # time constants after which a lasting error that no sighting used is dropped: 0.7 % of it is left
# Sigmas added to a robot that may have moved: of the position, times its own; of the heading, radians.
WIDENED = (3.0, 0.3)


@dataclass(frozen=True)
class Objects:
    """How objects move: random walks (unit / sqrt(s)) before they are seen, then by a model. `kept`: seconds without a sighting."""

    drift: float = 0.5
    drifts: Mapping[str, float] = field(default_factory=dict)  # of those that move otherwise, by name, as `can`
    kept: float = 60.0
    model: Model = "learn"
    models: Mapping[str, Model] = field(default_factory=dict)  # of those that move otherwise, by name, as `can`

    def model_of(self, subject: str, kind: str = "") -> Model:
        """How an object, named as `object/can`, moves; or a track of a kind, as `object/ball?`: as a `ball`, or it rolls."""
        model = self.models.get(kind[:-1].partition("/")[2], "roll") if kind else self.model
        return self.models.get(subject.partition("/")[2], model)

    def drift_of(self, subject: str) -> float:
        """The configured drift of an object, such as `object/can`; one that stands still may be kicked all the same."""
        return max(self.drifts.get(subject.partition("/")[2], self.drift), LEAST * self.drift)


@dataclass(frozen=True)
class Known:
    """What is settled of a robot: its epoch, the sum of its motions, and how many increments in a row were left out.

    `left_out`, shape (3,), counts those that tell of x, of y, and of the heading. `turned` has the readings of its compass that were
    left out. `motion` is what was added to the sum last, until a team time (s), `lately` the same of the last seconds (`LATELY`).
    """

    epoch: int
    travelled: Motion
    left_out: Array = field(default_factory=lambda: np.zeros(HEADING + 1))
    motion: Motion = field(default_factory=Motion)
    lately: Motion = field(default_factory=Motion)
    time: float = 0.0
    nuisance: Nuisance = field(default_factory=Nuisance)
    camera: CameraFound | None = None  # its newest estimate of its camera's noise
    turned: Beyond | None = None

    def is_over(self, epoch: int, time: float) -> bool:
        """Whether evidence until a team time (s) is of an epoch that is over; where it is later, a clock was set back."""
        return epoch < self.epoch and time <= self.time


@dataclass
class TeamState(Copyable):
    """Mutable. Robots and objects are named as subjects: `robot/r1`, `object/ball`."""

    objects: Objects = field(default_factory=Objects)
    joint: Joint = field(default_factory=Joint)
    tally: UnusedCounts = field(default_factory=UnusedCounts)
    trust: Trust = field(default_factory=Trust)
    contacts: Contacts = field(default_factory=Contacts)
    innovations: Innovations = field(default_factory=Innovations)
    offsets: Offsets = field(default_factory=Offsets)
    influence: Influence = field(default_factory=Influence)
    freshness: Freshness = field(default_factory=Freshness)
    disputes: Disputes = field(default_factory=Disputes)
    strayed: Strayed = field(default_factory=Strayed)
    walks: Walks = field(default_factory=Walks)
    limits: Limits = field(default_factory=Limits)
    speeds: Speeds = field(default_factory=Speeds)
    distrust: Distrust = field(default_factory=Distrust)
    naming: Naming = field(default_factory=Naming)
    tracks: Tracks = field(default_factory=Tracks)
    # Where a board that began earlier has tracks, by their names there.
    called: Mapping[str, Moments] = field(default_factory=dict)
    # Named tracks when they were seen last, by name: to be found again.
    absent: dict[str, Absent] = field(default_factory=dict)
    rings: dict[str, Ring] = field(default_factory=dict)  # of objects of which only ranges or bearings alone are known
    elapsed: float = 0.0  # seconds that were settled
    rule: Coalition = field(default_factory=Coalition)  # chooses between evidence that contradicts each other
    tick: int = -1
    left_out: frozenset[str] = frozenset()  # robots that the majority contradicts, for now
    refuted: frozenset[str] = frozenset()  # robots that `contacts` has left out since they entered
    #: Robot -> states of its block whose prior was contradicted and replaced by a wide one (`priors`).
    widened: dict[str, tuple[int, ...]] = field(default_factory=dict)
    #: Robot that was dropped -> the errors that it had been found to have: state -> mean and variance.
    kept: dict[str, dict[int, tuple[float, float]]] = field(default_factory=dict)
    #: Robot -> its block when it entered; its lasting errors are predicted since then, as if nothing had been measured.
    entered: dict[str, Moments] = field(default_factory=dict)
    north: Mount = field(default_factory=north_of)  # the common error of all compasses
    compasses: dict[str, Mount] = field(default_factory=dict)  # of robots that tell readings: how they are mounted
    known: dict[str, Known] = field(default_factory=dict)
    first_entry: float | None = None  # `elapsed` when the first robot entered
    #: Team time (s) of the newest knowledge of an earlier joint that a robot has returned.
    returned_at: float = -math.inf
    #: Observer -> the end of its last tick (team time, s), and its sightings that wait until their subjects tell their motion.
    early: dict[str, tuple[float, tuple[Relative, ...]]] = field(default_factory=dict)
    seen: dict[str, float] = field(default_factory=dict)  # object -> seconds since it was sighted
    #: Observer -> the lasting errors of its sightings -> seconds since one with it was taken, the longest first.
    used: dict[str, dict[BiasBlock, float]] = field(default_factory=dict)

    def copy(self) -> Self:
        """The same, which may be changed without changing this one."""
        other = super().copy()
        other.rings = {subject: ring.copy() for subject, ring in self.rings.items()}
        other.used = {observer: dict(used) for observer, used in self.used.items()}
        other.compasses = {robot: mount.copy() for robot, mount in self.compasses.items()}
        return other

    def drop(self, subject: str, *, again: bool = False) -> None:
        """Forget a subject, and the lasting errors of its sightings and of those of it. If it enters `again`, its compass's stay.

        What was found of a robot's sensors is `kept`.
        """
        self.influence.drop(subject)
        self.strayed.forget(subject)
        if states := self.widened.pop(subject, ()):
            self.kept[subject] = {state: self.joint.moments(subject).of(state) for state in states}
        self.entered.pop(subject, None)
        kept = self.compasses[subject].block if again and subject in self.compasses else None
        if kept is None:
            self.compasses.pop(subject, None)
        for block in list(self.joint.blocks):
            if block != kept and (block == subject or (isinstance(block, tuple) and subject in block[1:3])):
                self.joint.drop(block)
                if isinstance(block, tuple):
                    self.used.get(block[1], {}).pop(block, None)

    def leave_out(self, robots: frozenset[str]) -> None:
        """From now on, take nothing of these robots; the objects that one newly left out has seen enter again without it.

        One that walks, and that others have placed, is where it was without the robot.
        """
        for robot in sorted(robots - self.left_out):
            for name in [name for name in self.seen if robot in self.trust.observers(name)]:
                if self.walks_as_told(name) and not robots.issuperset(self.vouching(name, robot)):
                    self.influence.take_back(self.joint, robot, name)
                    self.trust.forget_pair(robot, name)
                    self.walks.forget(name)
                else:
                    self.forget_object(name)
        if robots:
            self.tracks.without(robots)
        self.left_out = robots

    def forget_object(self, name: str) -> None:
        """Drop an object and all that was learned of it."""
        self.drop(name)
        self.trust.forget(name)
        self.walks.forget(name)
        self.disputes.forget(name)
        self.seen.pop(name, None)

    def rename(self, old: str, new: str) -> None:
        """An object has another name from now on; the lasting errors of sightings of it begin anew."""
        for block in [block for block in self.joint.blocks if isinstance(block, tuple) and old in block[1:3]]:
            self.joint.drop(block)
            del self.used[block[1]][block]
        self.joint.rename(old, new)
        self.influence.rename(old, new)
        self.walks.rename(old, new)
        self.seen[new] = self.seen.pop(old)

    def pass_object(self, subject: str, dt: float) -> None:
        """Let an object move for `dt` seconds."""
        kind = self.tracks.kind(subject)
        drift, model = self.objects.drift_of(subject), self.objects.model_of(subject, kind)
        way = self.walks.pass_time(subject, drift, dt, model, kind)
        self.shift(subject, way)
        self.influence.go(subject, way.mean)

    def shift(self, subject: str, way: Moments) -> None:
        """An object goes a way, shape (2,), whose covariance is (2, 2)."""
        self.joint.move(subject, self.joint.moments(subject).mean + way.mean, np.eye(2), way.covariance)

    def widen(self, robot: str, away: float = 0.0) -> None:
        """Widen position and heading of a robot that may have moved, by `away` (unit) or so, as its odometry did not measure.

        Who is carried `away`, or was led there by its gyro, may look anywhere.
        """
        block = self.joint.moments(robot)
        noise = np.zeros((STATES, STATES))
        position, heading = WIDENED
        noise[AXES, AXES] = position**2 * block.covariance[AXES, AXES] + away**2 * np.eye(2)
        noise[HEADING, HEADING] = heading**2
        if away:
            noise[HEADING, HEADING] = max(heading**2, ANYWHERE - block.covariance[HEADING, HEADING])
        self.joint.move(robot, block.mean, np.eye(STATES), noise)

    def moved_by(self, robot: str) -> list[Block] | None:
        """What a robot's evidence about itself moves: of one that is doubted its own place and lasting errors; None: all."""
        return self._of({robot} if self.doubts(robot) else set())

    def moved_by_sighting(self, relative: Relative) -> list[Block] | None:
        """The same of a sighting: of a track, or what rolls or is in dispute, that alone, else doubted ends, or what only these see.

        Of two robots, only one whose odometry is not believed (`distrust`) is moved. Two that keep seeing each other aside
        (`Offsets.apart`) do not move each other, unless one of them is doubted for other reasons.
        The velocity of what rolls was learned from the same sightings, so that it is no evidence of how their observers move. A
        robot that alone has seen a rolling object would take its motion for a turn of its own, and so mislead its mates.
        """
        observer, subject = relative.observer, relative.subject
        alone = len(self.known) > 1 and not self.vouching(subject, observer)
        rolls = self.walks.may_roll(subject) if alone else self.walks.rolls(subject)
        if subject in self.tracks or rolls or self.majority(observer, subject) == 0:
            return [subject]
        doubted = {end for end in (observer, subject) if self.doubts(end)}
        if subject in self.known:
            doubted |= {end for end in (observer, subject) if end in self.distrust}
        if self.freshness.doubts(observer) and subject not in self.known and not self.vouching(subject, observer):
            doubted.add(subject)
        if not doubted and (observer, subject) in self.offsets.apart:
            return []
        return self._of(doubted)

    def _of(self, robots: Collection[str]) -> list[Block] | None:
        """The blocks of some robots, and of the lasting errors of what they see; None of nobody."""
        if not robots:
            return None
        return [block for block in self.joint.blocks if (block[1] if isinstance(block, tuple) else block) in robots]

    def doubts(self, robot: str) -> bool:
        """Whether what a robot sees keeps one side, or tells nothing new."""
        return self.offsets.doubts(robot) or self.freshness.doubts(robot)

    def majority(self, observer: str, subject: str) -> int:
        """Above 0 where more robots see an object where an observer does than at another place, below 0 where fewer; 0 is a dispute.

        Who differed from it and looks no more counts where nobody who looks differs. Newcomers, who have not seen
        enough yet to differ from a side, count for none.
        """
        differing = {robot for robot in self.disputes.differing(observer, subject) if self.is_heard(robot)}
        if not differing:
            return 1
        looking = {robot for robot in self.disputes.seeing(subject) if robot != observer and self.is_heard(robot)}
        against = differing & looking or differing
        camps = (against - self.disputes.differing(robot, subject) for robot in against)
        agreeing = looking - differing - self.disputes.newcomers(subject, {observer, *against})
        more = 1 + len(agreeing) - max(map(len, camps))
        return more or self.disputes.favours(observer, subject, against & looking)

    def waits(self, observer: str, subject: str) -> bool:
        """Whether a sighting of an object is not taken now.

        It is disputed, and nobody who sees it elsewhere looks now; or the observer moved it too far while no other saw it.
        """
        if self.disputes.is_set_back(observer, subject) and self.is_alone(observer, subject):
            return True
        others = self.disputes.differing(observer, subject)
        return self.majority(observer, subject) == 0 and others.isdisjoint(self.disputes.seeing(subject))

    def is_alone(self, observer: str, subject: str) -> bool:
        """Whether an object that walks, and that others have placed without a dispute, is seen by one robot alone now."""
        if not self.walks_as_told(subject) or observer in self.left_out:
            return False
        others = [robot for robot in self.disputes.seeing(subject) if robot != observer and self.is_heard(robot)]
        return not others and any(not self.disputes.differing(of, subject) for of in self.vouching(subject, observer))

    def walks_as_told(self, subject: str) -> bool:
        """Whether it is a named object of which the team was told that it walks."""
        return subject in self.seen and subject not in self.tracks and self.objects.model_of(subject) == "walk"

    def disputing(self, subject: str) -> list[frozenset[str]]:
        """The equally large groups of robots that see an object at two places; empty without a dispute."""
        for robot in self.disputes.seeing(subject):
            if self.is_heard(robot) and self.majority(robot, subject) == 0:
                others = frozenset(filter(self.is_heard, self.disputes.differing(robot, subject)))
                looking = frozenset(filter(self.is_heard, self.disputes.seeing(subject)))
                return [looking - others - self.disputes.newcomers(subject, {robot, *others}), others]
        return []

    def is_heard(self, robot: str) -> bool:
        return robot not in self.left_out and not self.doubts(robot)

    def rests_on_doubted(self, subject: str, observer: str) -> bool:
        """Whether only robots that are doubted have seen an object where it is, and an observer is not among these."""
        observers = set(self.trust.observers(subject)) - {observer}
        return bool(observers) and not any(self.is_heard(robot) for robot in observers)

    def vouching(self, subject: str, observer: str) -> list[str]:
        """Who else has seen a subject, mostly agreed, and is not doubted."""
        return [other for other in self.trust.observers(subject) if other != observer and not self.doubts(other)]

    def refuted_now(self) -> frozenset[str]:
        """The robots that `contacts` leaves out, where nobody is accused by one that is doubted."""
        return self.contacts.left_out([robot for robot in self.known if self.doubts(robot)])

    def bounded(
        self,
        robot: str,
        factor: Factor,
        only: Collection[Block] | None = None,
        expected: Expected | None = None,
        share: float = 1.0,
    ) -> Collection[Block] | None:
        """Which blocks a factor that a robot tells may move, None: all; who would have moved others too far then moves itself alone.

        That it is taken, or a `share` of its gain, is noted.
        """
        if not self.influence.is_counted(len(self.known)):
            return only
        self.joint.begin(factor.priors, factor.anchors)
        expected = expected or self.joint.expected(factor)
        after = self.influence.after(self.joint, robot, factor, expected) if only is None else None
        if after is not None and (beyond := self.influence.beyond(self.joint, after)):
            self.tally.bounded += 1
            # Where both ends have moved each other too far, it is not known which one led the other. Then neither is moved.
            only = self._of({source for source, _ in beyond} - {place for _, place in beyond}) or []
            for source, place in sorted(beyond):
                if self.is_alone(source, place):
                    self.disputes.set_back(source, place)
        if after is None or only is not None or share != 1.0:
            after = self.influence.after(self.joint, robot, factor, expected, only, share)
        self.influence.on_factor(after)
        return only

    def as_found(self, relative: Relative) -> Relative:
        """A sighting with the noise that its observer's have shown to have.

        A factor that is widened after it was linearised is not the same: a range that seems exact is linearised where it was measured,
        and a range that is too short would weigh more than one that is too long. A profile is averaged over distances instead.
        """
        return relative.as_noisy(self.innovations.variance((relative.observer, "relative")))

    def weighed(
        self, source: Source, factor: Factor, innovation: Innovation, noisier: float = 1.0
    ) -> tuple[Factor, float]:
        """A factor with the noise that its source's evidence has shown to have, and the squared distance of what it says then.

        Its noise is `noisier` times what the source claims.
        """
        if noisier != 1.0:
            claimed = factor.widened(1.0 / noisier)
            innovation = Innovation(innovation.residual, innovation.covariance + (claimed.noise - factor.noise))
            factor = claimed
        squared = innovation.squared
        if not any(block in self.tracks for block in factor.jacobians):  # what is wrong may be whose the sighting is
            share = float(np.trace(np.linalg.solve(innovation.covariance, factor.noise))) / innovation.freedom
            self.innovations.judge(source, squared, innovation.freedom, share)
        variance = self.innovations.variance(source)
        if variance == 1.0:
            return factor, squared
        wider = factor.widened(variance)
        return wider, squared_distance(innovation.residual, innovation.covariance + (wider.noise - factor.noise))

    def distance(self, relative: Relative) -> float:
        """The distance (unit) to a subject: the measured range, or of a bearing that between the places in the joint.

        Infinity where one of these is not in the joint.
        """
        ends = relative.observer, relative.subject
        if relative.kind != "bearing":
            return relative.range
        if not all(end in self.joint for end in ends):
            return math.inf
        one, other = (self.joint.mean[self.joint.blocks[end]][AXES] for end in ends)
        return float(np.hypot(*(one - other)))

    def note_errors(self, relative: Relative) -> None:
        """The lasting errors of a sighting were of use; of an observer's those that were not for the longest go first."""
        used = self.used.setdefault(relative.observer, {})
        for block in relative.blocks():
            used.pop(block, None)
            used[block] = 0.0
        for block in list(used)[:-MAX_ERRORS]:
            self.joint.drop(block)
            del used[block]

    def forget_errors(self, dt: float) -> None:
        """Let all lasting errors forget for `dt` seconds, and drop those of which nothing is left to know."""
        forget_biases(self.joint, dt)
        for used in self.used.values():
            for block in list(used):
                used[block] += dt
                if used[block] > FADED * block[3]:
                    self.joint.drop(block)
                    del used[block]

    def forget_objects(self) -> None:
        """Drop the objects that were not sighted for long, and those that most observers see elsewhere."""
        unheard = {robot for robot in self.known if not self.is_heard(robot)}
        gone = [n for n, age in self.seen.items() if age > self.objects.kept or self.trust.misplaced(n, unheard)]
        for name in gone:
            self.forget_object(name)

    @contextmanager
    def blaming(self, robot: str) -> Iterator[None]:
        """Degenerate: after what a robot says the joint is none any more, or absurd; whose block is absurd is to blame."""
        try:
            yield
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise Degenerate(robot, f"what {robot} says leaves no Gaussian that can be kept: {error}") from error
        variances = self.joint.variances
        bad = ~((variances >= 0) & (variances <= ABSURD) & (np.abs(self.joint.mean) <= ABSURD))
        if bad.any():
            (owner,) = (b for b, place in self.joint.blocks.items() if place.start <= int(bad.argmax()) < place.stop)
            owner = owner[1] if isinstance(owner, tuple) else owner
            robot = owner if owner in self.known else robot
            raise Degenerate(robot, f"what {robot} says leaves a state that is absurd")

    def add_verdict(self, verdict: Verdict) -> None:
        self.tally.verdicts.append(verdict)
        self.tally.gated += not verdict.taken

    def contradict(self, observer: str, subject: str) -> bool:
        """Whether two robots contradict each other first-hand, and no coalition that contradicts one of them is believed."""
        if not self.contacts.contradict(observer, subject):
            return False
        for robot, source in ((subject, observer), (observer, subject)):
            choice = self.tally.choices.get(robot)
            if choice is not None and choice.outvoted and source in choice.members:
                return not all(self.contacts.contradict(robot, member) for member in choice.members - {robot})
        return True

    def outvoted(self, robot: str, source: str) -> tuple[str, ...]:
        """The members of the coalition that is believed about a robot's place, where a source is not among them.

        What had no vote, the robot's compass and its sightings of objects, is not outvoted. A mate's bearing alone is.
        """
        choice = self.tally.choices.get(robot)
        if choice is None or len(choice.members) < 2 or source in choice.members:
            return ()
        if source not in choice.others and (source == robot or source not in self.known):
            return ()
        return tuple(sorted(choice.members))

    def knows(self, subject: str) -> bool:
        """Whether the joint holds a position of the subject that is not flat."""
        if subject not in self.joint:
            return False
        x, variances = self.joint.blocks[subject].start, self.joint.variances
        return bool(variances[x] + variances[x + 1] < KNOWN)

    def marginal(self, subject: str) -> Moments:
        """Mean and covariance of a subject's position; KeyError where it is not in the joint."""
        block = self.joint.moments(subject)
        return Moments(block.mean[AXES], block.covariance[AXES, AXES])

    def drift_of(self, subject: str) -> float:
        """The random walk of an object (unit / sqrt(s)), as its sightings show it."""
        return self.walks.drift(subject, self.objects.drift_of(subject))
