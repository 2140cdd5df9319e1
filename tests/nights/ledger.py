"""The ledger of evidence: what each board's joint took, in which step, and how much it can know from that at most.

A piece of evidence is named by its robot, its epoch, and how long that lasted when it was taken, because the sums of an epoch only
grow. So no board has a say in the name.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from blackboard.board.board import Board
from blackboard.board.service import BoardService
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import likelihood
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.naming import Unnamed
from blackboard.opinion.gaussian.vehicle import AXES, Motion, correct, drive
from blackboard.wire.evidence import PackedEvidence, PackedRelative, Seen
from blackboard.wire.messages import Consensus, Report, Used
from tests.nights.events import Began, Event, Moved, Said, Stepped
from tests.nights.night import Night
from tests.nights.oracles import Oracle

SAMPLED = 5  # the shadow is computed in one of so many steps
#: Least ratio of a joint's variance to the shadow's: they linearise at different points, and honest nights of seed 11 show 0.91.
LEAST = 0.8
APART = 1.0  # sigmas between the two; farther apart a gate has left something out, and their variances are not compared

AFTER = 0.9  # of a tick: what is seen in the next one is later than this one by as much

Piece = tuple[str, int, float]  # robot, epoch, and seconds since that began


def name_of(evidence: Evidence, silent: Collection[str] = ()) -> Piece:
    """The name of a piece of evidence; of robots whose odometry is `silent` by the team time (s) at which it ended."""
    span = evidence.time if evidence.robot in silent else evidence.travelled.dt
    return evidence.robot, evidence.epoch, span


def shadow(before: Joint, batch: Sequence[Evidence], motions: Mapping[str, Motion]) -> Joint:
    """The joint after a step that takes each piece of evidence once, without a gate, and forgets nothing.

    `motions` are those of the robots since the step before.
    """
    joint, batch = before.copy(), sorted(batch, key=lambda evidence: evidence.robot)
    for evidence in batch:
        if evidence.robot in motions:
            drive(joint, evidence.robot, motions[evidence.robot], evidence.nuisance)
    for evidence in batch:
        gained = None if evidence.increment is None else likelihood(joint, evidence.robot, evidence.increment)
        if gained is not None:
            correct(joint, gained)
    for evidence in batch:
        for relative in evidence.relatives:
            if relative.subject in joint or not relative.subject.startswith("robot/"):
                correct(joint, linearise(joint, relative, motions))
    return joint


def named(evidence: Evidence, unnamed: Iterable[Unnamed]) -> Evidence:
    """The evidence with each sighting that has no name as one of whom it was taken for, or of each whom it may be of."""
    mine = [sighting for sighting in unnamed if sighting.source == evidence.robot]
    of = {sighting.mark: [sighting.taken] if sighting.taken else sorted(sighting.odds or ()) for sighting in mine}
    return replace(
        evidence,
        relatives=tuple(
            replace(relative, subject=subject)
            for relative in evidence.relatives
            for subject in (of.get(relative.mark or 0, []) if is_class(relative.subject) else [relative.subject])
        ),
    )


class EvidenceCountsOnce(Oracle):
    """No piece of evidence is taken in two steps, and no step tells a joint more of a robot's place than each piece once.

    A sighting of a robot that has not told how it moved until then counts with the observer's next evidence.
    """

    sees = (Stepped,)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: Robots whose odometry is missing for a while. Their sums do not grow then, so that a time names their evidence.
        self._silent = [
            name for name in night.team.processes if any(f.silences(name) == "odometry" for f in night.faults)
        ]
        self._taken: dict[Board, dict[Piece, int]] = {}  # with the number of the step
        self._newest: dict[Board, dict[str, Evidence]] = {}
        #: Robot -> its newest evidence, with only those sightings that count with its next one.
        self._early: dict[Board, dict[str, Evidence]] = {}
        self._steps = 0

    def see(self, event: Event) -> None:
        assert isinstance(event, Stepped)
        taken, newest = self._taken.setdefault(event.board, {}), self._newest.setdefault(event.board, {})
        honest = [evidence for evidence in event.batch if evidence.robot not in self.night.liars]
        for piece in (name_of(evidence, self._silent) for evidence in honest):
            if taken.setdefault(piece, event.number) != event.number:
                self.breaks(
                    event.at, f"{event.process} takes {piece} in step {taken[piece]} and in step {event.number}"
                )
        self._steps += 1
        early = self._early.setdefault(event.board, {})
        told = {robot: said.time for robot, said in newest.items() if robot not in {said.robot for said in event.batch}}
        parted = [_parted(evidence, told) for evidence in event.batch]
        begins = any(not _goes_on(newest.get(said.robot), said) for said in event.batch)
        if self._steps % SAMPLED == 0 or begins:
            batch = [_plus(now, early.get(now.robot)) for now, _ in parted]
            self._compare(replace(event, batch=batch), newest)
        early |= {later.robot: later for _, later in parted}
        newest |= {evidence.robot: evidence for evidence in event.batch}

    def _compare(self, event: Stepped, newest: Mapping[str, Evidence]) -> None:
        motions, begun = {}, event.before.copy()
        for evidence in event.batch:
            robot, before = evidence.robot, newest.get(evidence.robot)
            if before is not None and _goes_on(before, evidence) and robot in event.before:
                motions[robot] = evidence.travelled.since(before.travelled)
            elif evidence.returned is not None:
                return  # it may enter by what another joint knew of it
            elif evidence.belief is not None:  # it enters, with all that it knows
                if robot in begun:
                    begun.drop(robot)
                begun.add(robot, evidence.belief)
        if not self.night.is_honest:
            return  # the shadow takes everything, and no arithmetic survives some lies
        entering = [
            robot for robot in begun.blocks if robot not in motions and robot in {said.robot for said in event.batch}
        ]
        heard = [said for said in event.batch if said.robot in {*motions, *entering}]
        batch = [
            named(said if said.robot in motions else replace(said, increment=None), event.unnamed) for said in heard
        ]
        most = shadow(begun, batch, motions)
        both = [robot for robot in motions if robot in event.after]
        if any(_apart(event.after, most, robot) > APART for robot in both):
            both = []
        # Who enters has no place from before, that a gate could hold its evidence against.
        for robot in [*both, *(robot for robot in entering if robot in event.after)]:
            if (share := _least_share(event.after, most, robot)) < LEAST:
                self.breaks(
                    event.at, f"{event.process} knows {robot} with {share:.2f} of the variance that its evidence leaves"
                )


def _goes_on(before: Evidence | None, now: Evidence) -> bool:
    """Whether evidence is of the same epoch as what its robot told before."""
    return before is not None and before.epoch == now.epoch


def _parted(evidence: Evidence, told: Mapping[str, float]) -> tuple[Evidence, Evidence]:
    """With the sightings that count now, and with those whose subjects have `told` how they moved until earlier (team time, s)."""
    now = evidence.time
    early = [seen for seen in evidence.relatives if told.get(seen.subject, now) < now - seen.age]
    rest = [seen for seen in evidence.relatives if not any(seen is other for other in early)]
    return replace(evidence, relatives=tuple(rest)), replace(evidence, relatives=tuple(early))


def _plus(evidence: Evidence, early: Evidence | None) -> Evidence:
    """With the sightings of the evidence before that are to count with this one."""
    if early is None:
        return evidence
    older = evidence.time - early.time
    return replace(
        evidence, relatives=(*(replace(seen, age=seen.age + older) for seen in early.relatives), *evidence.relatives)
    )


class SightingsAreToldOnce(Oracle):
    """By a world's clock a robot tells of what it saw after its newest evidence, also where it tells the mean of some ticks."""

    sees = (Began, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._told: dict[tuple[str, str], float] = {}  # process and sub-team -> team time of its newest evidence

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._told = {of: time for of, time in self._told.items() if of[0] != event.process}
        elif isinstance(event, Said) and isinstance(event.message, Report) and event.message.evidence is not None:
            self._judge(event, event.message, event.message.evidence)

    def _judge(self, event: Said, report: Report, evidence: PackedEvidence) -> None:
        who = event.process, event.parts["sub_team"]
        before, self._told[who] = self._told.get(who, math.inf), report.time
        is_judged = self.night.team.mode != "free" and event.process not in self.night.liars
        if before >= report.time or not is_judged:  # its first, the same again, or another run
            return
        sightings: list[PackedRelative | Seen] = [*evidence.relatives, *evidence.seen]
        for sighting in sightings:
            if report.time - sighting.age < before + AFTER * self.night.team.tick:
                what = f"{sighting.subject} as it was {sighting.age:.2f} s ago"
                self.breaks(event.at, f"{event.process} tells {what}, and told that {report.time - before:.2f} s ago")


class SameEvidenceSameBits(Oracle):
    """Boards that settled the same agree to the bit; in lockstep, where nothing is learned, all do once the team is well again.

    Opinions are told apart by all but their beliefs, so only those of one run of a world are compared.
    """

    sees = (Stepped, Said, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._settled: dict[
            str, tuple[Board, int]
        ] = {}  # process -> its board, and all that its joint has taken, as one number
        self._runs: dict[str, str] = {}  # process -> the run of the world that it follows
        self._agreed: dict[tuple[object, ...], tuple[str, Consensus]] = {}

    def see(self, event: Event) -> None:
        if isinstance(event, Moved) and isinstance(event.service, BoardService):
            self._runs[event.process] = event.service.clock.run
        elif isinstance(event, Stepped):
            board, before = self._settled.get(event.process, (event.board, 0))
            before = before if board is event.board else 0
            batch = tuple(sorted((*name_of(evidence), evidence.time) for evidence in event.batch))
            self._settled[event.process] = event.board, hash((before, event.run, event.number, event.dt, batch))
        elif isinstance(event, Said) and isinstance(event.message, Consensus) and event.message.level == "agreed":
            self._compare(event, event.message)

    def _compare(self, event: Said, consensus: Consensus) -> None:
        same: list[object] = [("opinions", tuple(map(_opinion, consensus.used)), tuple(consensus.parameters.items()))]
        if consensus.rule == "joint":
            same = [("joint", self._settled[event.process][1])]
        team = self.night.team
        if (
            team.mode == "lockstep"
            and team.fusion == "opinions"
            and not team.is_learning
            and event.at > self.night.well
        ):
            same.append("well")
        for what in same:
            key = what, self._runs.get(event.process), consensus.tick, consensus.time, consensus.subject
            process, other = self._agreed.setdefault(key, (event.process, consensus))
            # What is drawn of a robot that was not heard spreads by its speed, which not every board needs to have heard.
            if (other.state or other.belief) != (consensus.state or consensus.belief):
                self.breaks(
                    event.at,
                    f"{process} and {event.process} agree on two beliefs about {consensus.subject} in tick {consensus.tick}",
                )


def _opinion(used: Used) -> tuple[object, ...]:
    return used.source, used.age, used.entropy, used.weight, used.power, used.how


def _apart(one: Joint, other: Joint, robot: str) -> float:
    """The distance of a robot's places in two joints, in the sigmas of the other one."""
    away = one.moments(robot).mean[AXES] - other.moments(robot).mean[AXES]
    return float(np.hypot(*away) / np.sqrt(np.trace(other.moments(robot).covariance[AXES, AXES]) / 2))


def _least_share(one: Joint, other: Joint, robot: str) -> float:
    """The least share, over all directions, that the variance of a robot's place in one joint has of that in another one."""
    root = np.linalg.cholesky(other.moments(robot).covariance[AXES, AXES])
    white = np.linalg.solve(root, np.linalg.solve(root, one.moments(robot).covariance[AXES, AXES]).T)
    return float(np.linalg.eigvalsh(0.5 * (white + white.T))[0])


class SightingsAreJudged(Oracle):
    """Each named sighting of a mate that is settled is judged, taken or not, in that step or in the next one of its observer.

    Or it counts as saying nothing. Not asked of who begins an epoch, nor of an observer or a mate that is not in the joint.
    """

    sees = (Stepped,)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: Board and observer -> its epoch, and by mate how many sightings were settled before and not judged until now.
        self._owed: dict[tuple[Board, str], tuple[int, Counter[str]]] = {}

    def see(self, event: Event) -> None:
        assert isinstance(event, Stepped)
        judged = Counter((verdict.source, verdict.subject) for verdict in event.verdicts if verdict.kind == "relative")
        for said in event.batch:
            epoch, owed = self._owed.get((event.board, said.robot), (said.epoch, Counter[str]()))
            owed = Counter(owed if epoch == said.epoch else ())
            for mate in [mate for mate in owed if mate not in event.before or mate not in event.after]:
                del owed[mate]
            seen = Counter(
                sighting.subject
                for sighting in said.relatives
                if sighting.observer == said.robot != sighting.subject and sighting.subject in event.after
            )
            mates = [mate for mate in {*owed, *seen} if mate.startswith("robot/") and not is_class(mate)]
            # a sighting of this step may wait, and be judged in its observer's next step
            left = {mate: owed[mate] - judged[said.robot, mate] for mate in mates}
            if (lost := max(left.values(), default=0)) > event.silent and said.robot in event.before:
                mate = max(left, key=left.__getitem__)
                self.breaks(event.at, f"{event.process} judges {lost} sightings of {mate} by {said.robot} in no step")
            # who is not in the joint has settled nothing: a board that starts afresh forgets what it has heard
            mates = mates if said.robot in event.after else []
            self._owed[event.board, said.robot] = said.epoch, Counter({mate: left[mate] + seen[mate] for mate in mates})
