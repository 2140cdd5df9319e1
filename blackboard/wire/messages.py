"""The messages between processes: one model each, unknown fields ignored, everything bounded.

Times are team time in seconds: the world's clock where a world runs, Unix time on real robots. Positions and ranges are
in the grid's unit, angles in radians, counter-clockwise. Subjects are `robot/<id>`, `object/<name>`, `person/<name>` or
`landmark/<name>`.
"""

from typing import Annotated, Literal

from pydantic import Field

from blackboard.opinion.classes import numbered
from blackboard.opinion.rules import Outcome
from blackboard.wire.evidence import Forward, PackedEvidence, PackedPose, PackedState, PackedVelocity, Seen
from blackboard.wire.memory import Memory
from blackboard.wire.names import MAX_FRAME
from blackboard.wire.raw import MAX_BYTES, MAX_ITEMS
from blackboard.wire.types import (
    MAX_OPINIONS,
    Ancestors,
    Class,
    Confidence,
    Count,
    Counts,
    Finite,
    InView,
    Listed,
    Message,
    Name,
    Names,
    NonNegative,
    Part,
    Point,
    Positive,
    Settings,
    Subject,
    Subjects,
    Text,
    Tick,
)

#: Why a message was refused: the one table of reasons, in the order in which they are looked for.
REASONS = {
    "wild-key": "published on a key expression with a wildcard, or on a key of no known form",
    "too-large": "more bytes than a message may have",
    "not-msgpack": "not a msgpack map",
    "version": "of another protocol version",
    "fields": "a field is missing, of the wrong type or out of its bounds",
    "impostor": "says another source, subject or sub-team than its key",
    "grid": "a belief on another grid than the team's",
    "frame": "a belief in another frame than the team's",
    "mass": "NaN, infinite, negative or no probability mass",
    "future": "stamped in the future",
    "past": "stamped too long ago",
    "unregistered": "from a robot or a board without a liveliness token in the sub-team",
    "guest": "from a robot that the scenario does not name, which may only listen",
    "too-many": "more subjects or sources than a board keeps",
    "backwards": "evidence whose summed times or variances shrink within an epoch",
}

MAX_JOURNAL_NAME = 512  # characters; no key of a topic is longer
MAX_UNNAMED = 16  # things in one report of which only the class is known
MAX_CELLS = 1 << 20  # the largest grid that is unpacked


# --- beliefs -----------------------------------------------------------------------------------------------------------


class PackedGrid(Part):
    """Must be the team's grid, number for number. `frame` is compared only where both name one; the status of a board
    has the team's grid.
    """

    shape: Annotated[tuple[Annotated[int, Field(ge=1, le=MAX_CELLS)], ...], Field(min_length=1, max_length=3), Listed]
    """cells along each axis, x first"""
    cell: Positive
    """edge of a cell, in `unit`"""
    origin: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=3), Listed]
    """lower corner of cell (0, 0), in `unit`; the centre of cell i is origin + (i + 1/2) cell"""
    unit: Annotated[str, Field(max_length=16)] = "cell"
    """`"cell"` or `"m"`"""
    frame: Annotated[str, Field(max_length=MAX_FRAME)] = ""
    """the frame of the coordinates, as in ROS: `map`; empty: it is not named"""


class PackedAnchor(Part):
    """Where the frame of the team's grid is on Earth."""

    latitude: Finite
    """of the point (0, 0): degrees, WGS 84"""
    longitude: Finite
    """the same"""
    bearing: Finite
    """of the x axis: degrees clockwise from true north"""


class PackedBelief(Part):
    """A belief on the wire: a box of cells, each as one byte of logarithm, and the mass outside spread evenly.

    `lo` and `box` are the lower corner and the shape of the box, in cells. `coding` says what `data` holds:
    "log8": one level b = 0..255 per cell in C order, each byte less the one before it (modulo 256), then zlib;
    the cells with b > 0 share 1 - `rest` in the proportion exp(b `step`), b = 0 means "in the rest";
    "log16": the same with levels up to 65535, as differences of differences (docs/bytes.md);
    "f32": little-endian float32 mass per cell in C order, not compressed, 0 meaning "in the rest" (`step` unused).
    `rest` is the mass of all cells that are outside the box or in the rest, spread evenly over them.
    """

    grid: PackedGrid
    """the grid it lives on"""
    lo: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, max_length=3), Listed]
    """lower corner of the box, in cells"""
    box: Annotated[tuple[Annotated[int, Field(ge=1, le=MAX_CELLS)], ...], Field(min_length=1, max_length=3), Listed]
    """shape of the box, in cells"""
    coding: Literal["log8", "log16", "f32"] = "log8"
    """what `data` holds"""
    step: Finite = 0.0
    """nats between two levels; required for `"log8"` and `"log16"`"""
    rest: Finite = 0.0
    """probability of all cells that are not kept, spread evenly over them"""
    data: Annotated[bytes, Field(max_length=MAX_BYTES)]
    """the cells of the box"""


class Informed(Part):
    """A belief that already contains team-mates' information, and whose: name -> until which team time."""

    belief: PackedBelief
    """a belief that already contains team-mates' information"""
    ancestors: Ancestors
    """whose; of a robot's belief a board adds the source, of a board's the ancestors of its `firsthand`"""


class UnnamedBelief(Part):
    """Where something is that a robot saw in this tick, and of which it knows the class alone. What a report holds of
    these are different things. A board that keeps no joint finds out which sightings are of one thing.
    """

    kind: Class
    """its class, as `robot/?`"""
    belief: PackedBelief
    """from the robot's own readings alone"""
    mark: Tick
    """its number among the unnamed ones of that tick's Readings, `sightings` first and then `seen`, from 0"""
    confidence: Confidence = 1.0
    """how sure the detector is that something is there"""


# --- robots and boards ---------------------------------------------------------------------------------------------------


class Report(Message):
    """A robot says what it believes about one subject."""

    source: Name
    """who says it; the same as in the key"""
    subject: Subject
    """about whom or what; the same as in the key"""
    tick: Tick
    """the tick it belongs to; without a world its own count, which only grows"""
    time: Finite
    """team time of the belief, seconds"""
    belief: PackedBelief
    """from its own readings alone"""
    ancestors: Ancestors = Field(default_factory=dict)
    """whose information `belief` contains: the source alone; a board does not read it"""
    informed: Informed | None = None
    """the same with the team's agreed beliefs folded in, and whose information that is"""
    evidence: PackedEvidence | None = None
    """in the report about the source itself, for a board that keeps a joint: see Evidence for a joint"""
    unnamed: Annotated[list[UnnamedBelief], Field(max_length=MAX_UNNAMED)] = Field(default_factory=list)
    """in the report about the source itself, for a board that keeps none: what it sees and cannot name"""


class Used(Part):
    """An opinion on which a consensus rests.

    With `rule`, `parameters`, each source's newest report and its `power`, a consensus can be pooled again, as
    `blackboard why` does: take the beliefs to their powers, pool the independent ones by the rule, then the
    overlapping ones, sharpest first.
    """

    source: Name
    """a robot, or in the exchange a sub-team"""
    weight: Finite
    """what it contributed, in the terms of its rule (docs/rules.md)"""
    age: Finite
    """seconds since its report's `time`"""
    entropy: Finite
    """of its opinion, in nats"""
    how: Literal["independent", "overlapping"]
    """multiplied, or averaged because it shares ancestors with others"""
    power: NonNegative = 1.0
    """the exponent, at most 1, to which its belief was taken before anything was pooled: what the board learned of it,
    or its dissent
    """


class Learned(Part):
    """What a board has learned of a source from how well it agrees with the others, without a truth (`[board]
    independence = "learn"`). A source that has not been compared is left out. A source that claims too wide looks
    like one that is correlated: agreement alone cannot tell them apart.
    """

    level: Literal["consensus", "agreed"]
    """of a robot, or in the exchange of a sub-team"""
    source: Name
    """who"""
    samples: Finite
    """effective comparisons with another source, the most of any pair; at most 50"""
    variance: Finite
    """of its errors, relative to what it claims, at least 1: 4 means that its sigmas are half of what they should be"""
    correlation: Finite
    """of its errors with those of the source that it resembles most, 0 to 1; a prior value until there is evidence"""
    echo: Name | None = None
    """that source, where the correlation is significant and at least 0.95"""
    since: Finite | None = None
    """team time, seconds, since which it has been held over-confident or an echo; none: it is neither"""


class Dissent(Part):
    """A source that keeps disagreeing with what the others believe, as a board finds it. Each source is judged by the consensus
    without it (faults.md).
    """

    level: Literal["consensus", "agreed"]
    """of a robot among its sub-team's opinions; or of the team: a robot in the joint, else a sub-team in the exchange"""
    source: Name
    """who"""
    since: Finite
    """team time, seconds, since which it has been named"""
    sigmas: Finite
    """how far it is from the others, in the sigmas that both claim, in the mean of the last seconds; of a robot that a
    joint leaves out, at least as far as the sightings that were not taken
    """
    weight: NonNegative
    """how much it counts, at most 1: the power to which its opinions are taken; in a joint the share of its evidence
    that was taken lately, 0: it is left out
    """


class Camp(Part):
    """Groups of sources that agree among themselves and contradict each other, two or more of them being the largest."""

    sources: Names
    """who"""
    weight: NonNegative
    """its share, 0 to 1, of the weights that the sources of all camps have in the consensus"""


class LeftOut(Part):
    """A source on which a consensus does not rest."""

    source: Name
    """who"""
    reason: Text
    """why, for people"""


class UnnamedSighting(Part):
    """A sighting of a class, as `robot/?`, that may be of the subject of a consensus."""

    source: Name
    """whose"""
    time: Finite
    """team time of the end of its tick, seconds: that of its Readings"""
    mark: Tick
    """its number among the unnamed ones of that tick, as in PackedRelative"""
    probability: Annotated[float, Field(ge=0, le=1)]
    """that it is of this subject"""
    taken: bool = False
    """whether it is clear that it is: from 0.95 on"""


class Consensus(Message):
    """A board says what its sub-team (`consensus`) or the whole team (`agreed`) believes about one subject, and why."""

    board: Name
    """which board"""
    sub_team: Name
    """its sub-team; the same as in the key"""
    level: Literal["consensus", "agreed"]
    """before or after the exchange with the other sub-teams; the same as in the key"""
    subject: Subject
    """the same as in the key"""
    tick: Tick
    """the tick that was settled"""
    time: Finite
    """team time, seconds"""
    belief: PackedBelief
    """the team's belief: take this one"""
    ancestors: Ancestors
    """whose information it contains"""
    firsthand: Informed | None = None
    """the part pooled from independent opinions alone, which another board may multiply; of a robot in several
    sub-teams only in the first of these by name that has a board; without ancestors nobody counts here; none: it is
    `belief`
    """
    used: Annotated[list[Used], Field(max_length=MAX_OPINIONS)]
    """the opinions it rests on"""
    left_out: Annotated[list[LeftOut], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """the sources that were not used, and why"""
    components: Annotated[list[Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """the shares of C_1..C_N, the agreement of 1..N opinions, in the choice of coalitions; they sum to 1; empty for a
    rule without coalitions
    """
    entropy: Finite
    """of `belief`, in nats"""
    conflict: bool
    """a first-hand opinion is sharper than all of them together (the paper's test), an informed one contradicts them,
    or there are `camps`
    """
    rule: Text
    """the pool"""
    parameters: Settings = Field(default_factory=dict)
    """its parameters"""
    outcome: Outcome = "pooled"
    """what became of the independent opinions: pooled by `rule`, or a veto left that rule no cell and they were pooled
    linearly (weights 1 / H^2) instead
    """
    ahead: Finite = 0.0
    """of a robot, where there is no world: seconds that its clock is ahead of the board's; add them to `time` of every
    consensus
    """
    state: PackedState | None = None
    """of a robot in a joint: where the robot's own filter may linearise; no evidence"""
    pose: PackedPose | None = None
    """of an object in a joint whose place is known: what `belief` was drawn of"""
    velocity: PackedVelocity | None = None
    """how fast it moves: a robot in a joint that was heard in the last second, or an object that rolls"""
    lost: Annotated[float, Field(ge=0, le=1)] | None = None
    """of a robot in a joint: the probability that it is not where this says"""
    learned: Annotated[list[Learned], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """with `independence = "learn"`: of the sources of independent opinions; of a joint: of the robots whose evidence
    was taken
    """
    dissent: Annotated[list[Dissent], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """which of its sources keep disagreeing with the others"""
    camps: Annotated[list[Camp], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """opposed camps of its sources, the heaviest first: it cannot be decided which is right"""
    unnamed: Annotated[list[UnnamedSighting], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """the sightings since the last tick that named a class, and may be of this"""
    existence: Annotated[float, Field(ge=0, le=1)] | None = None
    """of a track, as `person/7`: the probability that there is such a thing"""

    @property
    def number(self) -> tuple[str, int]:
        """How the name of a track begins, and its number (`opinion.classes.numbered`); the number is 0 of all that is no track."""
        return ("", 0) if self.existence is None else numbered(self.subject)


class Status(Message):
    """Every process but the world and the router reports what it has done: after each tick, and otherwise once a
    second.
    """

    process: Name
    """who; the same as in the key"""
    kind: Literal["robot", "board", "world", "router"]
    """what it is"""
    tick: Tick
    """the newest tick it did"""
    time: Finite
    """team time of that tick, seconds; before the first (`"idle"`) of a board the time of sending, of a robot 0"""
    phase: Literal["reported", "consensus", "agreed", "idle"] = "idle"
    """what of the tick is done: a robot sends `"reported"`, a board the other two"""
    subjects: Subjects = Field(default_factory=list)
    """all that it sent in this tick and phase"""
    kept: Subjects = Field(default_factory=list)
    """of a robot: on what else what it reported before still stands: no new report of them is waited for, and none is
    withdrawn (a robot on a poor link)
    """
    counters: Counts = Field(default_factory=dict)
    """for operators; a robot on a poor link may leave it, `refused`, `ages` and `settings` out together: what it said
    before stands
    """
    refused: Counts = Field(default_factory=dict)
    """how many messages it refused, by reason"""
    ages: Annotated[dict[Text, Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """seconds since it heard each source"""
    settings: Settings = Field(default_factory=dict)
    """what is in force; of a robot in a joint also what it has found out of its wheels, camera, fixes and compass,
    as `curve turn scale`, `lag` or `fix noise`, errors that last each with its `sigma`
    """
    learned: Annotated[list[Learned], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """of a board with `independence = "learn"`: all that it has learned of its robots, and of the other sub-teams and
    its own
    """
    follows: bool = False
    """of a board: another board of its sub-team leads, or it does not know yet; it publishes its status alone, with
    empty `subjects`
    """
    term: Tick = 0
    """of a board: how often the lead of its sub-team was taken over; of two that lead, the greater one stays"""
    since: Finite | None = None
    """of a board: team time since which it settles, seconds; where nobody leads, the longest does"""
    speed: NonNegative | None = None
    """of a robot: how fast it moved lately at most, unit per second: its old beliefs spread by that"""
    tracks: Counts = Field(default_factory=dict)
    """of a robot: the last number of the tracks that it has heard of, by what is before it in their names, as `person/`:
    a board that has been started again goes on behind it
    """
    sent: Finite | None = None
    """where there is no world: Unix time of sending, by the sender's clock"""
    echo: Annotated[dict[Text, Annotated[tuple[Finite, NonNegative], Listed]], Field(max_length=MAX_OPINIONS)] = Field(
        default_factory=dict
    )
    """where there is no world: of each board (as `a/board-a`) the newest stamp that came, and the seconds since it
    came
    """
    clocks: Annotated[dict[Text, Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """of a board: seconds by which the clocks of robots and other boards are ahead of its own, where they are off"""
    dissent: Annotated[list[Dissent], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """of a board: everybody who keeps disagreeing with the others"""
    grid: PackedGrid | None = None
    """of a board: the team's grid"""
    anchor: PackedAnchor | None = None
    """of a board: where the frame of that grid is on Earth"""
    lacks: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """of a board that a Clock asked while it waits: whose messages of the tick are not here, named as in `Clock.asked`"""

    @property
    def is_brief(self) -> bool:
        """Whether it leaves out what only operators read, as a robot on a poor link does: what it said before stands."""
        return self.kind == "robot" and not (self.counters or self.refused or self.ages or self.settings)

    @property
    def namesakes(self) -> int:
        """How often it noticed that another process sends under its name, as it counts them."""
        return self.counters.get("namesakes", 0)

    def beside(self, before: "Status | None") -> "Status":
        """With what it leaves out as it was `before`."""
        if before is None or not self.is_brief:
            return self
        names = ("counters", "refused", "ages", "settings")
        return self.model_copy(update={name: getattr(before, name) for name in names})


class Refusal(Message):
    """A board reports to a robot that it refused what came under the robot's name: at most once a second, the newest that was
    refused. What came before the robot's token, or before the world that stamped it, is reported only if it was still not taken
    a second later. A message without a sender's name (`wild-key`) is not reported. Of messages that are refused at the same
    time, the newest 64 names are reported.
    """

    board: Name
    """which board"""
    sub_team: Name
    """its sub-team; the same as in the key"""
    robot: Name
    """under whose name it came; the same as in the key"""
    time: Finite
    """team time of the board, seconds"""
    subject: Subject | None = None
    """of the Report that was refused; none: it was a Status"""
    reason: Text
    """one of these"""
    text: Text = ""
    """what was wrong, for people"""
    count: Count
    """messages under this name that the board refused since it started"""


class Disk(Message):
    """A recorder says that its disk takes nothing: once a second while that is so, and once when it is over."""

    recorder: Name
    """which recorder; the same as in the key"""
    trouble: Text = ""
    """why the disk takes nothing; empty: it does again"""
    missing: Count
    """messages that are not on the tape, or not yet"""


class Journal(Message):
    """What a board was given, in its order, for `blackboard replay` (recording.md): with the messages themselves,
    enough to repeat what it did to the bit. Only recorders read it. It is sent before what the board made of its
    events.

    What happened is `"put"` (a message, named by 16 hexadecimal digits: BLAKE2b of 8 bytes over its key, a zero
    byte and its payload; one that is larger than a message may be has the name `"too-large"`), `"delete"`,
    `"alive"` or `"gone"` (named by the key, cut off after 512 characters), or `"wake"` (time passed; no name).
    """

    board: Name
    """which board; the same as in the key"""
    sub_team: Name
    """its sub-team; the same as in the key"""
    began: NonNegative
    """Unix time of its first event, seconds: another value is another life of the board"""
    first: Tick
    """the number of the first event here, counted from 0 at `began`"""
    events: Annotated[
        list[
            Annotated[
                tuple[
                    NonNegative,
                    Literal["put", "delete", "alive", "gone", "wake"],
                    Annotated[str, Field(max_length=MAX_JOURNAL_NAME)],
                ],
                Listed,
            ]
        ],
        Field(max_length=MAX_OPINIONS),
    ]
    """Unix time at which it reached the board, seconds; what; name"""
    memory: Annotated[str, Field(max_length=MAX_JOURNAL_NAME)] = ""
    """the name, as in `events`, of the Memory that is sent right behind this journal: what the board remembered after
    the last of these events
    """


# --- the world -----------------------------------------------------------------------------------------------------------


class Clock(Message):
    """The tick that begins. In lockstep it also says who takes part and what the boards settled in the tick before."""

    run: Annotated[str, Field(max_length=64)]
    """names the run; another one than before means: forget everything and begin again"""
    tick: Tick
    """the tick that begins"""
    time: Finite
    """team time, seconds"""
    mode: Literal["lockstep", "realtime"]
    """whether the world waits"""
    robots: Annotated[dict[Name, Names], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """lockstep: sub-team -> the robots that take part in this tick"""
    settled: Annotated[dict[Name, Subjects], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """lockstep: sub-team -> the subjects agreed on in the tick before"""
    end: bool = False
    """the last one of the run"""
    asked: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] | None = None
    """lockstep, where it is repeated: who is asked for its Status, as `robot/r1` or `board/a/board-a`"""
    again: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] | None = None
    """lockstep, where it is repeated: who is asked for its answers to the tick again; with neither field everybody is"""

    def wants(self, name: str) -> Literal["status", "answers"] | None:
        """What this Clock, which is repeated, asks of a process, named `robot/<robot>` or `board/<sub-team>/<board>`."""
        if (self.asked is None and self.again is None) or name in (self.again or ()):
            return "answers"
        return "status" if name in (self.asked or ()) else None


class Odometry(Part):
    """The step since the last tick as odometry measures it: forward and turn, over dt seconds."""

    distance: Finite
    """forward, in the grid's unit"""
    turn: Finite
    """radians"""
    dt: Positive
    """seconds"""
    distance_sigma: NonNegative | None = None
    """of this step; none: by the robot's model. A joint's robots use it"""
    turn_sigma: NonNegative | None = None
    """of this step, radians; likewise"""
    aside: Finite = 0.0
    """to the left, in the grid's unit, of a robot that can drive sideways. A joint's robots use it"""
    curved: Finite | None = None
    """what of `distance` was driven on a curve; none: as much as the whole step looks like. A joint's robots use it"""
    driven: Finite | None = None
    """what of `turn` was not on the spot, radians; likewise"""


class Fix(Part):
    """An absolute position: a known start, or the paper's reset of the odometry; heading None where it is not measured."""

    position: Point
    """where"""
    sigma: Positive
    """standard deviation along each axis, in the grid's unit"""
    heading: Finite | None = None
    """radians"""
    heading_sigma: Positive = 0.05
    """radians"""


class Sighting(Part):
    """Something seen at a range and a bearing from the robot's heading; a landmark comes with its surveyed position."""

    subject: InView
    """what is seen; or a class, where nobody knows which one: `robot/?`, `person/?`, `object/ball?`, `landmark/?`"""
    range: NonNegative
    """in the grid's unit"""
    bearing: Finite
    """radians from the robot's heading"""
    landmark: Point | None = None
    """the surveyed position, for a landmark"""
    age: NonNegative = 0.0
    """seconds before the end of the tick"""
    range_sigma: Positive | None = None
    """of this range, in the grid's unit; none: by the robot's model. A joint's robots use it"""
    bearing_sigma: Positive | None = None
    """of this bearing, radians; the same"""
    confidence: Confidence = 1.0
    """how sure the detector is that something is there"""


class Readings(Message):
    """All sensor data of one robot in one tick."""

    run: Annotated[str, Field(max_length=64)]
    """as in Clock"""
    robot: Name
    """whose; the same as in the key"""
    tick: Tick
    """of which tick"""
    time: Finite
    """team time, seconds"""
    odometry: Odometry | None = None
    """the step since the last tick"""
    compass: Finite | None = None
    """heading, radians, where the robot has a compass"""
    compass_sigma: Positive | None = None
    """of this heading, radians; none: by the robot's model. A joint's robots use it"""
    fix: Fix | None = None
    """an absolute position"""
    sightings: Annotated[list[Sighting], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """what is in view"""
    seen: Annotated[list[Seen], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """what is in view and measured in another way: a range alone, a bearing alone, a position, a pose"""

    @property
    def landmarks(self) -> list[Point | None]:
        """Where each thing in view stands, of a landmark; None of others."""
        return [*(sighting.landmark for sighting in self.sightings), *(sighting.landmark for sighting in self.seen)]

    @property
    def subjects(self) -> list[str]:
        """What is in view, of all kinds."""
        return [*(sighting.subject for sighting in self.sightings), *(sighting.subject for sighting in self.seen)]


class Truth(Message):
    """For referees and viewers; a robot never reads it."""

    run: Annotated[str, Field(max_length=64)]
    """as in Clock"""
    tick: Tick
    """of which tick"""
    time: Finite
    """team time, seconds"""
    positions: Annotated[dict[Subject, Point], Field(max_length=MAX_ITEMS)]
    """where everything is"""
    headings: Annotated[dict[Subject, Finite], Field(max_length=MAX_ITEMS)] = Field(default_factory=dict)
    """of robots, radians, where they are known"""
    velocities: Annotated[dict[Subject, Point], Field(max_length=MAX_ITEMS)] = Field(default_factory=dict)
    """units per second, where they are known"""
    unnamed: Annotated[dict[Name, list[Subject | Literal[""]]], Field(max_length=MAX_ITEMS)] = Field(
        default_factory=dict
    )
    """robot -> whom the unnamed sightings of its Readings show, in their order; empty: nothing is there"""


class Solo(Message):
    """What a robot would believe without its team, for the referee. It is sent while a world's token is there; where
    no world runs nobody reads it.
    """

    robot: Name
    """whose; the same as in the key"""
    tick: Tick
    """of which tick"""
    time: Finite
    """team time, seconds"""
    beliefs: Annotated[dict[Subject, PackedBelief], Field(max_length=MAX_OPINIONS)]
    """the first-hand beliefs; may be empty"""


#: The model of each name that stands in the topic table (`keys.Topic.message`).
MODELS: dict[str, type[Message]] = {
    model.__name__: model
    for model in (Clock, Readings, Truth, Solo, Report, Consensus, Forward, Status, Refusal, Journal, Memory, Disk)
}
