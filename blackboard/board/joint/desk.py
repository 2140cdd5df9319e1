"""The joint of a board: evidence from the wire in, once each; agreed consensuses with their story out. Pure.

Evidence is numbered by robot, epoch and tick, so that what a robot reports to two boards, or what two boards forward, counts
once. What has arrived is settled step by step, in each step one tick of every robot. In lockstep that is the tick itself. Where
ticks are the robots' own, there are as many steps as the robot that reports most often needs.
"""

import logging
import math
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from blackboard.board.dissent import DissentJudge, distance
from blackboard.board.joint.evidence import learned, names, reason, shrank, unpack
from blackboard.board.unnamed import counters, may_be
from blackboard.config import BoardSection
from blackboard.errors import Degenerate, Refused
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.belief import Belief
from blackboard.opinion.believed import SPACING
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.classes import is_class
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.coalitions import PREDICTION
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
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
from blackboard.wire.gaussians import pack_state, pack_track, pack_velocity, unpack_track
from blackboard.wire.levels import Coding
from blackboard.wire.messages import Consensus, LeftOut, PackedBelief, Used
from blackboard.wire.types import MAX_NAME

log = logging.getLogger(__name__)

MAX_ROBOTS = 64
TICKS = 8  # of another board that are remembered as heard; a stale one may arrive after the newest
# In the joint that one robot has seen, and as many that several have; others are left to the pooled opinions.
MAX_OBJECTS = 64
FINEST = 8  # one sensor places a robot no better than a cell over this, where `[board] sharpest` does not say
STRIKES = 3  # times that a robot's evidence broke the joint until it is left out
PENALTY = 60.0  # seconds of team time for which it is then left out; afterwards one more time is enough
STALE = 1.0  # seconds after which it is not known how fast a robot moves
EPOCHS = 8  # of one robot of which it is known what was taken; a stale one may arrive after the newest
MAX_WAITING = 64  # ticks of one robot that wait to be settled; the oldest are dropped

#: Makes a consensus of what the joint knows about a subject: its board adds its names, the tick and the time.
Make = Callable[..., Consensus]


class JointDesk:
    """Takes evidence, settles it, and publishes what the joint knows.

    A robot that falls silent stays in the joint, because the sum of its motions restores what was lost once it is heard again.
    Meanwhile its marginal spreads as it moves, and is not published after `max_age`.
    """

    def __init__(
        self,
        grid: Grid,
        settings: BoardSection,
        counters: Counter[str],
        ageing: Ageing | None = None,
        settle: Settle = settle_alone,
    ) -> None:
        self.grid, self.settings = grid, settings
        self._ageing = ageing or Ageing(settings.drift, grid)
        self._settle_team = settle
        self.team = self._begun()
        self.dissent = DissentJudge("agreed", joint=True)
        # Counted here, and kept where the joint begins anew: `joint_restarts`, `joint_dropped`.
        self.counters = counters
        self._waiting: dict[str, deque[Evidence]] = {}
        #: Of the objects that the joint takes sightings of, the first first: who saw it, and when last (team time, s).
        self._objects: dict[str, dict[str, float]] = {}
        self._newest: dict[str, PackedEvidence] = {}  # robot -> the newest that was taken
        self._taken: dict[str, dict[int, int]] = {}  # robot -> its last epochs -> the newest tick that was taken
        self._states: dict[str, Moments | None] = {}  # robot -> its own belief in the newest
        self._until: dict[str, float] = {}  # robot -> team time until which its evidence is in the joint
        self._forward: list[tuple[float, Forwarded]] = []  # with its team time, seconds
        self._heard: dict[tuple[str, str], deque[int]] = {}  # sub-team and board -> the last ticks that it forwarded
        self._forwarders: set[tuple[str, str]] = set()  # the other boards that keep a joint
        self._began: float | None = None  # team time, seconds
        self._settled_at: float | None = None  # the same
        self._tracks: dict[tuple[str, str], Forward] = {}  # of each board what it said of its tracks last
        self._lost = Lost()
        self._strikes: dict[str, int] = {}  # robot -> how often its evidence broke the joint, as `robot/r1`
        self._barred: dict[str, float] = {}  # robot -> team time until which it is left out
        self._unnamed: list[Unnamed] = []  # what became of the unnamed sightings that were settled last
        self._failed: set[str] = set()  # the kinds of our own faults that are logged

    # --- in -------------------------------------------------------------------------------------------------------------

    def _begun(self) -> TeamJoint:
        rule = self.settings.of("robot/any")
        told = self.settings
        objects = Objects(
            told.objects_drift, told.objects_drifts, model=told.objects_motion, models=told.objects_motions
        )
        limits = Limits(self.settings.sharpest or self.grid.cell / FINEST)
        naming = Naming(self.grid.volume * math.prod(self.grid.shape))
        return TeamJoint(
            objects, naming=naming, limits=limits, rule=rule if isinstance(rule, Coalition) else Coalition()
        )

    def take_evidence(
        self, robot: str, tick: int, time: float, packed: PackedEvidence, *, own: bool, skew: float = 0.0
    ) -> None:
        """Take the evidence of a robot's tick at a team time (s), once; `own` evidence is kept to be forwarded.

        `skew` is how many seconds the robot's clock, by which it numbers its epochs, may be ahead. Where that clock was set back, a
        smaller epoch begins: what it says is later all the same. An epoch after which another one began is over for good.

        Refused: "mass", "too-many", "future" (an epoch that has not begun), "backwards" (sums that shrink within an epoch, as
        of a robot that was started again and did not begin a greater one).
        """
        before, taken = self._newest.get(robot), self._taken.get(robot, {})
        if before is not None and packed.epoch != before.epoch:
            if packed.epoch in taken or (packed.epoch < before.epoch and time <= self._until[robot]):
                return
        elif tick <= taken.get(packed.epoch, -1):
            return
        if packed.epoch > 1000 * (time + self.settings.future + skew):
            raise Refused("future", f"epoch {packed.epoch} of {robot} is later than {1000 * time:.0f} ms of team time")
        if before is not None and shrank(before, packed):
            raise Refused(
                "backwards",
                f"travelled of {robot} shrank within epoch {packed.epoch}: it is summed since the epoch began; after a new start "
                "begin a greater epoch",
            )
        if before is None and len(self._newest) >= MAX_ROBOTS:
            raise Refused("too-many", f"{robot} would be one more than {MAX_ROBOTS} robots in the joint")
        evidence = self._bounded(unpack(robot, tick, time, packed))
        if unknown := sum(not sighting.is_known for sighting in packed.seen):
            self.counters["unknown_kinds"] += unknown  # sightings of kinds that are not known here
        self._newest[robot], self._states[robot], self._until[robot] = packed, evidence.belief, time
        others = [(epoch, newest) for epoch, newest in taken.items() if epoch != packed.epoch]
        self._taken[robot] = dict([*others[1 - EPOCHS :], (packed.epoch, tick)])
        waiting = self._waiting.setdefault(robot, deque())
        waiting.append(evidence)
        if len(waiting) > MAX_WAITING:
            waiting.popleft()
            self.counters["joint_dropped"] += 1  # a tick that waited too long
        if own:
            self._forward = [
                *self._forward[1 - MAX_WAITING :],
                (time, Forwarded(robot=robot, tick=tick, evidence=packed)),
            ]

    def _bounded(self, evidence: Evidence) -> Evidence:
        """The evidence without sightings of more objects than the joint takes.

        Each robot has its share of `MAX_OBJECTS` for those that no other robot has seen: of one that sees more the newest are
        left out. Those that several have seen have as much room again. Who has not seen an object for as long as it is kept has
        not seen it.
        """
        robot, time = evidence.robot, evidence.time
        oldest = time - self.team.objects.kept
        self._objects = {
            name: young
            for name, seen in self._objects.items()
            if (young := {observer: at for observer, at in seen.items() if at >= oldest})
        }
        share = max(1, MAX_OBJECTS // max(1, len(self._newest)))
        alone = [name for name, seen in self._objects.items() if set(seen) == {robot}]
        known = set(alone[:share]) | {name for name in self._objects if name not in alone}
        room = share - min(share, len(alone))
        others = {
            relative.subject
            for relative in evidence.relatives
            if relative.subject.startswith("robot/") or is_class(relative.subject)
        }
        sighted = sorted({relative.subject for relative in evidence.relatives} - others)
        known |= set([name for name in sighted if name not in self._objects][:room])
        for name in sighted:
            if name in known:
                self._objects.setdefault(name, {})[robot] = time
        several = [name for name, seen in self._objects.items() if len(seen) > 1]
        known -= set(several[MAX_OBJECTS:])
        kept = tuple(relative for relative in evidence.relatives if relative.subject in known | others)
        self.counters["joint_dropped"] += len(evidence.relatives) - len(kept)
        return replace(evidence, relatives=kept)

    def hear_forward(
        self, forward: Forward, has_robot: Callable[[str], bool] = lambda robot: True, skew: float = 0.0
    ) -> None:
        """Take the evidence that another board passes on of the robots that its sub-team has.

        Refused: as in `take_evidence`, and "unregistered", after what is sound was taken.
        """
        self._heard.setdefault((forward.sub_team, forward.board), deque(maxlen=TICKS)).append(forward.tick)
        self.hear_tracks(forward)
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

    def hear_tracks(self, forward: Forward) -> None:
        """Take what another board calls its tracks, and where they are."""
        board = forward.sub_team, forward.board
        if board not in self._tracks or self._tracks[board].time <= forward.time:
            self._tracks[board] = forward.model_copy(update={"evidence": []})

    def expect(self, board: tuple[str, str], joint: bool) -> None:
        """Whether a board, named by its sub-team and its name, keeps a joint too, as its status says; if not, it forwards nothing."""
        (self._forwarders.add if joint else self._forwarders.discard)(board)

    def has_heard(self, board: tuple[str, str], tick: int) -> bool:
        """Whether a board has passed on the evidence of a tick, or is not expected to."""
        return board not in self._forwarders or tick in self._heard.get(board, ())

    def forward(self, time: float) -> list[Forwarded]:
        """The own robots' evidence since the last call, sorted, at a team time (s): what the other boards need."""
        rows = [forwarded.model_copy(update={"age": time - then}) for then, forwarded in self._forward]
        self._forward = []
        return sorted(rows, key=lambda forwarded: (forwarded.robot, forwarded.tick))

    @property
    def since(self) -> float | None:
        """The team time, in seconds, since which there is this joint; None before its first settlement."""
        return self._began

    def tracks(self) -> list[PackedTrack]:
        """The tracks that have names, for the other boards."""
        return [
            pack_track(track, self.team.marginal(track))
            for track in self.team.tracks
            if self.team.tracks.is_named(track)
        ]

    def _called(self, time: float) -> dict[str, Moments]:
        """Where the board that keeps its joint for longest, and for longer than this one, has tracks, by name."""
        self._tracks = {
            board: message for board, message in self._tracks.items() if message.time >= time - self.settings.max_age
        }
        elders = [
            (message.since, board)
            for board, message in self._tracks.items()
            if message.since is not None and self._began is not None and message.since < self._began
        ]
        if not elders:
            return {}
        with suppress(Refused):
            return {track.name: unpack_track(track) for track in self._tracks[min(elders)[1]].tracks}
        return {}

    # --- out ------------------------------------------------------------------------------------------------------------

    def settle(self, time: float, make: Make) -> list[Consensus]:
        """Settle all that waits, at a team time in seconds: a consensus on every subject that the joint knows, by name."""
        steps = max((len(waiting) for waiting in self._waiting.values()), default=0)
        elapsed = 0.0 if self._settled_at is None else max(0.0, time - self._settled_at)
        self._settled_at = time
        self._began = time if self._began is None else self._began
        self.team.called = self._called(time)
        verdicts: list[Verdict] = []
        self._unnamed = []
        for _ in range(max(1, steps)):
            number = self.team.tick + 1
            batch = [replace(waiting.popleft(), tick=number) for waiting in self._waiting.values() if waiting]
            batch = [evidence for evidence in batch if self._barred.get(evidence.robot, -math.inf) <= time]
            verdicts += self._settle(number, elapsed / max(1, steps), batch)
            self._unnamed += self.team.tally.unnamed
            self.counters.update(+self.team.tally.tracks)
        self.counters.update(counters(self._unnamed))
        self._judge(time, verdicts)
        known = [subject for subject in self.team.subjects() if self._age(subject, time) <= self.settings.max_age]
        doubtful = self.team.doubtful().items()
        settled = [self._consensus(subject, verdicts, time, make) for subject in known]
        return settled + [self._in_doubt(subject, places, make) for subject, places in doubtful]

    def _settle(self, number: int, dt: float, batch: list[Evidence]) -> list[Verdict]:
        """One step of the joint, without the evidence that breaks it.

        Where no single robot's does, the joint begins anew, and every robot enters again by its state. Only a robot whose evidence
        is `Degenerate` is to blame; any other exception is a fault of this program.
        """
        before = self.team.copy()
        verdicts, why = self._tried(number, dt, batch)
        if verdicts is not None:
            return verdicts
        suspects = sorted(batch, key=lambda evidence: evidence.robot)
        named = [evidence for evidence in suspects if isinstance(why, Degenerate) and evidence.robot == why.robot]
        if named and self._without(named, before, number, dt, batch) is not None:
            suspects = named
        while len(suspects) > 1:
            half = suspects[: len(suspects) // 2]
            verdicts = self._without(half, before, number, dt, batch)
            suspects = suspects[len(half) :] if verdicts is None else half
        verdicts = self._without(suspects, before, number, dt, batch)
        if verdicts is None or not suspects:
            self.counters["joint_restarts"] += 1  # evidence came that no arithmetic survives
            log.warning("the joint begins anew: %s", why)
            self.team = replace(self._begun(), tick=number, tracks=self.team.tracks.anew())
            return []
        if isinstance(why, Degenerate):
            self._strike(suspects[0].robot, why)
        return verdicts

    def _judge(self, time: float, verdicts: list[Verdict]) -> None:
        """Compare where each robot says that it is with where the joint has it."""
        told, believed, own = {}, {}, dict[str, float]()
        for robot, state in self._states.items():
            if state is not None and self.team.knows(f"robot/{robot}") and self._until[robot] >= time - SPACING:
                marginal = self.team.marginal(f"robot/{robot}")
                told[robot] = state.mean[AXES], state.covariance[AXES, AXES]
                believed[robot] = marginal.mean, marginal.covariance
                own[f"robot/{robot}"] = distance(told[robot], believed[robot])
        self._lost.on_verdicts(time, filter(self.team.knows, map("robot/{}".format, self._states)), verdicts, own)
        self.dissent.judge_robots(time, told, believed, verdicts, self.team.trust)

    def _without(
        self, left: list[Evidence], before: TeamJoint, number: int, dt: float, batch: list[Evidence]
    ) -> list[Verdict] | None:
        """The step again, from the joint as it was before, without some evidence; None where that breaks it too."""
        names = {evidence.robot for evidence in left}
        self.team = before.copy()
        return self._tried(number, dt, [evidence for evidence in batch if evidence.robot not in names])[0]

    def _tried(
        self, number: int, dt: float, batch: list[Evidence]
    ) -> tuple[list[Verdict], None] | tuple[None, Exception]:
        """The verdicts of a step, or what broke it; a fault of this program is logged, each kind once."""
        try:
            self.team = self._settle_team(self.team, number, dt, batch)
            return self.team.tally.verdicts, None
        except Degenerate as error:
            return None, error
        except Exception as error:
            self.counters["failed"] += 1
            if (kind := type(error).__name__) not in self._failed:
                self._failed.add(kind)
                log.error("a fault in the joint, not logged again: it goes on without it", exc_info=error)
            return None, error

    def _strike(self, robot: str, why: Exception) -> None:
        self.counters["joint_left_out"] += 1
        self._strikes[robot] = strikes = self._strikes.get(robot, 0) + 1
        if strikes == 1:
            log.warning("the evidence of %s breaks the joint and is left out: %s", robot, why)
        if strikes >= STRIKES and self._settled_at is not None:
            self._barred[robot] = self._settled_at + PENALTY
            log.warning("%s is left out of the joint for %g s: its evidence broke it %d times", robot, PENALTY, strikes)

    def _age(self, subject: str, time: float) -> float:
        """Seconds since the newest evidence of a robot; 0 for an object, whose random walk is in the joint."""
        return max(0.0, time - self._until.get(subject.removeprefix("robot/"), time))

    def _consensus(self, subject: str, verdicts: list[Verdict], time: float, make: Make) -> Consensus:
        about = [verdict for verdict in verdicts if verdict.subject == subject]
        taken = sorted({verdict.source for verdict in about if verdict.taken})
        now = self._now(subject, time)
        belief, nats = _packed_gaussian(self.grid, self.settings.coding, now.mean.tobytes(), now.covariance.tobytes())
        left_out = {verdict.source: reason(verdict) for verdict in about if not verdict.taken}
        if time < self._barred.get(subject, -math.inf):
            left_out[subject] = "its evidence breaks the joint"
        choice = self.team.tally.choices.get(subject)
        camps = self.dissent.camps_about(subject, taken)
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
        return {name: self._until[name] for name in sorted(self._until) if f"robot/{name}" in self.team.joint}

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
        """The limit of a sighting's squared distance, and of an object the random walk (unit / sqrt(s)) that its sightings show."""
        gate = {"gate": quantile(GATE, 2)}
        return gate if subject.startswith("robot/") else {**gate, "drift": self.team.drift_of(subject)}

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
        return self._lost.probability(subject) if subject.removeprefix("robot/") in self._states else None

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
