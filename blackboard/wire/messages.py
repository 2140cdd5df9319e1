"""The messages between processes: one model each, unknown fields ignored, everything bounded.

Times are team time in seconds: the world's clock where a world runs, Unix time on real robots. Positions and ranges are
in the grid's unit, angles in radians, counter-clockwise. Subjects are `robot/<id>`, `object/<name>` or `landmark/<name>`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from blackboard.opinion.rules import Outcome
from blackboard.wire.evidence import Forward, PackedEvidence, PackedState, Seen
from blackboard.wire.memory import Memory
from blackboard.wire.names import MAX_FRAME
from blackboard.wire.raw import MAX_BYTES, MAX_ITEMS
from blackboard.wire.types import (
    MAX_OPINIONS,
    Ancestors,
    Count,
    Counts,
    Finite,
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
    "too-many": "more subjects or sources than a board keeps",
    "backwards": "evidence whose summed times or variances shrink within an epoch",
}

MAX_JOURNAL_NAME = 512  # characters; no key of a topic is longer
MAX_CELLS = 1 << 20  # the largest grid that is unpacked


# --- beliefs -----------------------------------------------------------------------------------------------------------


class PackedGrid(Part):
    """The grid a belief lives on; a board takes only its own."""

    shape: Annotated[tuple[Annotated[int, Field(ge=1, le=MAX_CELLS)], ...], Field(min_length=1, max_length=3), Listed]
    cell: Positive
    origin: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=3), Listed]
    unit: Annotated[str, Field(max_length=16)] = "cell"
    frame: Annotated[str, Field(max_length=MAX_FRAME)] = ""  # of the coordinates; empty: it is not named


class PackedAnchor(Part):
    """Where the frame of a team's grid is on Earth, in degrees (WGS 84); the bearing of x is clockwise from north."""

    latitude: Finite
    longitude: Finite
    bearing: Finite


class PackedBelief(Part):
    """A belief on the wire: a box of cells, each as one byte of logarithm, and the mass outside spread evenly.

    `lo` and `box` are the lower corner and the shape of the box, in cells. `coding` says what `data` holds:
    "log8": one level b = 0..255 per cell in C order, each byte less the one before it (modulo 256), then zlib;
    the cells with b > 0 share 1 - `rest` in the proportion exp(b `step`), b = 0 means "in the rest";
    "log16": the same with levels up to 65535, as differences of differences (docs/wire.md);
    "f32": little-endian float32 mass per cell in C order, not compressed, 0 meaning "in the rest" (`step` unused).
    `rest` is the mass of all cells that are outside the box or in the rest, spread evenly over them.
    """

    grid: PackedGrid
    lo: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, max_length=3), Listed]
    box: Annotated[tuple[Annotated[int, Field(ge=1, le=MAX_CELLS)], ...], Field(min_length=1, max_length=3), Listed]
    coding: Literal["log8", "log16", "f32"] = "log8"
    step: Finite = 0.0
    rest: Finite = 0.0
    data: Annotated[bytes, Field(max_length=MAX_BYTES)]


class Informed(Part):
    """A belief that already contains team-mates' information, and whose: name -> until which team time."""

    belief: PackedBelief
    ancestors: Ancestors


# --- robots and boards ---------------------------------------------------------------------------------------------------


class Report(Message):
    """What `source` believes about `subject`, from its own readings alone: `belief`, first-hand unless `ancestors` says more.

    `informed` is the same with the team's agreed beliefs folded in; left out before any was.
    """

    source: Name
    subject: Subject
    tick: Tick
    time: Finite
    belief: PackedBelief
    ancestors: Ancestors = Field(default_factory=dict)  # empty: the source alone
    informed: Informed | None = None
    evidence: PackedEvidence | None = None  # in the report about the source itself, for a board that keeps a joint


class Used(Part):
    """An opinion that a consensus rests on."""

    source: Name
    weight: Finite  # what it contributed, in the terms of the rule
    age: Finite  # seconds
    entropy: Finite  # nats
    how: Literal["independent", "overlapping"]
    power: NonNegative = 1.0  # to which it was taken before it was pooled: less of whom the board believes less


class Learned(Part):
    """What a board has learned of a source from how well it agrees with the others (`[board] independence = "learn"`)."""

    level: Literal["consensus", "agreed"]  # of robots, or in the exchange of sub-teams
    source: Name
    samples: Finite  # effective comparisons with another source
    variance: Finite  # of its errors, relative to what it claims; 1: nothing speaks against it
    correlation: Finite  # of its errors with those of the source that it resembles most
    echo: Name | None = None  # that source, where it is as good as the same
    since: Finite | None = None  # team time since which it has been held over-confident or an echo, seconds


class Dissent(Part):
    """Somebody who keeps disagreeing with what the others believe, each judged by the consensus without it."""

    level: Literal["consensus", "agreed"]  # of robots in a sub-team; of the team: robots in a joint, else sub-teams
    source: Name
    since: Finite  # team time, seconds
    sigmas: Finite  # how far from the others, in the sigmas that both claim, in the mean of the last seconds
    weight: NonNegative  # 0 to 1: the power to which its opinions are taken; in a joint the share of its evidence that was taken


class Camp(Part):
    """One of several equally large groups that agree among themselves and contradict each other."""

    sources: Names
    weight: NonNegative  # its share of the weights that the sources of all camps have in the consensus


class LeftOut(Part):
    source: Name
    reason: Text


class Consensus(Message):
    """What a board believes about a subject, and how it was made; `level` is "consensus" or "agreed" (after the exchange)."""

    board: Name
    sub_team: Name
    level: Literal["consensus", "agreed"]
    subject: Subject
    tick: Tick
    time: Finite
    belief: PackedBelief
    ancestors: Ancestors
    firsthand: Informed | None = None  # the independent part, which the exchange may multiply; None: it is `belief`
    used: Annotated[list[Used], Field(max_length=MAX_OPINIONS)]
    left_out: Annotated[list[LeftOut], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    #: shares of C_1..C_N; empty: the rule has none
    components: Annotated[list[Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    entropy: Finite  # nats
    conflict: bool  # a first-hand opinion is sharper than all together, or an informed one contradicts them
    rule: Text
    parameters: Settings = Field(default_factory=dict)
    outcome: Outcome = "pooled"  # or the rule that pooled instead, where a veto left `rule` no cell
    ahead: Finite = 0.0  # of a robot, where there is no world: seconds that its clock is ahead of the board's
    state: PackedState | None = None  # of a robot in a joint: where its own filter may linearise; no evidence
    #: of the sources whose independent opinions were used
    learned: Annotated[list[Learned], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    #: of the sources of this consensus those that keep disagreeing; the opposed camps, where there are any (then `conflict`)
    dissent: Annotated[list[Dissent], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    camps: Annotated[list[Camp], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)


class Status(Message):
    """What a process has done: the tick it finished, the subjects it sent in that tick, and its counters."""

    process: Name
    kind: Literal["robot", "board", "world", "router"]
    tick: Tick
    time: Finite  # of that tick; of a board that has settled nothing yet, the time of sending
    phase: Literal["reported", "consensus", "agreed", "idle"] = "idle"
    subjects: Subjects = Field(default_factory=list)  # what it reported, or settled, in this tick and phase
    #: of a robot: on what else what it reported before still stands, because it says nothing new to save bytes
    kept: Subjects = Field(default_factory=list)
    counters: Counts = Field(default_factory=dict)
    refused: Counts = Field(default_factory=dict)
    ages: Annotated[dict[Text, Finite], Field(max_length=MAX_OPINIONS)] = Field(
        default_factory=dict
    )  # seconds since each source was heard
    settings: Settings = Field(default_factory=dict)
    learned: Annotated[list[Learned], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)  # of a board
    follows: bool = (
        False  # of a board: another one of its sub-team leads, or it does not know yet; it publishes this alone
    )
    term: Tick = 0  # of a board: how often the lead of its sub-team was taken over
    since: Finite | None = None  # of a board: team time since which it settles, seconds
    speed: NonNegative | None = None  # of a robot: how fast it moved lately at most, unit per second
    #: where there is no world: Unix time of sending; the newest stamp of each board (as `a/board-a`), and the seconds it was held
    sent: Finite | None = None
    echo: Annotated[dict[Text, Annotated[tuple[Finite, NonNegative], Listed]], Field(max_length=MAX_OPINIONS)] = Field(
        default_factory=dict
    )
    #: of a board: seconds by which the clocks of sources are ahead, of those that are off
    clocks: Annotated[dict[Text, Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    dissent: Annotated[list[Dissent], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)  # of a board
    grid: PackedGrid | None = None  # of a board: the team's
    anchor: PackedAnchor | None = None  # of a board: where the grid's frame is on Earth
    #: of a board that is asked while it waits: whose messages of the tick are not here, as in Clock.asked
    lacks: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)

    @property
    def is_brief(self) -> bool:
        """Whether it leaves out what only operators read, as a robot on a poor link does: what it said before stands."""
        return self.kind == "robot" and not (self.counters or self.refused or self.ages or self.settings)

    @property
    def namesakes(self) -> int:
        """How often it noticed that another process sends under its name, as it counts them."""
        return self.counters.get("namesakes", 0)

    def beside(self, before: Status | None) -> Status:
        """With what it leaves out as it was `before`."""
        if before is None or not self.is_brief:
            return self
        names = ("counters", "refused", "ages", "settings")
        return self.model_copy(update={name: getattr(before, name) for name in names})


class Refusal(Message):
    """A board tells a robot that it refused what came under its name: the newest of it, and how many in all."""

    board: Name
    sub_team: Name
    robot: Name
    time: Finite  # team time of the board, seconds
    subject: Subject | None = None  # of the report; None: it was a status
    reason: Text  # of REASONS
    text: Text = ""  # what was wrong, for people
    count: Count  # messages under this name that the board refused since it started


class Journal(Message):
    """What a board was given, in its order: with the messages themselves, enough to repeat what it did to the bit.

    An event is (Unix time that the board was told, what, name): "put" with the digest of the message (`tape.journal.digest`),
    "delete", "alive" and "gone" with the key, "wake" without a name. A journal comes before what the board made of its events.
    """

    board: Name
    sub_team: Name
    began: NonNegative  # of the first event: another value is another life of the board
    first: Tick  # number of the first event here, counted from 0 at `began`
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
    #: digest of the Memory, sent right behind this journal, that holds what the board remembered after the last of these events
    memory: Annotated[str, Field(max_length=MAX_JOURNAL_NAME)] = ""


# --- the world -----------------------------------------------------------------------------------------------------------


class Clock(Message):
    """The tick that begins. In lockstep it also says who takes part and what the boards settled in the tick before."""

    run: Annotated[str, Field(max_length=64)]  # another one than before means: forget everything and begin again
    tick: Tick
    time: Finite
    mode: Literal["lockstep", "realtime"]
    #: sub-team -> robots that take part
    robots: Annotated[dict[Name, Names], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    #: sub-team -> subjects agreed in tick - 1
    settled: Annotated[dict[Name, Subjects], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    end: bool = False
    #: of a Clock that is repeated, who is asked for its status, and who for its answers to this tick; None: all for their answers
    asked: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] | None = None
    again: Annotated[list[Text], Field(max_length=MAX_OPINIONS)] | None = None

    def wants(self, name: str) -> Literal["status", "answers"] | None:
        """What this Clock, which is repeated, asks of a process, named `robot/<robot>` or `board/<sub-team>/<board>`."""
        if (self.asked is None and self.again is None) or name in (self.again or ()):
            return "answers"
        return "status" if name in (self.asked or ()) else None


class Odometry(Part):
    """The step since the last tick as odometry measures it: forward and turn, over dt seconds."""

    distance: Finite
    turn: Finite
    dt: Positive
    distance_sigma: NonNegative | None = None  # of this step; None: by the robot's model
    turn_sigma: NonNegative | None = None  # radians


class Fix(Part):
    """An absolute position: a known start, or the paper's reset of the odometry; heading None where it is not measured."""

    position: Point
    sigma: Positive
    heading: Finite | None = None
    heading_sigma: Positive = 0.05


class Sighting(Part):
    """Something seen at a range and a bearing from the robot's heading; a landmark comes with its surveyed position."""

    subject: Subject
    range: NonNegative
    bearing: Finite
    landmark: Point | None = None
    age: NonNegative = 0.0  # seconds before the end of the tick
    range_sigma: Positive | None = None  # of this sighting; None: by the robot's model
    bearing_sigma: Positive | None = None  # radians


class Readings(Message):
    """All sensor data of one robot in one tick."""

    run: Annotated[str, Field(max_length=64)]
    robot: Name
    tick: Tick
    time: Finite
    odometry: Odometry | None = None
    compass: Finite | None = None  # heading, where the robot has a compass
    compass_sigma: Positive | None = None  # radians; None: by the robot's model
    fix: Fix | None = None
    sightings: Annotated[list[Sighting], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    seen: Annotated[list[Seen], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)  # of further kinds

    @property
    def landmarks(self) -> list[Point | None]:
        """Where each thing in view stands, of a landmark; None of others."""
        return [*(it.landmark for it in self.sightings), *(it.landmark for it in self.seen)]

    @property
    def subjects(self) -> list[str]:
        """What is in view, of all kinds."""
        return [*(it.subject for it in self.sightings), *(it.subject for it in self.seen)]


class Truth(Message):
    """Where everything really is; for the referee and viewers only."""

    run: Annotated[str, Field(max_length=64)]
    tick: Tick
    time: Finite
    positions: Annotated[dict[Subject, Point], Field(max_length=MAX_ITEMS)]


class Solo(Message):
    """What a robot would believe without its team, run beside it on the same readings; for the referee only."""

    robot: Name
    tick: Tick
    time: Finite
    beliefs: Annotated[dict[Subject, PackedBelief], Field(max_length=MAX_OPINIONS)]


#: The model of each name that stands in the topic table (`keys.Topic.message`).
MODELS: dict[str, type[Message]] = {
    model.__name__: model
    for model in (Clock, Readings, Truth, Solo, Report, Consensus, Forward, Status, Refusal, Journal, Memory)
}
