"""The agent of a robot whose boards keep a joint: a Gaussian filter while it knows its heading, grids while it does not. Pure.

It believes three things. First-hand, from its own readings alone: itself and the objects that it saw, held jointly, because what it
sees of an object errs with its own place. As evidence, what the readings of a tick add to the joint of the boards. Informed: where
the team agreed that it was, moved on by what it measured since.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.coalitions import KNOWN
from blackboard.opinion.gaussian.comparing import RETURNING
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments, squared_distance
from blackboard.opinion.gaussian.mounts import CompassReading, add_with_heading, compass_of, reading_factor
from blackboard.opinion.gaussian.sightings import claimed
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.tracks import Tracks
from blackboard.opinion.gaussian.vehicle import AXES, FLAT, HEADING, POSE, Motion, correct, drive, wrap
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack
from blackboard.wire.gaussians import pack_evidence
from blackboard.wire.messages import Informed, PackedBelief, Readings, Report, Solo
from blackboard.wire.types import capped
from robot_agent.agent import SNAPSHOTS, Agent, Feedback, TeamBelief, report_of, solo_of
from robot_agent.budget import Sending
from robot_agent.config import RobotSection
from robot_agent.gaussian.filter import FilterResult, FirstHand
from robot_agent.gaussian.hand_over import pose_of
from robot_agent.gaussian.own import Given
from robot_agent.gaussian.sensors import Sensors, sensors_of
from robot_agent.raster import with_outlier
from robot_agent.sensing import trackable

#: Cells: a smaller sigma of the team's place may be the bound of the boards (`[board] sharpest`; by default 1/8 of a cell).
FINE = 0.25
NOTHING = np.diag([FLAT, FLAT, math.pi**2 / 3])  # the covariance of a pose (x, y, heading) that may be any


@dataclass(frozen=True, eq=False)
class Step:
    """What a tick added: how the robot moved, and what it gained."""

    time: float  # team time, seconds
    motion: Motion
    increment: Increment | None
    compass: CompassReading | None = None


class JointAgent:
    """One robot: `tick` takes readings and the agreed beliefs that have arrived, and returns what to report."""

    def __init__(
        self,
        robot: str,
        settings: RobotSection,
        grid: Grid,
        feedback: Feedback = "guarded",
        sensors: Sensors | None = None,
        own: bool = False,
    ) -> None:
        """`sensors` are those of the settings where they are not given; `own`: the robot has a filter of its own."""
        self.robot, self.subject = robot, f"robot/{robot}"
        self.settings, self.grid, self.feedback = settings, grid, feedback
        made = Given if own else FirstHand
        self.filter: FirstHand = made(self.subject, sensors or sensors_of(settings))
        #: Of this robot alone, with the objects that it saw; numbers of tracks are the team's.
        self.own = TeamJoint(Objects(drift=settings.objects.drift), tracks=Tracks(room=0))
        self.searching: Agent | None = None  # its grids, while there is no Gaussian belief
        self._moved: Joint | None = None  # where the team's joint has this robot, moved on to the newest tick
        self._team_ancestors: Mapping[str, float] = {}
        self._team_until = -math.inf  # team time (s) of this robot's newest readings that it contained when it came
        self._team_epoch = -1  # of the filter when it came
        self._board_came = False  # since the newest tick
        self._returns_until = -math.inf  # team time, seconds
        self._steps: deque[Step] = deque(maxlen=SNAPSHOTS)
        self._time: float | None = None  # team time of the newest readings, seconds

    def uses(self, subject: str) -> bool:
        """Whether a tick takes in what is agreed about a subject: about itself, and while it searches, what an `Agent` uses."""
        return subject == self.subject or (self.searching is not None and self.searching.uses(subject))

    def tick(self, readings: Readings, agreed: Mapping[str, TeamBelief]) -> tuple[list[Report], Solo]:
        """Take the readings; report first-hand and informed beliefs, and the evidence for the boards' joint.

        The solo message holds the first-hand beliefs on the robot and on objects; it is for a referee.
        """
        place = agreed.get(self.subject)
        readings = trackable(readings, [block for block in self.own.joint.blocks if isinstance(block, str)])
        told = self.filter.step(readings, self._linear(place))
        self._steps.append(Step(readings.time, told.motion, told.increment, told.compass))
        shown = self.team
        self._follow(None if self.feedback == "off" else place)
        if isinstance(self.filter, Given) and self.filter.gain is not None and shown is not None:
            ahead = Joint.of({self.subject: shown})
            self._move(ahead, Step(readings.time, told.motion, None))
            self.filter.independence.judge(self.subject, self.filter.gain, shown, ahead.moments(self.subject))
        said = replace(told, increment=told.unsent, returned=self._returned(readings.time, told))
        self.own.settle(readings.tick, 0.0 if self._time is None else max(0.0, readings.time - self._time), [told])
        # It has none to begin with, and looks for its place itself.
        if told.belief is None and isinstance(self.filter, Given):
            self._time = readings.time
            return [], solo_of(readings, {})
        if told.belief is None:
            reports, solo = self._search(readings, agreed)
        else:
            self.searching = None
            reports, solo = self._report(readings, told)
        self._time = readings.time
        told_own = {"evidence": pack_evidence(said), "unnamed": []}  # the evidence has what it cannot name
        return [r.model_copy(update=told_own) if r.subject == self.subject else r for r in reports], solo

    @property
    def team(self) -> Moments | None:
        """Where the team's joint has this robot, moved on to the newest tick, its whole block; None: it does not have it."""
        return None if self._moved is None else self._moved.moments(self.subject)

    def pose(self) -> Moments | None:
        """Where the robot is, (x, y, heading) with covariance, shape (3,) and (3, 3): as the team has it, else by its own readings.

        Boards take no claim for more than a fraction of a cell (`[board] sharpest`). So where a place is known that well, the own
        readings may tell more.
        """
        own = self.filter.belief
        state = own if self.team is None or self._is_sharper(own, self.team) else self.team
        if state is None:
            return None if self.searching is None else self.searching.pose()
        moments = Moments(state.mean[POSE].copy(), state.covariance[POSE, POSE].copy())
        return moments if np.trace(moments.covariance[AXES, AXES]) < KNOWN else None

    def _is_sharper(self, own: Moments | None, team: Moments) -> bool:
        """Whether the own belief knows more than the team's, which is fine, and fits it; not of a filter of the robot's own."""
        is_fine = np.trace(team.covariance[AXES, AXES]) < 2 * (FINE * self.grid.cell) ** 2
        if own is None or not is_fine or isinstance(self.filter, Given) or _volume(own) >= _volume(team):
            return False
        off = own.mean[POSE] - team.mean[POSE]
        off[HEADING] = wrap(float(off[HEADING]))
        return squared_distance(off, team.covariance[POSE, POSE]) <= quantile(GATE, len(off))

    def found(self) -> dict[str, float]:
        """What it and its team have found out of its sensors, by name."""
        return self.filter.found(self.team)

    def on_board(self) -> None:
        """A board has come: in its next ticks the robot returns what the team knew of it."""
        self._board_came = True

    def on_sent(self, choice: Sending) -> None:
        """What of the newest reports was sent: evidence that was not is gathered into that of the next tick."""
        own = [report.evidence for report in choice.reports if report.subject == self.subject]
        if not any(evidence is not None and evidence.increment is not None for evidence in own):
            self.filter.silent()
        if self.searching is not None:
            self.searching.on_sent(choice)

    # --- first-hand -----------------------------------------------------------------------------------------------------

    def _search(self, readings: Readings, agreed: Mapping[str, TeamBelief]) -> tuple[list[Report], Solo]:
        """Look for the pose on grids, and hand it over to the filter once there is one hypothesis.

        Where mates alone tell it, it is where the filter linearises, and no evidence: the joint has their sightings. It has no
        ranges and bearings alone of a robot that it does not know. So of these the pose is evidence, with half of its weight,
        because what it shares with the places of the mates is not told.
        """
        if self.searching is None:
            self.searching = Agent(self.robot, self.settings, self.grid, self.feedback, self.filter.untold)
        reports, solo = self.searching.tick(readings, agreed)
        self._moved = None
        pose = pose_of(self.searching.firsthand.localizer)
        if pose is None and (at := pose_of(self.searching.informed.localizer)) is not None:
            pose = Moments(at.mean, 2 * at.covariance if self.searching.informed.parts else NOTHING)
        if pose is not None:
            self.filter.enter(pose)
        return reports, solo

    def _report(self, readings: Readings, told: FilterResult) -> tuple[list[Report], Solo]:
        first = {
            subject: pack(belief, self.settings.coding)
            for subject, belief in sorted(self._firsthand(readings, told).items())
        }
        informed = self._informed(readings)
        reports = [
            report_of(readings, subject, belief, informed if subject == self.subject else None)
            for subject, belief in first.items()
        ]
        mates = {relative.subject for relative in told.relatives if relative.subject.startswith("robot/")}
        solo = {subject: belief for subject, belief in first.items() if subject not in mates}
        return reports, solo_of(readings, solo)

    def _firsthand(self, readings: Readings, told: FilterResult) -> dict[str, Belief]:
        """The beliefs about this robot, the objects that it knows, and the mates that it sees in this tick."""
        known = {subject: self.own.marginal(subject) for subject in {self.subject, *self.own.subjects()}}
        mates = [
            r
            for r in told.relatives
            if r.places and r.subject.startswith("robot/") and r.subject != self.subject and not is_class(r.subject)
        ]
        for mate, claim in zip(mates, claimed(self.own.joint, mates, {self.subject: told.motion}), strict=True):
            known[mate.subject] = claim.place()
        return {subject: self._drawn(moments) for subject, moments in known.items()}

    def _drawn(self, moments: Moments) -> Belief:
        return with_outlier(draw(self.grid, moments).p, self.grid, self.settings.vision.outlier)

    # --- the team -------------------------------------------------------------------------------------------------------

    def _until(self, place: TeamBelief | None) -> float | None:
        """The team time (s) of the newest readings of this robot that an agreed belief with a state contains."""
        return None if place is None or place.state is None else place.ancestors.get(self.robot)

    def _linear(self, place: TeamBelief | None) -> Moments | None:
        """What the team believed after the tick before: where the filter may linearise, which is no evidence."""
        until = self._until(place)
        return place.state if place and until is not None and until == self._time else None

    def _follow(self, place: TeamBelief | None) -> None:
        """Take the newest state of this robot in the team's joint, and predict it to now with the measurements since.

        A state that is older than the kept measurements is ignored.
        """
        newest, until = list(self._steps)[-1:], self._until(place)
        if place is not None and until is not None and self._team_until < until and self._steps[0].time <= until:
            self._moved = None if place.state is None else Joint.of({self.subject: place.state})
            self._team_until, self._team_ancestors = until, place.ancestors
            self._team_epoch = self.filter.epoch
            newest = [step for step in self._steps if step.time > until]
        if self._moved is not None:
            for step in newest:
                self._move(self._moved, step)

    def _move(self, joint: Joint, step: Step) -> None:
        """Move this robot on in a joint by what it measured in a tick."""
        drive(joint, self.subject, step.motion, self.filter.sensors.wheels.nuisance)
        if step.compass is not None:
            self._turn(joint, step.compass)
        gained = None if step.increment is None else likelihood(joint, self.subject, step.increment)
        if gained is not None:
            correct(joint, gained)

    def _turn(self, joint: Joint, reading: CompassReading) -> None:
        """Take a reading of the compass.

        The joint does not know by how much the compass is askew. So the first reading begins that error, and later ones tell the turn.
        """
        mount = compass_of(self.subject)
        if mount.block in joint:
            correct(joint, reading_factor(joint, self.subject, reading, mount))
        else:
            at = joint.blocks[self.subject].start + HEADING
            variance = float(joint.variances[at])
            off, prior = wrap(reading.heading - float(joint.mean[at])), reading.variance + variance
            add_with_heading(joint, mount, Moments(np.array([off]), np.array([[prior]])), -variance / prior)

    def _returned(self, time: float, told: FilterResult) -> Moments | None:
        """What the team knew of this robot before a board came, if that says more than the first-hand belief; shape (12,), (12, 12).

        The errors of all its ancestors' places may be the same, in a joint that is gone. Half of the weight is left for what
        robots tell first-hand, the others share the rest evenly: so nothing counts twice, as in a covariance intersection.
        """
        if self._board_came:
            self._board_came, self._returns_until = False, time + RETURNING
        sharing = len(self._team_ancestors) - 1
        if time > self._returns_until or self.team is None or sharing < 1 or told.epoch != self._team_epoch:
            return None
        returned = Moments(self.team.mean, 2 * sharing * self.team.covariance)
        own = told.belief
        if own is None or _volume(returned) >= _volume(own):
            return None
        return returned

    def _informed(self, readings: Readings) -> Informed | None:
        if self.team is None:
            return None
        drawn = self._drawn(Moments(self.team.mean[AXES], self.team.covariance[AXES, AXES]))
        belief: PackedBelief = pack(drawn, self.settings.coding)
        ancestors = capped({**self._team_ancestors, self.robot: readings.time}, lambda: {self.robot})
        return Informed(belief=belief, ancestors=dict(sorted(ancestors.items())))


def _volume(state: Moments) -> float:
    """Of the region in which a robot's pose is."""
    return float(np.linalg.det(state.covariance[POSE, POSE]))
