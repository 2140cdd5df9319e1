"""How old what is told is: what a board used was said at that time, and nothing rests on what is too old, or has not been yet."""

from collections import defaultdict
from collections.abc import Mapping

from blackboard.board.service import BoardService
from blackboard.wire.messages import Clock, Consensus, Report
from robot_agent.service import AgentService
from tests.nights.events import Event, Said
from tests.nights.faults import SecondWorld
from tests.nights.night import Night
from tests.nights.oracles import Oracle

ROUNDED = 1e-3  # seconds


class AgesAreTrue(Oracle):
    """By a world's clock an opinion that a board used was said by its source, as long ago as the board says.

    It is not older than `[board] max_age`. Nor is what a joint tells of a robot, by any clock.
    """

    sees = (Said,)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._max_age = night.team.scenario(night.seed).board.max_age
        self._said: dict[str, dict[float, None]] = defaultdict(dict)  # robot, or sub-team -> the stamps of what it said

    def see(self, event: Event) -> None:
        assert isinstance(event, Said)
        message = event.message
        if isinstance(message, Report):
            self._said[message.source][round(message.time, 3)] = None
        elif isinstance(message, Consensus):
            if message.level == "consensus":
                self._said[message.sub_team][round(message.time, 3)] = None
            self._judge(event, message)

    def _judge(self, event: Said, consensus: Consensus) -> None:
        what = f"the {consensus.level} of {event.process} on {consensus.subject}"
        ages = {used.source: used.age for used in consensus.used}
        robot = consensus.subject.removeprefix("robot/")
        if consensus.rule == "joint" and robot in consensus.ancestors:
            ages = {robot: consensus.time - consensus.ancestors[robot]}
        for source, age in ages.items():
            if age > self._max_age + ROUNDED:
                self.breaks(event.at, f"{what} rests on what {source} said {age:.1f} s ago")
            elif (
                consensus.rule != "joint"
                and source != consensus.sub_team
                and not self._has_said(source, consensus.time, age)
            ):
                self.breaks(event.at, f"{what} rests on what {source} said {age:.3f} s ago, and it said nothing then")

    def _has_said(self, source: str, time: float, age: float) -> bool:
        """Whether a source has said something of that age; what comes from ahead counts as of now."""
        if self.night.team.mode == "free":
            return True
        stamps, stamp = self._said[source], round(time - age, 3)
        near = any(round(stamp + off, 3) in stamps for off in (0.0, -ROUNDED, ROUNDED))
        return near or (age == 0.0 and any(said > time for said in stamps))


class NothingIsFromLater(Oracle):
    """In a run of a world nothing that is told rests on what is later than the world's clock, by more than `[board] future`.

    So who begins in another run keeps nothing of the one before. Not asked where two worlds run, nor of who has none.
    """

    sees = (Said,)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._future = night.team.scenario(night.seed).board.future
        two = any(isinstance(fault, SecondWorld) for fault in night.faults)
        self._is_asked = night.team.mode != "free" and night.is_honest and not two
        self._goes_on = night.team.mode == "realtime"  # without a Clock
        self._clocks: dict[str, tuple[float, float]] = {}  # run -> when the Clock farthest ahead was said, and its time

    def see(self, event: Event) -> None:
        if self._is_asked and isinstance(event, Said):
            message = event.message
            if isinstance(message, Clock) and event.process == "world":
                at, time = self._clocks.get(message.run, (event.at, message.time))
                # what was told while a world was frozen is from later than its next Clock
                if not self._goes_on or message.time - event.at >= time - at:
                    self._clocks[message.run] = event.at, message.time
            elif isinstance(message, Consensus):
                self._judge(event, message.subject, message.ancestors)
            elif isinstance(message, Report) and message.informed is not None:
                self._judge(event, message.subject, message.informed.ancestors)

    def _judge(self, event: Said, subject: str, ancestors: Mapping[str, float]) -> None:
        run = event.service.clock.run if isinstance(event.service, BoardService | AgentService) else ""
        if run not in self._clocks:
            return
        at, time = self._clocks[run]
        latest = time + (event.at - at if self._goes_on else 0.0)
        for robot, then in ancestors.items():
            if then > latest + self._future + ROUNDED:
                self.breaks(
                    event.at,
                    f"what {event.process} says of {subject} rests on {robot} at {then:.1f} s, and it is {latest:.1f} s",
                )
