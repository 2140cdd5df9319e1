"""Evidence for a joint board on the wire: what a robot gained in a tick, as a Gaussian, beside the belief that it reports.

The shapes are those of `blackboard.opinion.gaussian`: a state has 12 entries (x, y, heading, forward and turn scale, drift, bearing
bias, slip, range scale, curved way and turn, lag). A robot without the last three sends 9, and so do older members. A symmetric matrix
of n rows is sent as its upper triangle, row by row, n (n + 1) / 2 numbers.
"""

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from blackboard.opinion.gaussian.relation import NUMBERS, triangle
from blackboard.opinion.gaussian.tracks import MAX_TRACKS
from blackboard.opinion.gaussian.vehicle import STATES
from blackboard.wire.types import (
    LARGEST,
    LEAST,
    MAX_OPINIONS,
    Confidence,
    Finite,
    Listed,
    ListedRows,
    Message,
    Name,
    NonNegative,
    Part,
    Point,
    Sighted,
    Subject,
    Text,
    Tick,
)

FORMER = 9  # states of a robot whose scales do not depend on the kind of motion
MAX_RELATIVES = 64
MAX_PROFILE = 64
MAX_VALUES = 8
MOST_ALIKE = 0.99
MOST_LOG = 4.0  # binary logarithm of a factor of noise: 16 times; robots estimate up to 8
MOST_NOISE = 2048.0  # a factor of a compass's sigma: robots estimate up to 1024
TIED = 1e-9  # the least eigenvalue of a sighting's covariance, of its scale


State = Annotated[tuple[Finite, ...], Field(min_length=FORMER, max_length=STATES), Listed]
Triangle = Annotated[
    tuple[Finite, ...], Field(min_length=FORMER * (FORMER + 1) // 2, max_length=STATES * (STATES + 1) // 2), Listed
]


#: The sigma of a bias that lasts, and for how many seconds.
LastingBias = Annotated[tuple[NonNegative, Annotated[float, Field(gt=0, le=LARGEST)]], Listed]


#: Mean and sigma of the binary logarithm of an estimated factor. The sigma is 1 before anything was seen.
Factor = Annotated[tuple[Annotated[float, Field(ge=-MOST_LOG, le=MOST_LOG)], NonNegative], Listed]


def _check_sizes(upper: Sequence[float], *rows: Sequence[float]) -> None:
    """ValueError: a row has not as many numbers as the matrix has rows."""
    sizes = {len(row) for row in rows}
    if not sizes <= {FORMER, STATES} or {n * (n + 1) // 2 for n in sizes} != {len(upper)}:
        raise ValueError(f"a state has {FORMER} or {STATES} numbers, and its matrix is a triangle of as many rows")


class PackedState(Part):
    """The states are x, y, heading; forward and turn scale, drift, bearing bias, slip, range scale; and what differs
    by kind of motion: by how much the scale of the way is larger on a curve, by how much the scale of a turn is
    larger while driving, and by how many seconds the motion lags behind the odometry. A robot that does not know
    the last three leaves them out everywhere, and so do older members; they count as 0. Of a robot without such errors
    both scales are 1 and the rest is 0, with variances of 0. A heading may be told in any turn.
    """

    mean: State
    """of the states above"""
    covariance: Triangle
    """upper triangle"""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _check_sizes(self.covariance, self.mean)
        return self


class PackedPose(Part):
    """Where an object is, in the team's frame: finer than the cells of a belief."""

    mean: Point
    """x and y, in the grid's unit"""
    covariance: Annotated[tuple[NonNegative, Finite, NonNegative], Listed]
    """upper triangle"""


class PackedVelocity(Part):
    """In the team's frame: along x and y in units per second; of a robot also how fast it turns, radians per second."""

    mean: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3), Listed]
    """2 or 3 numbers"""
    covariance: Annotated[tuple[Finite, ...], Field(min_length=3, max_length=6), Listed]
    """upper triangle"""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        if len(self.covariance) != len(self.mean) * (len(self.mean) + 1) // 2:
            raise ValueError("a velocity of n numbers has a covariance of n (n + 1) / 2, its upper triangle")
        return self


class PackedIncrement(Part):
    """The likelihood exp(v d - d I d / 2) of d = state - reference: what the robot's own sensors (fix, compass, landmarks)
    measured in the tick. A sighting of a mate or an object is not in it. Of independent measurements z = h(state) + noise of
    covariance R, with the derivative H of h at the reference, I is the sum of H^T R^-1 H, and v that of H^T R^-1 (z - h(reference)).
    """

    reference: State
    """the prediction's mean"""
    information: Triangle
    """I, upper triangle, without negative eigenvalues"""
    vector: State
    """v"""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _check_sizes(self.information, self.reference, self.vector)
        return self


class PackedMotion(Part):
    """The odometry since the epoch began, summed up, so that a lost report loses no motion: the fields of a `Motion` in its order.
    It is not that of the tick. A robot that lost Readings adds what it may have driven meanwhile to the variances.
    """

    distance: Finite
    """forward, in the grid's unit, as the odometry measured it"""
    turn: Finite
    """radians, as the odometry measured it"""
    time: NonNegative
    """seconds"""
    moving: NonNegative
    """seconds of them in motion"""
    along: NonNegative
    """variance along the way, unit^2"""
    across: NonNegative
    """variance across it, unit^2"""
    heading: NonNegative
    """variance of the heading, radians^2"""
    curved: Finite = 0.0
    """what of `distance` was driven on a curve"""
    driven: Finite = 0.0
    """what of `turn` was not on the spot, radians"""
    faster: Finite = 0.0
    """by how much the speed grew, unit/s"""
    quicker: Finite = 0.0
    """by how much the rate of the turn grew, radians/s"""
    aside: Finite = 0.0
    """to the left, in the grid's unit, as the odometry of a robot measured it that can drive sideways"""


class PackedNuisance(Part):
    """How the lasting errors of wheels and camera behave (`vehicle.Nuisance`); a memory of 0 s is for ever. A robot whose filter
    does not estimate its wheels may say all the same how far they may be off: sigmas here, their squares as variances in
    `state`. The joint then finds by how much they are.
    """

    forward: Finite
    """forward scale at the start"""
    turn: Finite
    """turn scale at the start"""
    sigmas: Annotated[tuple[NonNegative, ...], Field(min_length=6, max_length=9), Listed]
    """at the start: forward and turn scale, drift, bearing bias, slip, range scale; curved way, curved turn, lag"""
    walks: Annotated[tuple[NonNegative, ...], Field(min_length=3, max_length=6), Listed]
    """random walks of both scales and the drift, of curved way, curved turn and lag, per square root of a second"""
    memory: Annotated[tuple[NonNegative, ...], Field(min_length=3, max_length=3), Listed]
    """seconds after which bearing bias, slip and range scale are forgotten; 0: never"""
    alike: Annotated[NonNegative, Field(le=MOST_ALIKE)] = 0.0
    """share of the variances of scales and lag that robots which tell the same numbers here have in common, being of one make"""


class PackedCamera(Part):
    """A robot's estimate, by landmarks, of its camera's true noise over its model's. The variances of its `relatives` are scaled by it
    already. A joint scales them further, by the estimates of robots that tell the same `model` and `nuisance`: its `alike` is
    the share that they have in common.
    """

    model: Annotated[tuple[NonNegative, ...], Field(min_length=1, max_length=MAX_VALUES), Listed]
    """the sigmas of the model, in any order: estimates over another model are not compared"""
    range: Factor
    """of the sigma of a range"""
    bearing: Factor
    """of the sigma of a bearing"""


class PackedCompass(Part):
    """A reading of a compass that may be askew, at the end of the tick. All readings err alike, so it is not in `increment`."""

    heading: Finite
    """radians, as the compass reads"""
    sigma: Annotated[float, Field(ge=LEAST, le=LARGEST)]
    """of its fresh error, as the compass claims, radians"""
    noise: Annotated[float, Field(ge=1.0, le=MOST_NOISE)] = 1.0
    """by which factor the noise was found to be larger than `sigma`"""
    most: Annotated[float, Field(ge=1.0, le=MOST_NOISE)] | None = None
    """the largest value that `noise` may have, one sigma above the estimate; none: not known yet"""
    bias: Finite = 0.0
    """by how much it was found to read too much, radians"""
    bias_sigma: Annotated[float, Field(ge=0.0, le=LARGEST)] = 0.0
    """sigma of that, radians"""
    tie: Annotated[float, Field(ge=-LARGEST, le=LARGEST)] = 0.0
    """regression coefficient of the heading in `state` on that error; -1 where the heading rests on the compass alone"""


class PackedRelative(Part):
    """Numbers that no robot has are refused (`fields`): a place, a distance, or a variance of either above 1e7; an
    angle, a scale, or an error of either above 1000.
    """

    subject: Sighted
    """what is seen, or its class"""
    range: NonNegative
    """in the grid's unit"""
    bearing: Finite
    """radians from the robot's heading"""
    range_variance: NonNegative
    """of its fresh error, unit^2"""
    bearing_variance: NonNegative
    """of its fresh error, radians^2"""
    age: NonNegative = 0.0
    """seconds before the end of the tick"""
    biases: Annotated[list[LastingBias], Field(max_length=4)] = Field(default_factory=list)
    """errors of the range that last so many seconds"""
    group: Annotated[str, Field(max_length=80)] = ""
    """sightings with one name share these errors; empty: those of the subject"""
    confidence: Confidence = 1.0
    """how sure the detector is that something is there"""
    mark: Tick | None = None
    """of an unnamed one: its number among those of the tick's Readings, `landmark/?` too, `sightings` first and then
    `seen`, from 0
    """


class Seen(Part):
    """A sighting that is no range with a bearing. In Readings of a robot's sensors, and in PackedEvidence of what a
    joint shall take. A reader leaves out the kinds that it does not know, and its status counts them
    (`unknown_kinds`); a member that is older than this field reads none of it.

    - `"range"`: `values` is the range, in the grid's unit, 0 or more. A joint takes it about what it knows. An
      object that is known by ranges or bearings alone enters once they leave one place; while they leave a few, as
      mirror images, what is agreed on is in one of these, each with its weight (`parameters` then has `places`). A
      robot enters by its state.
    - `"bearing"`: radians from the robot's heading. The same.
    - `"position"`: x ahead and y to the left of the robot, in the grid's unit.
    - `"pose"`: x, y, and the subject's heading less the robot's, in radians. The heading counts where the subject
      is a robot.
    """

    subject: Sighted
    """what is seen, or its class"""
    kind: Text
    """one of the above"""
    values: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_VALUES), Listed]
    """what was measured"""
    covariance: Annotated[tuple[Finite, ...], Field(max_length=MAX_VALUES * (MAX_VALUES + 1) // 2), Listed] = ()
    """of the fresh errors of `values`: upper triangle, positive definite, variances at least 1e-12; in Readings empty
    for a range or a bearing by the robot's model
    """
    landmark: Point | None = None
    """in Readings: the surveyed position, for a landmark or an anchor"""
    age: NonNegative = 0.0
    """seconds before the end of the tick"""
    biases: Annotated[list[LastingBias], Field(max_length=4)] = Field(default_factory=list)
    """errors of the range that last so many seconds"""
    group: Annotated[str, Field(max_length=80)] = ""
    """as in PackedRelative"""
    confidence: Confidence = 1.0
    """how sure the detector is that something is there"""
    mark: Tick | None = None
    """as in PackedRelative"""

    @property
    def is_known(self) -> bool:
        """Whether the kind is known here."""
        return self.kind in NUMBERS

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        size = NUMBERS.get(self.kind)
        if size is None:
            return self
        if len(self.values) != size:
            raise ValueError(f"a {self.kind} has {size} values, not {len(self.values)}")
        if self.kind == "range" and self.values[0] < 0:
            raise ValueError("a range is not negative")
        if not self.covariance and size == 1:
            return self
        if len(self.covariance) != size * (size + 1) // 2:
            raise ValueError(f"the covariance of a {self.kind} is {size * (size + 1) // 2} numbers")
        matrix = triangle(self.covariance)
        scale = np.sqrt(np.maximum(np.diag(matrix), LEAST**2))
        if np.diag(matrix).min() < LEAST**2 or np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] < TIED:
            raise ValueError("the covariance must be positive definite")
        return self


class PackedEvidence(Part):
    """What a robot contributes to the joint in one tick, numbered by its source, its epoch and the tick."""

    epoch: Annotated[int, Field(ge=0, lt=1 << 53)]
    """grows with each beginning of the filter: the team time then, in ms"""
    travelled: PackedMotion
    """the odometry since the epoch began, summed"""
    nuisance: PackedNuisance
    """how the lasting errors behave"""
    state: PackedState | None = None
    """the first-hand belief after the tick, what it gained included, from which a robot enters the joint; none: it has
    several hypotheses, and
    `belief` counts; or it is in the joint, and leaves it out to save bytes
    """
    increment: PackedIncrement | None = None
    """what was gained in this tick over the prediction; none: nothing, as in the tick in which an epoch begins"""
    relatives: Annotated[list[PackedRelative], Field(max_length=MAX_RELATIVES)] = Field(default_factory=list)
    """the newest sighting of each mate and object"""
    profile: Annotated[list[tuple[NonNegative, NonNegative]], Field(max_length=MAX_PROFILE), ListedRows] = Field(
        default_factory=list
    )
    """instead of range and bearing variances: pairs of a true distance (unit) and the variance of the seen position in
    each coordinate (unit^2), by growing distance, interpolated
    """
    seen: Annotated[list[Seen], Field(max_length=MAX_RELATIVES)] = Field(default_factory=list)
    """sightings of further kinds, with their covariances"""
    returned: PackedState | None = None
    """for 3 s after a board came, if it is sharper than `state`: the newest `state` that was agreed, moved on by the robot's own
    measurements, its covariance times 2 (n - 1); n robots are its ancestors
    """
    camera: PackedCamera | None = None
    """how noisy the camera is; none: its noise is not found, or each sighting says its own"""
    compass: PackedCompass | None = None
    """the heading by a compass; none: there is no compass, or `increment` has it. Older boards do not know it"""

    @property
    def subjects(self) -> list[str]:
        """What was seen, in all kinds of sightings."""
        return [*(sighting.subject for sighting in self.relatives), *(sighting.subject for sighting in self.seen)]


class Forwarded(Part):
    """The evidence of one robot in one tick, as its board took it from the robot's report."""

    robot: Name
    """whose"""
    tick: Tick
    """the tick of the robot's report"""
    evidence: PackedEvidence
    """as it was reported"""
    age: Finite = 0.0
    """seconds from the `time` of the report, by the board's clock, to that of the Forward"""


class PackedTrack(Part):
    """Where a board has something that nobody named, under the name that it gave."""

    name: Subject
    """as `person/7`"""
    mean: Point
    """in the grid's unit"""
    covariance: Annotated[tuple[NonNegative, Finite, NonNegative], Listed]
    """upper triangle"""


class Forward(Message):
    """With `[board] fusion = "joint"`, a board passes on what its robots gained, before it says `"consensus"`: every
    board settles all evidence.
    """

    board: Name
    """which board; the same as in the key"""
    sub_team: Name
    """its sub-team; the same as in the key"""
    tick: Tick
    """the tick that is being settled"""
    time: Finite
    """team time, seconds"""
    evidence: Annotated[list[Forwarded], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """what its robots reported since the last one"""
    since: Finite | None = None
    """team time, seconds, since which it keeps its joint: boards that began later call tracks as it does"""
    tracks: Annotated[list[PackedTrack], Field(max_length=MAX_TRACKS)] = Field(default_factory=list)
    """those that have names, before this tick is settled"""
