"""Alarms: what an operator must not miss. An alarm stays after what raised it is over, until it is looked at. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from blackboard.opinion.gaussian.coalitions import named
from blackboard.opinion.gaussian.distrust import DISTRUSTED
from blackboard.opinion.gaussian.priors import found_in
from blackboard.state.moments import Moment
from blackboard.wire.messages import Consensus

MAX_ALARMS = 256
QUIET = 5.0  # seconds without it after which something that comes and goes counts as over
AGAIN = 20.0  # seconds after its end within which it is the same alarm again, with its beginning
BRIEF = 2.0  # seconds for which a FLEETING one has to last before it is shown

LOST = 0.1  # share of the grid's cells: who may be on more of them, exp(entropy), is lost
LIKELY_LOST = 0.3  # the probability that a robot is not where the team believes, from which on it is said to be lost

#: Of the worst first.
KINDS = ("gone", "full disk", "liar", "lost", "refused", "stuck", "moved", "jumped", "sensors", "over-confident")
OF_PROCESSES = ("gone", "full disk", "refused")  # they outlast a run
# Of a moment they are nothing to act on: a wide belief between two sightings, one message too late.
FLEETING = ("lost", "refused")


@dataclass(frozen=True)
class Alarm:
    """What is wrong with whom. Times are Unix seconds; `until` is None while it lasts."""

    what: str  # of KINDS
    who: str
    text: str
    since: float
    seen: float  # when it was found last
    until: float | None = None


class Alarms:
    """The alarms of a team, one of each kind and name; the oldest that are over are forgotten first."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], Alarm] = {}

    def raise_(self, what: str, who: str, text: str, now: float) -> None:
        """Something is wrong at `now`; what lasts or comes again soon keeps its beginning."""
        known = self._kept.pop((what, who), None)
        again = 0.0 if what in FLEETING else AGAIN
        goes_on = known is not None and (known.until is None or now - known.until < again)
        since = known.since if known is not None and goes_on else now
        self._kept[what, who] = Alarm(what, who, text, since, now)
        if len(self._kept) > MAX_ALARMS:
            over = next((key for key, alarm in self._kept.items() if alarm.until is not None), next(iter(self._kept)))
            del self._kept[over]

    def end(self, what: str, who: str, now: float) -> None:
        """End an alarm of a kind about a process or subject; one that is not there changes nothing."""
        known = self._kept.get((what, who))
        if known is not None and known.until is None:
            self._kept[what, who] = replace(known, until=now)

    def drop(self, what: str, who: str) -> None:
        """There was none of this kind about a process or subject."""
        self._kept.pop((what, who), None)

    def raise_all(self, alarms: Mapping[tuple[str, str], str], now: float) -> None:
        """All that a settled tick shows: kind and name -> text. What was not found for QUIET seconds is over."""
        for (what, who), text in alarms.items():
            self.raise_(what, who, text, now)
        for (what, who), alarm in self._kept.items():
            if what != "gone" and alarm.until is None and now - alarm.seen > QUIET:
                self._kept[what, who] = replace(alarm, until=alarm.seen)

    def forget(self) -> None:
        """A new run: alarms about beliefs before it are dropped."""
        self._kept = {key: alarm for key, alarm in self._kept.items() if alarm.what in OF_PROCESSES}

    def all(self) -> list[Alarm]:
        """What lasts before what is over, the worst and then the newest first; without those of a moment."""
        shown = (
            alarm for alarm in self._kept.values() if alarm.what not in FLEETING or alarm.seen - alarm.since >= BRIEF
        )
        return sorted(shown, key=lambda alarm: (alarm.until is not None, KINDS.index(alarm.what), -alarm.since))

    def check(self) -> None:
        """AssertionError: it is beyond its bounds."""
        assert len(self._kept) <= MAX_ALARMS


def of_robot(name: str, settings: Mapping[str, object]) -> dict[tuple[str, str], str]:
    """The alarms that a robot raises itself, by the settings of its status, which is data: anything may be in it."""
    stuck, alarms = settings.get("stuck"), dict[tuple[str, str], str]()
    if isinstance(stuck, float) and stuck > 0:
        alarms["stuck", name] = f"{name} is stuck: for {stuck:.0f} s its wheels have turned while it stood"
    if settings.get("moved") == 1.0:
        alarms["moved", name] = (
            f"{name} is not where its wheels led: it was pushed or carried, or its wheels or landmarks are wrong"
        )
    if settings.get("jumped") == 1.0:
        alarms["jumped", name] = f"{name}'s odometry jumped, so that step counts as unknown: was its frame set anew?"
    return alarms


def shown_by(moment: Moment, cells: float) -> tuple[dict[tuple[str, str], str], dict[tuple[str, str], str]]:
    """What a settled tick shows on a grid of so many cells, as texts.

    First conflicts, by subject and "", and sources that are left out or disagree, by subject and source. Then alarms, by kind and
    name.
    """
    shown, alarms = dict[tuple[str, str], str](), dict[tuple[str, str], str]()
    for subject, about in moment.subjects.items():
        if about.best is None or about.best.message.tick < moment.tick:
            continue
        consensus = about.best.message
        if consensus.conflict:
            shown[subject, ""] = f"conflict about {subject}"
        for one in consensus.dissent:
            text = f"{one.source} keeps disagreeing about {subject}, by {one.sigmas:.1f} sigmas"
            shown[subject, one.source] = alarms["liar", one.source] = text
        for out in consensus.left_out:
            shown[subject, out.source] = f"{named(out.source)} was ignored about {subject}: {out.reason}"
        if consensus.parameters.get(DISTRUSTED) == 1.0 and subject.startswith("robot/"):
            robot = subject.removeprefix("robot/")
            alarms["moved", robot] = (
                f"{robot} is not where its odometry led, its mates see: it was pushed or carried, or its wheels or gyro are wrong"
            )
        if subject.startswith("robot/") and (found := found_in(consensus.parameters)):
            robot = subject.removeprefix("robot/")
            alarms["sensors", robot] = (
                f"{robot}'s sensors err by more than it was told: {', '.join(found)}; `blackboard why {subject}` says by how much"
            )
        if text := _lost(consensus, cells):
            alarms["lost", subject] = text
        for learned in consensus.learned:
            if learned.since is not None and not learned.echo:
                times = math.sqrt(max(0.0, learned.variance))
                text = f"{learned.source} is over-confident: its errors are {times:.1f} times what it claims"
                alarms["over-confident", learned.source] = text
    return shown, alarms


def _lost(consensus: Consensus, cells: float) -> str:
    """Why the place of a subject is not known; empty where it is."""
    share = math.exp(min(consensus.entropy, 99.0)) / cells
    if share > LOST:
        return f"{consensus.subject} is lost: it may be on {100 * share:.0f} % of the map"
    if consensus.lost is not None and consensus.lost >= LIKELY_LOST:
        return f"{consensus.subject} is lost with {100 * consensus.lost:.0f} %: it may not be where the team believes"
    return ""
