"""What was refused under each robot's name, so that a board can tell the robot: the newest of it, and how many. Pure.

Whose it was, the key says, because what is refused may be unreadable. A message that came too early is sent only
once it has waited for a whole `PERIOD` without being taken after all.
"""

from dataclasses import dataclass

from blackboard.errors import Refused
from blackboard.process.bounded import put
from blackboard.process.printable import quoted
from blackboard.wire import keys
from blackboard.wire.messages import Refusal
from blackboard.wire.types import MAX_NAME

PERIOD = 1.0  # seconds between two times that a board sends what is new
MAX_SOURCES = 64  # robots of which a refusal is kept; the one that was refused for longest ago is given up


@dataclass(frozen=True)
class Notice:
    """The newest message that was refused under a robot's name; `subject` None: a status. `count` of all of them."""

    robot: str
    subject: str | None
    reason: str
    text: str
    count: int


@dataclass
class _Entry:
    notice: Notice
    early: bool  # it may still be taken
    waited: bool  # for a period
    due: bool


class Refusals:
    """Refused reports and statuses by sub-team and robot. `now` is Unix time in seconds."""

    def __init__(self) -> None:
        self._entries: dict[tuple[str, str], _Entry] = {}  # the one that was refused for longest ago first
        self._due_at = 0.0

    def record(self, key: str, refusal: Refused, *, early: bool = False) -> None:
        """A message on a key was refused; `early`: it is kept and may be taken after all."""
        writer = _robot_of(key)
        if writer is None:
            return
        (sub_team, robot), subject = writer
        before = self._entries.get((sub_team, robot))
        notice = Notice(
            robot, subject, refusal.reason, _text(refusal), 1 if before is None else before.notice.count + 1
        )
        waited = before is not None and before.waited
        put(self._entries, (sub_team, robot), _Entry(notice, early, waited, due=True), MAX_SOURCES)

    def handled(self, key: str) -> None:
        """A message on a key was taken: what came too early from the same robot is so no longer.

        A status says nothing of reports. Its stamp may be right where theirs is hours old.
        """
        if not self._entries or (writer := _robot_of(key)) is None:
            return
        robot, subject = writer
        entry = self._entries.get(robot)
        if entry is None or (entry.early and (subject is None) != (entry.notice.subject is None)):
            return
        if entry.early and entry.due:
            del self._entries[robot]
        else:
            entry.waited = False

    def due(self, now: float) -> list[tuple[str, Notice]]:
        """What is to be sent now, with the sub-teams: at most once in a `PERIOD`, and of each robot only what is new."""
        if not self._entries or now < self._due_at:
            return []
        self._due_at = now + PERIOD
        notices = []
        for (sub_team, _), entry in self._entries.items():
            if entry.due and (entry.waited or not entry.early):
                entry.due = False
                notices.append((sub_team, entry.notice))
            entry.waited = True
        return notices


def in_words(refusal: Refusal) -> str:
    """What a board refused of a robot, in one line for people."""
    what = "a status" if refusal.subject is None else f"the report about {refusal.subject}"
    text = f": {quoted(refusal.text)}" if refusal.text else ""
    return f"{refusal.board} refused {what} of {refusal.robot} ({quoted(refusal.reason)}{text})"


def _robot_of(key: str) -> tuple[tuple[str, str], str | None] | None:
    """Sub-team, robot and subject of the key of a report, or of a status (without a subject)."""
    if (parts := keys.REPORT.match(key)) is not None:
        return (parts["sub_team"], parts["source"]), parts["subject"]
    if (parts := keys.STATUS.match(key)) is not None:
        return (parts["sub_team"], parts["process"]), None
    return None


def _text(refusal: Refused) -> str:
    return str(refusal).removeprefix(f"{refusal.reason}: ")[:MAX_NAME]
