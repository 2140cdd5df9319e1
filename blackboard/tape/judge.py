"""Consensuses against the truth of a tape: what the world's referee would say of them. Pure.

The truth, who took part, and what robots believed alone come from the tape; the consensuses are those on the tape, or those
that boards made in a replay. So the scorecards of both have one shape, and the same samples.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.faults import faulty_robots
from blackboard.judge.card import COUNTED, RunResult
from blackboard.judge.instant import Instant, who_saw_landmarks
from blackboard.judge.referee import Referee
from blackboard.judge.samples import Keep
from blackboard.judge.traffic import Traffic
from blackboard.process.roster import Roster
from blackboard.tape.content import Tape, messages
from blackboard.tape.replay import Output, is_consensus
from blackboard.wire import keys
from blackboard.wire.codec import message_in
from blackboard.wire.envelope import Kind
from blackboard.wire.messages import Clock, Consensus, Readings, Solo, Status, Truth

JUDGED_EVERY = 1.0  # seconds: how often the referee judges a recorded team (sim_world.mrclam.replay)


@dataclass
class Course:
    """What happened around the boards in one run of a world; without a world there are no truths."""

    run: str = ""
    mode: str = "free"
    ended: bool = False  # the world said so
    ticks: int = 0  # the newest that began
    truths: dict[int, Truth] = field(default_factory=dict)
    teams: dict[int, dict[str, list[str]]] = field(default_factory=dict)  # tick -> sub-team -> robots
    readings: dict[int, list[Readings]] = field(default_factory=dict)
    solos: list[Solo] = field(default_factory=list)


def course(tape: Tape, run: str) -> Course:
    """What happened in one run. In lockstep the Clock says who took part; else the tokens do, and who got readings."""
    course, following = Course(run), False
    settings = tape.scenario.section("world", WorldSection)
    roster = Roster(grace=settings.grace, comeback=settings.comeback)
    for at, envelope in tape.envelopes:
        if envelope.kind is not Kind.PUT:
            roster.hear_token(envelope, at)
            continue
        topic = keys.parse(envelope.key)
        if topic is None or topic[0] not in (keys.CLOCK, keys.READING, keys.TRUTH, keys.SOLO):
            continue
        message = message_in(envelope)
        if isinstance(message, Clock):
            following = message.run == run
            if following:
                roster.forget(at)
                _hear_clock(course, message, roster)
        elif isinstance(message, Readings) and message.run == run:
            course.readings.setdefault(message.tick, []).append(message)
        elif isinstance(message, Truth) and message.run == run:
            course.truths.setdefault(message.tick, message)
        elif isinstance(message, Solo) and following:
            course.solos.append(message)
    return course


def _hear_clock(course: Course, clock: Clock, roster: Roster) -> None:
    course.mode, course.ended = clock.mode, course.ended or clock.end
    course.ticks = max(course.ticks, clock.tick)
    if clock.end:
        return
    if clock.mode == "lockstep":
        teams = {sub_team: list(names) for sub_team, names in clock.robots.items()}
    else:
        known = {readings.robot for readings in course.readings.get(clock.tick, [])}
        teams = {s: [r for r in roster.robots.get(s, []) if r in known] for s in sorted(roster.boards)}
    course.teams.setdefault(clock.tick, teams)


def recorded(tape: Tape) -> Output:
    """The consensuses that are on the tape, with what the newest statuses count."""
    output, run, traffic = Output(), "", Traffic()
    for _, envelope in tape.envelopes:
        if envelope.kind is not Kind.PUT:
            continue
        if keys.CLOCK.match(envelope.key):
            run = next((clock.run for _, _, clock in messages([(0.0, envelope)], keys.CLOCK, Clock)), run)
        elif is_consensus(envelope):
            output.sent.append((run, envelope))
        elif keys.STATUS.match(envelope.key):
            for _, parts, status in messages([(0.0, envelope)], keys.STATUS, Status):
                traffic.hear_status(parts["sub_team"], status)
    output.counters, output.refused = traffic.counters({}), traffic.refused({})
    return output


def judge(
    scenario: Scenario,
    story: Course,
    output: Output,
    wall: float = 0.0,
    without: Collection[str] = (),
    record: Keep | None = None,
) -> RunResult:
    """What the referee says of consensuses, as a scorecard needs it; `wall` seconds were spent.

    Robots `without` are not judged. `record` is given every sample that counts.
    """
    settings = scenario.section("world", WorldSection)
    robots = [robot for robot in scenario.team.robots if robot not in without]
    faulty, unnamed = faulty_robots(scenario), settings.detector.anonymous
    referee = Referee(scenario.grid, settings.check, robots, record, faulty=faulty, unnamed=unnamed)
    every = round(JUDGED_EVERY / scenario.time.tick) if settings.kind != "simulated" else 1
    instants = _instants(story, output, without)
    for tick in sorted(instants):
        referee.judge_instant(instants[tick], judged=tick in story.truths and tick > 0 and tick % max(1, every) == 0)
    judgement = referee.judgement()
    return RunResult(
        judgement=judgement,
        stopped="" if story.ended else f"the tape ends in tick {story.ticks}",
        seed=settings.seed,
        rule=scenario.board.rule,
        fusion=scenario.board.fusion,
        mode=story.mode,
        protocol=settings.protocol if settings.kind == "mrclam" else None,
        ticks=story.ticks,
        tick_seconds=scenario.time.tick,
        wall_seconds=wall,
        messages={name: output.counters[name] for name in COUNTED},
        refused=output.refused + Counter(judgement.refused),
        bytes=output.counters["bytes"],
        counters={},
    )


Name = tuple[int, str, str, str, str]  # of a consensus: tick, sub-team, level, subject, board


@dataclass(frozen=True)
class Match:
    """How the consensuses of a replay compare with the recorded ones, each named by tick, sub-team, level, subject and board."""

    same: int
    different: int
    only_recorded: int
    only_replayed: int
    first: str  # the first that is not the same; empty if all are
    exact_from: int | None  # the tick from which all are the same; None if there is none
    # Of a run without an end: what boards said after the last that is on the tape; it counts for nothing.
    cut_off: int = 0

    @property
    def exact(self) -> bool:
        return self.same > 0 and not (self.different or self.only_recorded or self.only_replayed)


def match(run: str, taped: Output, replayed: Output, ended: bool = True) -> Match:
    """Compare the consensuses of a run, byte by byte.

    A board's journal is written ahead of what it says, so a tape that breaks off before the run has `ended` may lack the last
    consensuses of each board.
    """
    one, other = _by_name(run, taped), _by_name(run, replayed)
    cut_off = set() if ended else _behind_the_last(one, other)
    other = {name: payload for name, payload in other.items() if name not in cut_off}
    odd = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    both = one.keys() & other.keys()
    different = sum(one[name] != other[name] for name in both)
    first = "tick {}, {}, {} of {} by {}".format(*odd[0]) if odd else ""
    behind = odd[-1][0] + 1 if odd else min((name[0] for name in both), default=None)
    exact_from = behind if behind is not None and any(name[0] >= behind for name in both) else None
    only = len(one.keys() - both), len(other.keys() - both)
    return Match(len(both) - different, different, *only, first, exact_from, len(cut_off))


def _behind_the_last(taped: Collection[Name], replayed: Iterable[Name]) -> set[Name]:
    """What each board says in the replay after the last of its consensuses that is on the tape."""
    behind: dict[str, list[Name]] = {}
    for name in replayed:
        behind[name[-1]] = [] if name in taped else [*behind.get(name[-1], []), name]
    return {name for names in behind.values() for name in names}


def _instants(story: Course, output: Output, without: Collection[str]) -> dict[int, Instant]:
    """The ticks of a run; without a world, those in which there was a consensus."""
    instants = {}
    for tick, truth in story.truths.items():
        teams = {s: [r for r in robots if r not in without] for s, robots in story.teams.get(tick, {}).items()}
        instants[tick] = Instant(truth, teams, landmark_seen=who_saw_landmarks(story.readings.get(tick, [])))
    for solo in story.solos:
        if solo.tick in instants:
            instants[solo.tick].hear_message("", solo, b"")
    for consensus, payload in _of(story.run, output):
        if not story.run and consensus.tick not in instants:
            truth = Truth(run="", tick=consensus.tick, time=consensus.time, positions={})
            instants[consensus.tick] = Instant(truth, {})
        if consensus.tick in instants:
            if not story.run:
                instants[consensus.tick].teams.setdefault(consensus.sub_team, [])
            instants[consensus.tick].hear_message(consensus.sub_team, consensus, payload)
    return instants


def _by_name(run: str, output: Output) -> Mapping[Name, bytes]:
    return {(c.tick, c.sub_team, c.level, c.subject, c.board): payload for c, payload in _of(run, output)}


def _of(run: str, output: Output) -> Iterable[tuple[Consensus, bytes]]:
    """The consensuses of a run that can be read."""
    for of, envelope in output.sent:
        if of == run and isinstance(message := message_in(envelope), Consensus):
            yield message, envelope.payload
