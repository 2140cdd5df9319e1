"""Robot: a robot that says what its sensors tell, and gets its place in the team (docs/robots.md)."""

from __future__ import annotations

import logging
import math
import re
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from blackboard.client.agreed import TeamNews
from blackboard.client.arguments import Call, cut, shown
from blackboard.client.membership import Membership
from blackboard.errors import nearest
from blackboard.opinion.classes import LANDMARK, is_class
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import upper
from blackboard.opinion.grid import Grid
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Sighting
from blackboard.wire.names import OF_TEAM, SIGHTED
from blackboard.wire.types import LARGEST, LEAST

if TYPE_CHECKING:
    from robot_agent.driven import Driven, Independence, Pose, SinceStep

log = logging.getLogger(__name__)

FARTHEST = 60.0  # seconds from team time: a time of another clock, of which boards would take nothing


class Robot(Membership):
    """A robot among its team-mates: tell it what odometry and sensors say, then `step`; lengths in the grid's unit, angles in radians.

    It is `robot-agent` in this process: its own readings go into a filter here, and what they are worth goes to the team. Each call
    that is wrong is a ValueError that names the argument.
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        """As `Team`."""
        super().__init__(*arguments, **named)
        self._lock = threading.Lock()
        self._told: SinceStep | None = None  # since the last step
        self._own: bool | None = None  # whether it has a filter of its own; None: not known yet
        self._place: tuple[float, float, float] | None = None  # the newest in the frame of the odometry
        self._has_driven = False  # whether `odometry` was called since the last posterior
        self._jumps = 0  # times that its frame was said to have jumped
        self._fixed: tuple[float, float] | None = None  # where its newest fix has it
        self._warned: set[str] = set()  # of which arguments
        self._stepped = -math.inf  # team time of the newest step that had a time, seconds

    def _made(self, grid: Grid, news: TeamNews) -> Driven:
        from robot_agent.driven import driven

        self._driven = driven(
            news.on_news,
            self._scenario,
            team=self.name,
            sub_teams=self.sub_teams,
            robot=self.robot,
            grid=grid,
            joint=self._joint,
        )
        return self._driven

    # --- what the sensors tell ----------------------------------------------------------------------------------------

    def odometry(
        self,
        distance: float,
        turn: float,
        dt: float,
        distance_sigma: float | None = None,
        turn_sigma: float | None = None,
        *,
        aside: float = 0.0,
    ) -> None:
        """The robot drove a distance (forward is positive) and turned in `dt` seconds; sigmas of this piece [default: by the model].

        `aside` is how far it drove to its left, of one that can. `distance_sigma` holds for each direction then.

        Several pieces between two steps add up. A robot that stands says so: `odometry(0, 0, dt)`. After steps without any, one that
        has moved may have driven on as fast as before. One that never moved stands, unless its fixes show that it moves.
        """
        known = Call("odometry", self._warn)
        moved = Odometry(
            distance=known.number("distance", distance),
            turn=known.turn("turn", turn),
            dt=known.number("dt", dt, least=LEAST),
            distance_sigma=known.noise("distance_sigma", distance_sigma),
            turn_sigma=known.noise("turn_sigma", turn_sigma),
            aside=known.number("aside", aside),
        )
        if abs(moved.aside) > abs(moved.distance) and self._joined is not None and not self._joint:
            self._warn(
                "aside", 'its boards keep no joint, so what it drives to the side is left out: [board] fusion = "joint"'
            )
        self._warn_of_far("odometry", "distance", distance, math.hypot(moved.distance, moved.aside))
        self._tell(odometry=moved, own=None)
        self._has_driven = True

    def moved_to(
        self, pose: npt.ArrayLike, dt: float, distance_sigma: float | None = None, turn_sigma: float | None = None
    ) -> None:
        """The robot's newest pose (x, y, heading) in any frame that stays, as of visual odometry, `dt` seconds after the last.

        Only the way between two poses counts. After a jump of that frame call it once with `dt=0`.
        """
        known = Call("moved_to")
        x, y, heading = known.numbers("pose", pose, (3,))
        seconds = known.number("dt", dt, least=0.0)
        sigmas = known.noise("distance_sigma", distance_sigma), known.noise("turn_sigma", turn_sigma)
        with self._lock:
            last, self._place = self._place, (x, y, heading)
        if last is not None and seconds < LEAST and last[:2] != (x, y):
            self._jumps += 1
            if self._jumps > 1:
                self._warn(
                    "moved_to", "moved_to(dt=0) again: each time the way is lost; of poses of one stamp give one"
                )
        if last is not None and seconds >= LEAST:
            turn = math.remainder(heading - last[2], math.tau)
            way = last[2] + turn / 2
            distance = (x - last[0]) * math.cos(way) + (y - last[1]) * math.sin(way)
            aside = (y - last[1]) * math.cos(way) - (x - last[0]) * math.sin(way)
            self.odometry(distance, turn, seconds, *sigmas, aside=aside)

    def compass(self, heading: float, sigma: float | None = None) -> None:
        """The robot's heading in the team's frame, as a compass says it: 0 along x, counter-clockwise."""
        known = Call("compass", self._warn)
        self._tell(compass=(known.angle("heading", heading), known.sigma("sigma", sigma)))

    def fix(
        self, position: npt.ArrayLike, sigma: float, heading: float | None = None, heading_sigma: float | None = None
    ) -> None:
        """Where the robot is in the team's frame, as of GPS, or where it starts.

        Of two between steps the newest place counts, and the newest heading. The same one again counts once.
        """
        known = Call("fix", self._warn)
        x, y = known.numbers("position", position, (2,))
        if heading_sigma is not None and heading is None:
            raise ValueError(f"fix(heading_sigma={heading_sigma!r}): give heading too")
        if heading is not None and heading_sigma is None:
            raise ValueError("fix(heading_sigma=None): give the sigma of the heading, in radians")
        turned: dict[str, Any] = {}
        if heading is not None:
            sigma_of_heading = known.sigma("heading_sigma", heading_sigma)
            turned = {"heading": known.angle("heading", heading), "heading_sigma": sigma_of_heading}
        self._warn_outside("fix", x, y)
        if self._fixed == (x, y):
            self._warn(
                "fix again", f"the same fix again, at ({x:g}, {y:g}), counts once: does its receiver see satellites?"
            )
        self._fixed = x, y
        self._tell(fix=Fix(position=(x, y), sigma=known.number("sigma", sigma, least=LEAST), **turned))

    def see(
        self,
        subject: str,
        range: float | None = None,
        bearing: float | None = None,
        range_sigma: float | None = None,
        bearing_sigma: float | None = None,
        position: npt.ArrayLike | None = None,
        covariance: npt.ArrayLike | None = None,
        *,
        at: npt.ArrayLike | None = None,
        age: float = 0.0,
        confidence: float = 1.0,
    ) -> None:
        """The robot sees `robot/r2`, `object/ball`, ...: at a range, a bearing (0: ahead, counter-clockwise), both, or a position.

        A `position` (ahead, to the left) is in the robot's own frame, its `covariance` of shape (2, 2). With a third number, the
        heading less the robot's own, it is a pose, and that of shape (3, 3). `at` is where a landmark stands in the team's frame;
        `age` are seconds since it was seen. Of the ranges with bearings to one subject the newest counts. Where it does not know which
        one it sees, the subject is a class: `robot/?`, `person/?`, `object/ball?`, or `landmark/?` of the scenario's map. `confidence`
        is how sure the detector is.
        """
        known = Call("see")
        self._check_seen(subject, alone=range is None or bearing is None, at=at)
        self._warn_of_stranger(subject)
        common: dict[str, Any] = {
            "subject": subject,
            "landmark": None if at is None else known.numbers("at", at, (2,)),
            "age": known.number("age", age, least=0.0),
            "confidence": known.share("confidence", confidence),
        }
        if position is not None:
            if not (range is bearing is range_sigma is bearing_sigma is None):
                raise ValueError("see(position=...): give either a position or a range and a bearing")
            self._see_position(known, position, covariance, common)
            return
        if covariance is not None:
            raise ValueError("see(covariance=...): belongs to a position; give range_sigma and bearing_sigma")
        if range is bearing is None:
            raise ValueError("see(range=None): give a range, a bearing, both, or a position")
        sigmas = known.sigma("range_sigma", range_sigma), known.sigma("bearing_sigma", bearing_sigma)
        far = None if range is None else known.number("range", range, least=0.0)
        angle = None if bearing is None else known.bearing("bearing", bearing)
        if far is not None:
            self._warn_of_seen("range", range, far, subject)
        if far is not None and angle is not None:
            both = Sighting(range=far, bearing=angle, range_sigma=sigmas[0], bearing_sigma=sigmas[1], **common)
            self._tell(own=None, sightings=(both,))
            return
        for name, value, sigma in (("range", far, sigmas[0]), ("bearing", angle, sigmas[1])):
            if value is not None:
                if sigma is not None and sigma**2 > LARGEST:
                    most = f"is larger than {math.sqrt(LARGEST):g}, which no message holds: has it another unit?"
                    raise known.wrong(f"{name}_sigma", sigma, most)
                one = Seen(kind=name, values=(value,), covariance=() if sigma is None else (sigma**2,), **common)
                self._tell(own=None, seen=(one,))
            elif sigma is not None:
                raise ValueError(f"see({name}_sigma={sigma!r}): give {name} too")

    def _see_position(
        self, known: Call, position: npt.ArrayLike, covariance: npt.ArrayLike | None, common: dict[str, Any]
    ) -> None:
        """A sighting of two numbers, or with the heading of three."""
        if covariance is None:
            raise ValueError("see(covariance=None): give the covariance of the position, shape (2, 2)")
        size = 3 if known.shape(position) == (3,) else 2
        values = known.numbers("position", position, (size,))
        if math.hypot(*values[:2]) > LARGEST:
            raise known.wrong(
                "position", position, f"is farther than {LARGEST:g}, which no message holds: has it another unit?"
            )
        matrix = known.covariance("covariance", covariance, size)
        self._warn_of_seen("position", position, math.hypot(*values[:2]), common["subject"])
        kind = ("position", "pose")[size - 2]
        self._tell(own=None, seen=(Seen(kind=kind, values=values, covariance=upper(matrix), **common),))

    # --- a filter of one's own ----------------------------------------------------------------------------------------

    def belief(self, mean: npt.ArrayLike, covariance: npt.ArrayLike, odometry: npt.ArrayLike | None = None) -> None:
        """The posterior (x, y, heading) of the robot's own filter, with covariance (3, 3), and the odometry since the one before.

        `odometry` is (distance, turn, dt), or (distance, turn, dt, distance_sigma, turn_sigma) where you know what noise your filter
        gives it; of a robot that drives sideways with the way to its left behind that. Leave it out where you call `odometry` in
        each step, as for a filter that is slower than the wheels. What the posterior gained over its prediction goes to the team,
        once. Nothing that came from the team may be in it: neither `pose` nor `agreed`. Sightings of mates and objects go to `see`
        as before, fixes and landmarks into your filter.
        """
        known = Call("belief", self._warn)
        x, y, heading = known.numbers("mean", mean, (3,))
        place = np.array([x, y, known.angle("heading", heading)])
        self._posterior(known, place, known.covariance("covariance", covariance, 3), odometry)

    def particles(
        self, particles: npt.ArrayLike, odometry: npt.ArrayLike | None = None, weights: npt.ArrayLike | None = None
    ) -> None:
        """The same for a particle filter: (x, y, heading) of each, shape (N, 3); weights [default: equal] in any scale.

        While they have several hypotheses, the odometry alone counts.
        """
        from robot_agent.driven import of_particles

        known = Call("particles", self._warn)
        points = known.array("particles", particles, 3)
        known.turn("heading", max(points[:, 2], key=abs))
        if not np.ptp(points, axis=0).any():
            self._warn(
                "particles", "particles(particles=...): are all alike, and say that the pose is certain: spread them"
            )
        share = None if weights is None else known.weights("weights", weights, len(points))
        posterior = of_particles(points, share)
        mean, covariance = (None, None) if posterior is None else (posterior.mean, posterior.covariance)
        self._posterior(known, mean, covariance, odometry)

    @property
    def independence(self) -> Independence | None:
        """Of a robot that gives beliefs: how independent of the team's belief they are; `fed_back` where they come from it.

        `too_small` is the factor by which the filter's variances are too small, as the moves of its posteriors show. The team divides
        the information of what they gain by it.
        """
        return self._desk.call(lambda now: (self._driven.independence, []))

    def _posterior(self, known: Call, mean: Any, covariance: Any, odometry: npt.ArrayLike | None) -> None:
        moved = None if odometry is None else self._piece(known, odometry)
        if (moved is None) != self._has_driven and (moved is not None or self._own):
            told = "was told by odometry() since the last one: leave it out here"
            untold = "give (distance, turn, dt) since the last one, or call odometry() as it comes"
            raise known.wrong("odometry", odometry, told if self._has_driven else untold)
        posterior = None if mean is None else Moments(mean, covariance)
        if posterior is not None:
            self._warn_outside("belief", *posterior.mean[:2])
        self._tell(odometry=moved, posterior=posterior, own=True)
        self._has_driven = False

    def _piece(self, known: Call, odometry: npt.ArrayLike) -> Odometry:
        size = next((size for size in (4, 5, 6) if known.shape(odometry) == (size,)), 3)
        distance, turn, dt, *sigmas = known.numbers("odometry", odometry, (size,))
        aside = sigmas.pop() if size in (4, 6) else 0.0
        if size == 4 and aside:
            text = "has 4 numbers: the last is the way to the left; one with sigmas has both of them, and so 5 numbers"
            self._warn("4 numbers", str(known.wrong("odometry", odometry, text)))
        if dt < LEAST:
            raise known.wrong("odometry", odometry, f"dt is {dt:g}; give the seconds that it took, at least {LEAST:g}")
        told = dict(zip(("distance_sigma", "turn_sigma"), sigmas, strict=False))
        for name, sigma in told.items():
            if sigma < 0:
                raise known.wrong(
                    "odometry", odometry, f"{name} is {sigma:g}; give at least 0, or leave the sigmas out"
                )
        return Odometry(distance=distance, turn=turn, dt=dt, aside=aside, **told)

    # --- the place in the team ----------------------------------------------------------------------------------------

    def step(self, time: float | None = None) -> Pose | None:
        """Process all that was given since the last step, and send it to the team: where the robot is, None while its place is
        unknown.

        `time` is the team time (s) of what was given [default: now]. Call it a few times per second. Refused: with `strict`,
        what a board has refused.
        """
        if time is not None:
            known = Call("step")
            stamp, now = known.number("time", time), self.time
            if stamp < self._stepped:
                raise ValueError(f"step(time={time!r}): is before the last step, at {self._stepped!r}")
            if abs(stamp - now) > FARTHEST:
                raise known.wrong("time", time, f"give team time in seconds, as `robot.time`, which is {now:.1f}")
            if stamp > now + self._settings.future:
                most = f"boards take at most {self._settings.future:g} s"
                raise known.wrong("time", time, f"is {stamp - now:.1f} s ahead of team time; {most}")
            self._stepped = stamp
        self._raise_refused()
        with self._lock:
            told, self._told = self._told, None
        return self._desk.call(lambda now: self._driven.step(told, now, time))

    @property
    def pose(self) -> Pose | None:
        """Where the robot was at its last step, as the team has it now."""
        return self._desk.call(lambda now: (self._driven.pose(), []))

    def _warn(self, what: str, text: str) -> None:
        """Log a sentence, once for each `what`."""
        if what not in self._warned:
            self._warned.add(what)
            log.warning("%s: %s", self.robot, text)

    def _warn_outside(self, what: str, x: float, y: float) -> None:
        """Say once that a place is outside the team's grid."""
        if self._grid is not None and self._grid.index((x, y)) is None:
            self._warn(what, f"a {what} at ({x:g}, {y:g}) is outside the team's grid: has it another unit or frame?")

    def _warn_of_seen(self, argument: str, value: object, distance: float, subject: str) -> None:
        """As `_warn_of_far`; a landmark may stand outside of the grid."""
        if not subject.startswith("landmark/"):
            self._warn_of_far("see", argument, value, distance)

    def _warn_of_far(self, method: str, argument: str, value: object, distance: float) -> None:
        """Say once of an argument that it is a longer way than the team's grid is large."""
        size = math.inf if self._grid is None else self._grid.cell * math.hypot(*self._grid.shape)
        if distance > size:
            text = f"is farther away than the map is large, {size:.3g} from corner to corner: has it another unit?"
            self._warn(f"{method} {argument}", f"{method}({argument}={shown(value)}): {text}")

    def _warn_of_stranger(self, subject: str) -> None:
        """Say once of a mate that the scenario does not name, where boards admit no guests as far as the scenario says.

        Of another team, or of one in which this robot is a guest itself, the scenario does not say who is there.
        """
        team, mate = None if self._scenario is None else self._scenario.team, subject.removeprefix("robot/")
        if team is None or mate == subject or OF_TEAM in mate or is_class(subject) or not team.is_guest(mate):
            return
        if team.guests == "vote" or team.name != self.name or team.is_guest(self.robot):
            return
        there = f"give a robot of the scenario ({cut(', '.join(team.robots))})"
        cure = f'{there}, or admit this one: [team] guests = "vote"{nearest(mate, team.robots)}'
        self._warn(f"see {subject}", f"see(subject={shown(subject)}): {cure}")

    def _check_seen(self, subject: object, *, alone: bool, at: object) -> None:
        """ValueError: a robot cannot see this; `alone` is a sighting without a range, or without a bearing."""
        if not isinstance(subject, str) or (subject != LANDMARK and not re.fullmatch(SIGHTED, subject)):
            raise ValueError(
                f"see(subject={shown(subject)}): give robot/NAME, object/NAME, landmark/NAME, or a class as robot/?"
            )
        if subject == f"robot/{self.robot}":
            raise ValueError(f"see(subject={shown(subject)}): is this robot itself")
        if subject == LANDMARK and alone:
            raise ValueError(f"see(subject={shown(subject)}): of a landmark of the map give a range and a bearing")
        if (subject.startswith("landmark/") and subject != LANDMARK) == (at is None):
            where = "give where the landmark stands" if at is None else "belongs to a landmark/NAME"
            raise ValueError(f"see(at={shown(at)}): {where}")

    def _tell(self, *, own: bool | None = False, **told: Any) -> None:
        """`own`: of a robot with a filter of its own, or without one; None: of both."""
        from robot_agent.driven import SinceStep

        if own is not None and self._own not in (own, None):
            raise ValueError(
                f"{self.robot}: gives either compass and fixes, or beliefs of a filter of its own; take them into that filter"
            )
        self._own = self._own if own is None else own
        with self._lock:
            self._told = (self._told or SinceStep()).plus(SinceStep(**told))
