"""What a robot's wheels and camera are like before it has driven: wide, because it finds out by itself. Noise, and errors that last.

Sources of the lasting errors' sigmas. Scale of the way .15, of turns on the spot .1: odometry that nobody calibrated errs by
a few percent (Borenstein, Feng, IEEE TRA 12(6), 1996), commands in place of odometry by more. Turns on a curve .3: wheels that slip
sideways turn a robot by half of what was told (Mandow et al., IROS 2007). Lag .2 s: a controller and a link. Bearing .03 rad, range
.1: a camera that was fastened by hand, a focal length from the data sheet. Drift 3 mrad/s. The scale of the way wanders with the
floor, .05 in 100 s.

The noise was measured on one recording, and each robot finds by what factor its own differs (`noise.py`). The error along the way
grows by 0.010 m in a second and by 0.024 to 0.033 m / sqrt(s) over 16 to 64 s, because errors that follow each other are alike: the
fresh noise is that of the longer spans. The fresh noise of ranges and bearings is larger than measured, for the same reason.
A model of the correlations themselves (an error of the scale that lasts 2 s, range errors that last 0.7 and 7 s) did better while
landmarks were in view and was far too sure of itself without them. Units: metres or cells, radians, seconds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.classes import LANDMARK, is_class
from blackboard.opinion.gaussian.relation import Bias, Relative, measured
from blackboard.opinion.gaussian.vehicle import TRACK, Motion, Nuisance
from blackboard.wire.evidence import Seen
from blackboard.wire.gaussians import parts_of
from blackboard.wire.messages import Odometry, Readings, Sighting
from robot_agent.config import OdometrySection, RobotSection
from robot_agent.sensing import SEEN_FROM, SEEN_TO, position_sigma

#: The lasting errors of a wheeled robot.
WHEELED = Nuisance(
    forward=1.0,
    turn=1.0,
    sigmas=(0.15, 0.1, 0.003, 0.03, 0.0, 0.1, 0.1, 0.3, 0.2),
    walks=(0.005, 0.0, 0.0001, 0.0, 0.0, 0.0),
    alike=0.9,  # robots of one make differ from its mean by a third as much as makes differ from each other
)
ALIKE = 4 / 3  # times the sigma of a frame: bearings that follow each other err alike (correlation .60, after 8 s .28)
MAX_GROUPS = 1024  # of landmarks that stand together
#: Sigmas that are left once a robot was measured: of bearing, slip, range; of the drift, rad/s; of the lag, seconds.
MEASURED, MEASURED_DRIFT, MEASURED_LAG = (0.01, 0.0, 0.02), 0.002, 0.03
GUESSED = 0.25  # lower bound of the estimated factor of a variance that nobody gave
EXCESS = 3.0  # A given sigma of wheels may be estimated smaller by this factor at most.
STILL = 1e-9  # unit or radians: less is no motion


@dataclass(frozen=True)
class Wheels:
    """How odometry relates to motion."""

    nuisance: Nuisance = WHEELED
    along: float = 0.03  # unit / sqrt(s)
    across: float = 0.004  # unit / sqrt(s)
    heading: float = 0.02  # rad / sqrt(s), straight ahead
    turning: float = 0.1  # rad / sqrt(rad): of what is turned
    starting: float = 0.1  # rad per rad/s by which the turn rate changed since the tick before
    way: float = 0.0  # unit / sqrt(unit): of what is driven
    slip: float = 0.0  # sqrt(s): times the speed, along and across the way
    #: Whether somebody gave the noise along the way, of the heading, and across the way. Else it is a guess: the first two may be
    #: half as large, and the last a thousand times as large.
    given: tuple[bool, bool, bool] = (False, True, True)
    standing: float = 0.05  # the share of the sigmas that is left while the robot stands
    track: float = TRACK  # unit: from wheel to wheel; by it a curve differs from a turn on the spot
    curved: float = 1.0  # the scale of a way on a curve, over that straight ahead
    driven: float = 1.0  # the scale of a turn while it drives, over that on the spot
    lag: float = 0.0  # seconds by which it moves later than told
    drift: float = 0.0  # rad/s by which it turns more than told while it moves
    #: Share of the change of the turn since the step before by which the way's direction may differ from the middle of the turn:
    #: of a turn that begins or ends at any time within the step, half of 1 / sqrt(3).
    bends: float = 0.0

    def motion(self, told: Odometry, before: Odometry | None) -> Motion:
        """A tick's motion with its noise; `before` is the odometry of the tick before.

        A sigma that the odometry comes with stands for all of its fresh error.
        """
        moving = max(abs(told.distance), abs(told.turn), abs(told.aside)) > STILL
        time = told.dt * (1.0 if moving else self.standing**2)
        rise, change = 0.0, 0.0
        if before is not None:
            rise = told.distance / told.dt - before.distance / before.dt
            change = told.turn / told.dt - before.turn / before.dt
        curved, driven = parts_of(told, self.track)
        slipped = (self.slip * math.hypot(told.distance, told.aside)) ** 2 / told.dt if told.dt > 0 else 0.0
        along = self.along**2 * time + self.way**2 * abs(told.distance) + slipped
        heading = self.heading**2 * time + self.turning**2 * abs(told.turn) + (self.starting * change) ** 2
        distance, turn = told.distance + (self.curved - 1) * curved, told.turn + (self.driven - 1) * driven
        rise *= 1 + (self.curved - 1) * _share(curved, told.distance)
        change *= 1 + (self.driven - 1) * _share(driven, told.turn)
        distance -= self.lag * rise
        turn -= self.lag * change
        turn += self.drift * told.dt if moving else 0.0
        across = self.across**2 * time + slipped if told.distance_sigma is None else 0.0
        if told.curved is None:  # when within the step the robot turned is unknown, and so is the direction of its way
            across += (self.bends * change * told.dt * told.distance) ** 2
        if told.aside:  # the noise of a way to the side is that of the same way ahead
            fresh = along + self.way**2 * abs(told.aside) if told.distance_sigma is None else told.distance_sigma**2
            across += fresh * abs(told.aside) / math.hypot(told.distance, told.aside)
        return Motion(
            distance=distance,
            turn=turn,
            dt=told.dt,
            moving=told.dt if moving else 0.0,
            along=along if told.distance_sigma is None else told.distance_sigma**2,
            across=across,
            heading=heading if told.turn_sigma is None else told.turn_sigma**2,
            curved=self.curved * curved,
            driven=self.driven * driven,
            faster=rise,
            quicker=change,
            aside=told.aside,
        )


USUAL = Wheels()  # of a robot that nobody described


@dataclass(frozen=True)
class Camera:
    """How a sighting relates to where its subject is.

    Fresh and lasting errors of a range are `floor + share * range`. Barcodes less than `together` apart (landmarks come in
    groups) have them in common (correlation .86; 1.5 apart .02): several seen at once count as one.
    """

    floor: float = 0.03  # unit
    share: float = 0.07
    lasting_floor: float = 0.02  # unit
    lasting_share: float = 0.05  # a robot and what it sees differ by up to 8 % for minutes
    lasting: float = 100.0  # seconds
    bearing: float = 0.02  # radians
    bent: float = 0.2  # share of the turn, and of its change, by which the heading within a tick is not known
    bend: float = 0.05  # rad/s: at most so much
    together: float = 0.6  # unit
    profile: tuple[tuple[float, float], ...] = ()  # see `Relative.profile`; replaces all of these
    scale: float = 1.0  # true range over the measured one, without its bias
    bias: float = 0.0  # unit
    askew: float = 0.0  # radians: what a bearing reads too much

    def group(self, groups: dict[str, tuple[float, float]], landmark: str, place: tuple[float, float]) -> str:
        """The first landmark that was seen of those that stand together with this one; `groups` keeps their places, unit."""
        for first, there in groups.items():
            if math.dist(place, there) < self.together:
                return first
        if len(groups) < MAX_GROUPS:
            groups[landmark] = place
        return landmark

    def relative(
        self, robot: str, sighting: Sighting, turned: float, dt: float, group: str = "", alike: int = 1
    ) -> Relative:
        """A sighting as a relative belief; `turned` is the turn of the tick, or its change if that is larger.

        `alike` is how many of its group were seen in the tick. A sigma that the sighting comes with stands for all errors of
        its range but a scale, or of its bearing.
        """
        share = min(1.0, sighting.age / dt) if dt > 0 else 0.0
        inside = min(1.0, 4.0 * share * max(0.05, 1.0 - share))  # where the tick's heading is known least: halfway
        bent = min((self.bent * turned) ** 2, (self.bend * dt) ** 2) * inside
        return Relative(
            observer=robot,
            subject=sighting.subject,
            range=max(0.0, self.scale * (sighting.range - self.bias)),
            bearing=sighting.bearing - self.askew,
            range_variance=alike * (sighting.range_sigma or self.floor + self.share * sighting.range) ** 2,
            bearing_variance=(sighting.bearing_sigma or self.bearing) ** 2 + bent,
            age=sighting.age,
            biases=()
            if self.profile or sighting.range_sigma
            else (Bias(self.lasting_floor + self.lasting_share * sighting.range, self.lasting),),
            group=group,
            profile=() if sighting.range_sigma else self.profile,
        )


@dataclass(frozen=True)
class Sensors:
    """A robot's sensors as it models them."""

    wheels: Wheels = Wheels()
    camera: Camera = Camera()
    compass: float = 0.03  # radians, for one reading
    ranging: tuple[Bias, ...] = ()  # lasting errors of ranges alone, of each pair
    # The map: `landmark/door` -> where it stands.
    landmarks: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def least_noise(self, camera_judged: bool) -> tuple[float, float]:
        """Lower bounds of the factors by which `WheelNoise` multiplies the variances along the way and of the heading.

        A given variance is estimated no smaller than that of `Wheels()`, and by `EXCESS` in sigma at most. While no landmark has
        shown how noisy the camera is, it is not estimated smaller at all: with a camera model that is too noisy, wheels look too good.
        """
        wheels, most = self.wheels, EXCESS if camera_judged else 1.0
        along = _least_factor(most, (wheels.along, USUAL.along))
        heading = _least_factor(most, (wheels.heading, USUAL.heading), (wheels.turning, USUAL.turning))
        by = [1.0 if given else GUESSED for given in wheels.given]
        return by[0] * along, by[1] * heading

    def relative(self, robot: str, seen: Seen) -> Relative:
        """A sighting of a further kind that is known here as a relative belief, by the robot's model where it says no errors."""
        camera, covariance, biases = self.camera, seen.covariance, tuple(Bias(*bias) for bias in seen.biases)
        if seen.kind == "range":
            covariance = covariance or ((camera.floor + camera.share * seen.values[0]) ** 2,)
            biases = biases or self.ranging
        elif not covariance:
            covariance = (camera.bearing**2,)
        return measured(seen.kind, robot, seen.subject, seen.values, covariance, seen.age, biases, seen.group)  # type: ignore[arg-type]

    def unnamed(self, robot: str, readings: Readings, turned: float, dt: float) -> list[Relative]:
        """The sightings of which only the class is told, all of them; `turned` and `dt` as in `Camera.relative`."""
        seen_now: list[Sighting | Seen] = [*readings.sightings, *readings.seen]
        relatives = []
        for mark, sighting in enumerate(sighting for sighting in seen_now if is_class(sighting.subject)):
            if sighting.subject == LANDMARK:
                continue
            if isinstance(sighting, Sighting):
                seen = self.camera.relative(robot, sighting, turned, dt)
            elif sighting.is_known:
                seen = self.relative(robot, sighting)
            else:
                continue
            relatives.append(replace(seen, confidence=sighting.confidence, mark=mark))
        return relatives


def _least_factor(most: float, *sigmas: tuple[float, float]) -> float:
    """The smallest factor of variances, from 1 / most^2 to 1, with which no sigma of the pairs (given, usual) gets below the usual."""
    excess = min((given / usual for given, usual in sigmas if given > 0), default=1.0)
    return min(most, max(1.0, excess)) ** -2


def _share(part: float, whole: float) -> float:
    """Of a motion, from 0 to 1; 0 of one that is none."""
    return min(1.0, max(0.0, part / whole)) if abs(whole) > STILL else 0.0


def sensors_of(settings: RobotSection) -> Sensors:
    """The sensors of a robot that is configured by [robot].

    vision "position": (VI-.1) times its gain over the distances at which something is seen, and the odometry's sigmas.
    vision "range-bearing": its sigmas of one frame, and else the physics above, which holds for wheels and cameras like the
    recorded robots'.
    """
    vision, ranging = settings.vision, settings.ranging
    lasting = (Bias(ranging.bias, ranging.seconds),) if ranging.bias else ()
    places = {f"landmark/{name}": place for name, place in settings.landmarks.items()}
    if vision.kind != "position":
        camera = Camera(
            floor=vision.range_floor,
            share=vision.range_share,
            bearing=ALIKE * vision.bearing,
            scale=vision.range_scale,
            bias=vision.range_bias,
            askew=vision.bearing_bias,
        )
        wheels = wheels_of(settings.odometry) if settings.odometry.measured else Wheels()
        return Sensors(wheels, camera, settings.odometry.compass, lasting, places)
    distances = np.linspace(SEEN_FROM + 0.01, SEEN_TO - 0.01, 49)
    profile = tuple(zip(distances.tolist(), np.square(position_sigma(distances, vision)).tolist(), strict=True))
    wheels, camera = wheels_of(settings.odometry, ranging.scale), replace(Camera(), profile=profile)
    return Sensors(wheels, camera, settings.odometry.compass, lasting, places)


def wheels_of(odometry: OdometrySection, scale: float = 0.0) -> Wheels:
    """Wheels by the sigmas of [robot.odometry]; `scale` is the sigma of the scale of the ranges."""
    way, turn = odometry.distance_scale, odometry.turn_scale
    sigmas = (odometry.distance_lasting, odometry.turn_lasting, 0.0, 0.0, 0.0, scale, 0.0, 0.0, 0.0)
    nuisance = Nuisance(forward=way, turn=turn, sigmas=sigmas)
    if odometry.measured:  # once; and then these errors change slowly
        drift = WHEELED.sigmas[2] if odometry.drift is None else MEASURED_DRIFT
        sigmas = (*sigmas[:2], drift, *MEASURED, odometry.distance_lasting, odometry.turn_lasting, MEASURED_LAG)
        nuisance = Nuisance(way, turn, sigmas, WHEELED.walks)
    return Wheels(
        nuisance,
        along=odometry.along,
        across=odometry.across,
        heading=odometry.turn,
        turning=odometry.turning,
        given=(True, True, True),
        starting=0.0,
        standing=odometry.standing,
        curved=1.0 if odometry.curve_distance_scale is None else odometry.curve_distance_scale / way,
        driven=1.0 if odometry.curve_turn_scale is None else odometry.curve_turn_scale / turn,
        lag=odometry.lag,
        drift=odometry.drift or 0.0,
    )


def simulated(along: float, turn: float, compass: float, profile: tuple[tuple[float, float], ...]) -> Sensors:
    """Sensors whose only errors are fresh ones: the way's (`along`, unit / sqrt(unit)), the turn's (rad / sqrt(rad))."""
    wheels = Wheels(
        Nuisance(),
        along=0.0,
        across=0.0,
        heading=0.0,
        turning=turn,
        given=(True, True, True),
        starting=0.0,
        way=along,
        standing=0.0,
    )
    return Sensors(wheels, replace(Camera(), profile=profile), compass)
