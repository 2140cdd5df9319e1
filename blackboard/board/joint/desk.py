"""The joint of a board: evidence from the wire in; agreed consensuses with their story out. Pure.

What has arrived is settled step by step, in each step one tick of every robot. In lockstep that is the tick itself. Where
ticks are the robots' own, there are as many steps as the robot that reports most often needs.
"""

import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from blackboard.board.dissent import DissentJudge, distance
from blackboard.board.joint.culprits import Culprits
from blackboard.board.joint.evidence import learned, names, reason
from blackboard.board.joint.others import OtherBoards
from blackboard.board.joint.passing import PassedOn
from blackboard.board.joint.queue import MAX_ROBOTS, EvidenceQueue
from blackboard.board.joint.room import MAX_OBJECTS
from blackboard.board.unnamed import counters, may_be
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.belief import Belief
from blackboard.opinion.believed import SPACING
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.coalitions import PREDICTION
from blackboard.opinion.gaussian.distrust import DISTRUSTED
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.evidence import Verdict
from blackboard.opinion.gaussian.finding import errors_found
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.lost import Lost
from blackboard.opinion.gaussian.naming import Naming, Unnamed
from blackboard.opinion.gaussian.once import Settle, settle_alone
from blackboard.opinion.gaussian.rings import RingPlace
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, BEARING, HEADING
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.arrays import pack
from blackboard.wire.evidence import Forward, Forwarded, PackedEvidence, PackedState, PackedTrack, PackedVelocity
from blackboard.wire.gaussians import pack_pose, pack_state, pack_track, pack_velocity
from blackboard.wire.levels import Coding
from blackboard.wire.messages import Consensus, LeftOut, PackedBelief, Used
from blackboard.wire.types import MAX_NAME

FINEST = 8  # one sensor places a robot no better than a cell over this, where `[board] sharpest` does not say
STALE = 1.0  # seconds after which it is not known how fast a robot moves

#: Makes a consensus of what the joint knows about a subject: its board adds its names, the tick and the time.
Make = Callable[..., Consensus]


class JointDesk:
    """Takes evidence, settles it, and publishes what the joint knows.

    A robot that falls silent stays in the joint, because the sum of its motions restores what was lost once it is heard again.
    Meanwhile its marginal spreads as it moves, and is not published after `max_age`.
    """

    def __init__(
        self, grid: Grid, settings: BoardSection, counters: Counter[str], ageing: Ageing, settle: Settle = settle_alone
    ) -> None:
        self.grid, self.settings, self._ageing = grid, settings, ageing
        self.team = self._begun()
        self.dissent = DissentJudge("agreed", joint=True)
        self.others = OtherBoards()
        self.counters = counters  # kept where the joint begins anew
        self._queue = EvidenceQueue(counters, future=settings.future, kept=self.team.objects.kept)
        self._culprits = Culprits(settle, self._begun, counters)
        self._lost = Lost()
        self._passed_on = PassedOn(counters)
        self.since: float | None = None  # team time (s) of the first settlement
        self._settled_at: float | None = None  # of the newest one
        self._unnamed: list[Unnamed] = []  # what became of the unnamed sightings that were settled last

    def _begun(self) -> TeamJoint:
        """A joint without robots."""
        told, rule = self.settings, self.settings.of("robot/any")
        objects = Objects(
            told.objects_drift, told.objects_drifts, model=told.objects_motion, models=told.objects_motions
        )
        limits = Limits(told.sharpest or self.grid.cell / FINEST)
        naming = Naming(self.grid.volume * math.prod(self.grid.shape))
        return TeamJoint(
            objects, naming=naming, limits=limits, rule=rule if isinstance(rule, Coalition) else Coalition()
        )

    # --- in -------------------------------------------------------------------------------------------------------------

    def take_evidence(
        self, robot: str, tick: int, time: float, packed: PackedEvidence, *, own: bool, skew: float = 0.0
    ) -> None:
        """Take the evidence of a robot's tick at a team time (s), once; `own` evidence is kept to be forwarded.

        `skew`, and what is refused: as in `EvidenceQueue.take`.
        """
        if self._queue.take(robot, tick, time, packed, skew) and own:
            self._passed_on.add(time, Forwarded(robot=robot, tick=tick, evidence=packed))

    def hear_forward(
        self, forward: Forward, has_robot: Callable[[str], bool] = lambda robot: True, skew: float = 0.0
    ) -> None:
        """Take the evidence that another board passes on of the robots that its sub-team has.

        Refused: as in `take_evidence`, and "unregistered", after what is sound was taken.
        """
        self.others.hear_forward(forward)
        refusals = []
        for one in forward.evidence:
            try:
                if not has_robot(one.robot):
                    raise Refused(
                        "unregistered", f"{one.robot} holds no liveliness token in sub-team {forward.sub_team}"
                    )
                self.take_evidence(one.robot, one.tick, forward.time - one.age, one.evidence, own=False, skew=skew)
            except Refused as refusal:
                refusals.append(refusal)
        if refusals:
            raise refusals[0]

    # --- for the other boards -------------------------------------------------------------------------------------------

    def forward(self, time: float) -> list[Forwarded]:
        """The own robots' evidence since the last call, sorted, at a team time (s): what the other boards need."""
        return self._passed_on.take(time)

    def tracks(self) -> list[PackedTrack]:
        """The tracks that have names, for the other boards."""
        return [
            pack_track(track, self.team.marginal(track))
            for track in self.team.tracks
            if self.team.tracks.is_named(track)
        ]

    # --- out ------------------------------------------------------------------------------------------------------------

    def settle(self, time: float, make: Make) -> list[Consensus]:
        """Settle all that waits, at a team time in seconds: a consensus on every subject that the joint knows, by name."""
        steps = max(1, self._queue.steps)
        elapsed = 0.0 if self._settled_at is None else max(0.0, time - self._settled_at)
        self._settled_at = time
        self.since = time if self.since is None else self.since
        self.team.called = self.others.tracks(time - self.settings.max_age, self.since)
        verdicts: list[Verdict] = []
        self._unnamed = []
        for _ in range(steps):
            tick = self.team.tick + 1
            heard = [one for one in self._queue.pop(tick) if not self._culprits.is_barred(one.robot, time)]
            self.team = self._culprits.settle(self.team, tick, elapsed / steps, heard, time)
            verdicts += self.team.tally.verdicts
            self._unnamed += self.team.tally.unnamed
            self.counters.update(+self.team.tally.tracks)
        self.counters.update(counters(self._unnamed))
        self._judge(time, verdicts)
        # An object whose place was lost has a flat consensus. Without one the board would pool old opinions, which are too sure.
        doubtful = self.team.doubtful()
        held = sorted({*self.team.subjects(), *self.team.anywhere()} - doubtful.keys())
        known = [subject for subject in held if self._age(subject, time) <= self.settings.max_age]
        settled = [self._consensus(subject, verdicts, time, make) for subject in known]
        return settled + [self._in_doubt(subject, places, make) for subject, places in doubtful.items()]

    def _judge(self, time: float, verdicts: list[Verdict]) -> None:
        """Compare where each robot says that it is with where the joint has it."""
        told, believed, own = {}, {}, dict[str, float]()
        for robot, state in self._queue.states.items():
            if state is not None and self.team.knows(f"robot/{robot}") and self._queue.until[robot] >= time - SPACING:
                marginal = self.team.marginal(f"robot/{robot}")
                told[robot] = state.mean[AXES], state.covariance[AXES, AXES]
                believed[robot] = marginal.mean, marginal.covariance
                own[f"robot/{robot}"] = distance(told[robot], believed[robot])
        self._lost.on_verdicts(time, filter(self.team.knows, map("robot/{}".format, self._queue.states)), verdicts, own)
        self.dissent.judge_robots(time, told, believed, verdicts, self.team.trust)

    def _age(self, subject: str, time: float) -> float:
        """Seconds since the newest evidence of a robot; 0 for an object, whose random walk is in the joint."""
        return max(0.0, time - self._queue.until.get(subject.removeprefix("robot/"), time))

    def _consensus(self, subject: str, verdicts: list[Verdict], time: float, make: Make) -> Consensus:
        about = [verdict for verdict in verdicts if verdict.subject == subject]
        taken = sorted({verdict.source for verdict in about if verdict.taken})
        now = self._now(subject, time)
        belief, nats = _packed_gaussian(self.grid, self.settings.coding, now.mean.tobytes(), now.covariance.tobytes())
        left_out = {verdict.source: reason(verdict) for verdict in about if not verdict.taken}
        if self._culprits.is_barred(subject, time):
            left_out[subject] = "its evidence breaks the joint"
        choice = self.team.tally.choices.get(subject)
        camps = self.dissent.camps_about(subject, taken, self.team.disputing(subject))
        if choice is not None and choice.outvoted:
            left_out[PREDICTION] = f"contradicted by {names(choice.members)}"
        return make(
            subject=subject,
            belief=belief,
            ancestors=self._ancestors(),
            used=self._used(taken, subject),
            left_out=[
                LeftOut(source=name.removeprefix("robot/"), reason=left_out[name][:MAX_NAME])
                for name in sorted(left_out)
            ],
            components=[] if choice is None else list(choice.components),
            entropy=nats,
            conflict=bool(left_out or camps),
            rule="joint",
            learned=learned(self.team.innovations, taken),
            parameters=self._parameters(subject),
            state=self._state(subject),
            pose=None if subject.startswith("robot/") else pack_pose(now),
            velocity=self._velocity(subject, time),
            lost=self.lost(subject),
            dissent=self.dissent.named(
                {verdict.source.removeprefix("robot/") for verdict in about} | {subject.removeprefix("robot/")}
            ),
            camps=camps,
            unnamed=may_be(subject, self._unnamed),
            existence=self.team.tracks.existence(subject),
        )

    def _ancestors(self) -> dict[str, float]:
        """Whose evidence is in the joint, and until when."""
        until = self._queue.until
        return {name: until[name] for name in sorted(until) if f"robot/{name}" in self.team.joint}

    def _used(self, taken: list[str], subject: str) -> list[Used]:
        """The robots whose evidence about a subject was taken, each with as much weight."""
        return [
            Used(
                source=source.removeprefix("robot/"), weight=1.0 / len(taken), age=0.0, entropy=nats, how="independent"
            )
            for source, nats in zip(taken, self._entropies(taken, subject), strict=True)
        ]

    def _now(self, subject: str, time: float) -> Moments:
        """Where a subject is at a team time (s): a robot goes on as it went for a short time, then its variance grows."""
        age, marginal = self._age(subject, time), self.team.marginal(subject)
        ahead = self.team.ahead(subject, age) if 0.0 < age <= STALE else None
        if ahead is not None:
            return ahead
        return Moments(marginal.mean, marginal.covariance + np.eye(2) * self._ageing.variance(subject, age))

    def _parameters(self, subject: str) -> dict[str, float]:
        """The limit of a sighting's squared distance; of an object the random walk (unit / sqrt(s)) that its sightings show.

        Of a robot also 1 as `DISTRUSTED` while its odometry is not believed, though what it sees is, and what of its sensors errs by
        more than it was told (`priors.FOUND`).
        """
        gate = {"gate": quantile(GATE, 2)}
        if not subject.startswith("robot/"):
            return {**gate, "drift": self.team.drift_of(subject)}
        distrusted = subject in self.team.distrust and not self.team.doubts(subject)
        return gate | errors_found(self.team, subject) | ({DISTRUSTED: 1.0} if distrusted else {})

    def _in_doubt(self, subject: str, places: tuple[RingPlace, ...], make: Make) -> Consensus:
        """What is agreed about an object of which only ranges or bearings are known, which leave a few places."""
        drawn = sum(place.weight * draw(self.grid, place.moments).p for place in places)
        belief = Belief(self.grid, np.asarray(drawn))
        return make(
            subject=subject,
            belief=pack(belief, self.settings.coding),
            ancestors=self._ancestors(),
            used=[],
            entropy=entropy_of(belief.p),
            conflict=False,
            rule="joint",
            parameters={"places": float(len(places))},
        )

    def _state(self, subject: str) -> PackedState | None:
        return pack_state(self.team.pose(subject)) if subject.startswith("robot/") else None

    def lost(self, subject: str) -> float | None:
        """The probability that a robot of which there is evidence is not where it is believed to be; None of all else."""
        return self._lost.probability(subject) if subject.removeprefix("robot/") in self._queue.states else None

    def _velocity(self, subject: str, time: float) -> PackedVelocity | None:
        """How fast a subject moves; None of a robot that is not heard any more."""
        velocity = self.team.velocity(subject) if self._age(subject, time) <= STALE else None
        return None if velocity is None else pack_velocity(velocity)

    def _entropies(self, sources: list[str], subject: str) -> list[float]:
        """Nats on the grid's cells of what robots say about a subject: themselves in the joint, or a sighting from there.

        At the subject's distance the uncertain heading and bearing of its observer count, too.
        """
        if not sources:
            return []
        poses = self.team.poses(sources)
        away = self.team.marginal(subject).mean - poses.mean[:, AXES]
        across = away[:, ::-1] * [-1.0, 1.0]
        angles = poses.covariance[:, HEADING, HEADING] + poses.covariance[:, BEARING, BEARING]
        covariance = poses.covariance[:, AXES, AXES] + np.eye(2) * self.grid.cell**2 / 12
        covariance += (angles[:, np.newaxis] * across)[:, :, np.newaxis] * across[:, np.newaxis, :]
        determinants = np.maximum(np.linalg.det(covariance), 1e-300)
        nats = 0.5 * np.log((2 * math.pi * math.e) ** 2 * determinants) - math.log(self.grid.volume)
        entropies: list[float] = np.maximum(0.0, nats).tolist()
        return entropies


@lru_cache(2 * MAX_OBJECTS + MAX_ROBOTS)
def _packed_gaussian(grid: Grid, coding: Coding, mean: bytes, covariance: bytes) -> tuple[PackedBelief, float]:
    """A Gaussian as a grid for a message, and its entropy (nats). Kept, because all boards of one process draw the same."""
    belief = draw(grid, Moments(np.frombuffer(mean), np.frombuffer(covariance).reshape(2, 2)))
    return pack(belief, coding), entropy_of(belief.p)
