"""One tick as the world keeps it: what is true, who takes part, and what everybody sent about it. Pure bookkeeping."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from blackboard.process.roll_call import RollCall
from blackboard.wire.messages import Consensus, PackedBelief, Readings, Solo, Status, Truth

MAX_CONSENSUSES = 4096  # of a tick
PHASES = ("consensus", "agreed")  # of a board in a tick; as a consensus's level


def who_saw_landmarks(readings: Iterable[Readings]) -> frozenset[str]:
    """The robots whose readings hold a sighting of a landmark."""
    return frozenset(r.robot for r in readings if any(place is not None for place in r.landmarks))


@dataclass
class Instant:
    """One tick: what is true, who takes part, and what was received about it until now.

    What boards send is kept by board. Where a sub-team has several, the one whose name sorts first counts.
    """

    truth: Truth
    teams: dict[str, list[str]]  # sub-team -> robots
    began: float = 0.0  # Unix seconds
    solos: dict[str, Solo] = field(default_factory=dict)  # by robot
    #: by sub-team, level, subject and board: the payload and the message in it
    consensuses: dict[tuple[str, str, str, str], tuple[bytes, Consensus]] = field(default_factory=dict)
    boards: dict[str, set[str]] = field(default_factory=dict)  # sub-team -> its boards that sent something
    following: set[tuple[str, str]] = field(default_factory=set)  # sub-team and board that publishes its status alone
    roll: RollCall[tuple[str, str, str]] = field(default_factory=RollCall)  # sub-team, board and phase
    landmark_seen: frozenset[str] = frozenset()  # the robots that saw a landmark in this tick

    def hear_message(self, sub_team: str, message: Solo | Consensus | Status, payload: bytes) -> bool:
        """Take a message about this tick; True if it is the first of its kind. Who does not take part is ignored."""
        if isinstance(message, Solo):
            first = message.robot not in self.solos
            if any(message.robot in robots for robots in self.teams.values()):
                self.solos[message.robot] = message
            return first
        if sub_team not in self.teams:
            return False
        board = message.process if isinstance(message, Status) else message.board
        self.boards.setdefault(sub_team, set()).add(board)
        if isinstance(message, Status):
            (self.following.add if message.follows else self.following.discard)((sub_team, board))
            return self.roll.record_list((sub_team, board, message.phase), message.tick, message.subjects)
        name = (sub_team, message.level, message.subject, board)
        if name in self.consensuses or len(self.consensuses) < MAX_CONSENSUSES:
            self.consensuses[name] = payload, message
        return self.roll.record((sub_team, board, message.level), message.subject, message.tick)

    def settled(self, sub_team: str, board: str) -> bool:
        """Whether a board is done with this tick, and every consensus that its statuses list has arrived."""
        return all(self.roll.complete((sub_team, board, phase), self.truth.tick) for phase in PHASES)

    def is_led(self, sub_team: str) -> bool:
        """Whether some board of a sub-team that follows no other is done with this tick."""
        return bool(self._leading(sub_team))

    def _leading(self, sub_team: str) -> list[str]:
        boards = sorted(self.boards.get(sub_team, ()))
        return [b for b in boards if (sub_team, b) not in self.following and self.settled(sub_team, b)]

    def agreed_subjects(self) -> dict[str, list[str]]:
        """Sub-team -> the subjects that are that its board lists as agreed in this tick, for those that are done with it."""
        agreed = {}
        for sub_team in self.teams:
            lists = [self.roll.list_of((sub_team, board, "agreed")) for board in self._leading(sub_team)]
            subjects = [sorted(listed[1]) for listed in lists if listed is not None]
            if subjects:  # who took over when another board had agreed on this tick lists nothing
                agreed[sub_team] = next((some for some in subjects if some), [])
        return agreed

    def sources(self, level: str, robot: str, sub_team: str, subject: str) -> frozenset[str]:
        """The robots whose information a belief rests on by name; of a sub-team in the exchange, those behind its consensus."""
        if level == "solo":
            return frozenset({robot})
        consensus = self.consensus(sub_team, level, subject)
        named = frozenset(used.source for used in consensus.used) if consensus else frozenset()
        if level == "consensus":
            return named
        behind = [self.sources("consensus", robot, name, subject) for name in named & self.teams.keys()]
        return (named - self.teams.keys()).union(*behind)

    def belief(self, level: str, robot: str, sub_team: str, subject: str) -> PackedBelief | None:
        """A belief about a subject: the robot's alone ("solo"), its sub-team's ("consensus"), or after the exchange ("agreed")."""
        if level == "solo":
            solo = self.solos.get(robot)
            return solo.beliefs.get(subject) if solo else None
        consensus = self.consensus(sub_team, level, subject)
        return consensus.belief if consensus else None

    def consensus(self, sub_team: str, level: str, subject: str) -> Consensus | None:
        """What the first board of a sub-team by name said about a subject."""
        names = [(sub_team, level, subject, board) for board in sorted(self.boards.get(sub_team, ()))]
        return next((self.consensuses[name][1] for name in names if name in self.consensuses), None)

    def agreed_by(self, sub_team: str) -> list[Consensus]:
        """What the first board of a sub-team by name agreed on, about each subject once."""
        subjects = {subject for name, level, subject, _ in self.consensuses if (name, level) == (sub_team, "agreed")}
        consensuses = (self.consensus(sub_team, "agreed", subject) for subject in sorted(subjects))
        return [consensus for consensus in consensuses if consensus is not None]
