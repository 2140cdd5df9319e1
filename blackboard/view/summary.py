"""The state of a team in one table: what `blackboard status` prints, and what the live page shows of the processes. Pure."""

from collections.abc import Sequence
from typing import Any

from blackboard.opinion.gaussian.coalitions import named
from blackboard.process.columns import cell, columns, shortened
from blackboard.state.alarms import LIKELY_LOST, Alarm
from blackboard.state.fold import Fold
from blackboard.state.moments import About, Moment
from blackboard.state.processes import Process
from blackboard.state.received import REGION
from blackboard.state.team import TeamFold

Table = dict[str, Any]
LITTLE = 0.05  # odds below this are not told
RECENT = 60.0  # seconds for which an alarm that is over is listed
#: What is told of sightings without a name, by the counters of boards.
UNNAMED = {
    "born": "tracks_born",
    "died": "tracks_died",
    "taken": "unnamed_taken",
    "ambiguous": "unnamed_ambiguous",
    "strange": "unnamed_strange",
}
#: By what a team goes, in words.
MODES = {"lockstep": "lockstep", "realtime": "real time", "free": "no world"}
#: What falls away first where a terminal is narrow: of the processes, and of the subjects.
PROCESSES_FALL = ("skipped", "late", "dropped", "kind", "ticks/s", "sub-team", "heard", "refused")
SUBJECTS_FALL = ("rule", "sources", "95 % area", "entropy")


def summary(fold: Fold, now: float) -> Table:
    """All teams as one JSON object; `now` is Unix time in seconds, ages are in seconds."""
    return {"teams": [team_summary(team, now) for _, team in sorted(fold.teams.items())], "refused": dict(fold.refused)}


def team_summary(team: TeamFold, now: float, moment: Moment | None = None) -> Table:
    """One team: its clock, its processes, and what it believes at a moment [default: its newest settled tick]."""
    newest = moment or team.moments.newest
    boards = [process.rate(now) for process in team.processes.values() if process.kind == "board"]
    return {
        "team": team.name,
        "mode": team.mode,
        "run": "" if team.clock is None else team.clock.run,
        "tick": None if newest is None else newest.tick,
        "time": None if newest is None else newest.time,
        "age": None if newest is None else now - newest.at,
        "settlements": max(boards, default=0.0),  # ticks settled per second, by the fastest board
        "processes": processes(team, now),
        "alarms": alarms(team, now),
        "unnamed": _unnamed(team),
        "subjects": {} if newest is None else {name: subject(about) for name, about in newest.subjects.items()},
    }


def processes(team: TeamFold, now: float) -> list[Table]:
    """Boards, robots and the world, by name: liveness, tick, rate, age, counters and refusals."""
    order = {"world": 0, "board": 1, "robot": 2}
    shown = sorted(
        team.processes.values(),
        key=lambda process: (order.get(process.kind, 3), sorted(process.sub_teams), process.name),
    )
    return [_process(process, now, _lost(team, process)) for process in shown]


def _lost(team: TeamFold, process: Process) -> float | None:
    """The probability that a robot is lost, as the newest belief about it says; None of others."""
    about = None if team.moments.newest is None else team.moments.newest.subjects.get(f"robot/{process.name}")
    return None if process.kind != "robot" or about is None or about.best is None else about.best.message.lost


def _unnamed(team: TeamFold) -> dict[str, int]:
    """Tracks that began and ended, and sightings without a name that were clear, unclear or of unknown things; nothing without
    any.

    Each board of a team counts the same ones, so those of the board that counted the most.
    """
    boards = [
        process.status.counters
        for process in team.processes.values()
        if process.kind == "board" and process.status is not None
    ]
    most = {name: max((counted.get(counter, 0) for counted in boards), default=0) for name, counter in UNNAMED.items()}
    return most if any(most.values()) else {}


def _process(process: Process, now: float, lost: float | None) -> Table:
    status = process.status
    counters = {} if status is None else status.counters
    state, away = process.state(now)
    return {
        "name": process.name,
        "kind": process.kind,
        "sub_teams": sorted(process.sub_teams),
        "state": state,
        "away": away,  # seconds for which it is silent or gone
        "part": _part(process),
        "tick": None if process.tick < 0 else process.tick,
        "time": None if process.tick < 0 else process.time,
        "age": now - process.heard_at if process.heard_at else None,
        "rate": process.rate(now),
        "lost": lost,
        "refused": dict(sorted(process.refused.items())),
        "dropped": counters.get("dropped", 0),
        "late": counters.get("late", 0),
        "skipped": counters.get("skipped", 0),  # ticks that a board in real time left out, to keep up
        "counters": dict(sorted(counters.items())),
        "ages": {} if status is None else dict(status.ages),  # source -> seconds since that process heard it
        "clocks": {} if status is None else dict(status.clocks),  # source -> seconds that its clock is ahead
        "settings": {} if status is None else dict(status.settings),
    }


def alarms(team: TeamFold, now: float) -> list[Table]:
    """What an operator must not miss at `now`, Unix seconds: what lasts, then what is over but was not looked at."""
    silent = [
        Alarm("gone", process.name, f"{process.name} is silent, though connected", process.heard_at, now)
        for process in team.processes.values()
        if process.state(now)[0] == "silent"
    ]
    return [_alarm(alarm, now) for alarm in [*silent, *(alarm for alarm in team.alarms.all() if alarm.since <= now)]]


def _alarm(alarm: Alarm, now: float) -> Table:
    over = alarm.until is not None and alarm.until <= now
    return {
        **{name: getattr(alarm, name) for name in ("what", "who", "text", "since")},
        "for": (alarm.until if over and alarm.until is not None else now) - alarm.since,
        "over": now - alarm.until if over and alarm.until is not None else None,  # seconds since it is over
    }


def _part(process: Process) -> str | None:
    """Which part a board takes in its sub-team: it "leads" or "follows"; None for others, and before its first status."""
    if process.kind != "board" or process.status is None:
        return None
    return "follows" if process.status.follows else "leads"


def subject(about: About) -> Table:
    """What is believed about a subject, in a few numbers."""
    best = about.best
    drawn, said = (None, None) if best is None else (best.drawn, best.message)
    score = about.scores.get("agreed") or next(iter(about.scores.values()), None)
    unclear = [] if said is None else [sighting for sighting in said.unnamed if not sighting.taken]
    return {
        **{name: getattr(said, name, None) for name in ("level", "tick", "entropy", "rule", "lost", "existence")},
        "mean": None if drawn is None else list(drawn.mean),
        "area": None if drawn is None else drawn.area,
        "error": None if score is None else score.error,
        "inside": None if score is None else score.denser < REGION,
        "unclear": [sighting.model_dump(include={"source", "mark", "probability"}) for sighting in unclear],
        "conflict": said is not None and said.conflict,
        "left_out": [] if said is None else [{"source": out.source, "reason": out.reason} for out in said.left_out],
        "dissent": [] if said is None else [named.source for named in said.dissent],
        "camps": [] if said is None else [list(camp.sources) for camp in said.camps],
        "sources": sorted(about.reports),
    }


# --- as text ----------------------------------------------------------------------------------------------------------------


def text(table: Table, width: int | None = None, there: Sequence[str] = ()) -> str:
    """The tables of all teams as text, in lines of at most `width` characters; without one, which others are `there`."""
    if not table["teams"]:
        return f"this team is not heard of; there is {', '.join(there)}" if there else "no team is heard of here"
    return "\n\n".join(_team_text(team, width) for team in table["teams"])


def _team_text(team: Table, width: int | None) -> str:
    lines = [team_line(team), *unnamed_lines(team, width), *alarm_lines(team, width), "", *process_lines(team, width)]
    return "\n".join([*lines, "", *subject_lines(team, width)] if team["subjects"] else lines)


def alarm_lines(team: Table, width: int | None = None) -> list[str]:
    """What is wrong, a line for each; of what is over only what is a minute old at most."""
    lines = [
        f"! {one['text']}, for {one['for']:.0f} s"
        + ("" if one["over"] is None else f"; over since {one['over']:.0f} s")
        for one in team["alarms"]
        if one["over"] is None or one["over"] <= RECENT
    ]
    return lines if width is None else [shortened(line, width) for line in lines]


def team_line(team: Table) -> str:
    tick = (
        "nothing settled yet"
        if team["tick"] is None
        else f"tick {team['tick']}, {team['time']:.1f} s, {team['age']:.1f} s ago"
    )
    return f"team {team['team']}: {MODES[team['mode']]}, {tick}, {team['settlements']:.1f} ticks/s"


def unnamed_lines(team: Table, width: int | None) -> list[str]:
    """What became of sightings without a name, in one line; none where all have one."""
    one = team["unnamed"]
    if not one:
        return []
    seen = f"{one['taken']} clear, {one['ambiguous']} ambiguous, {one['strange']} of nobody known"
    line = f"without a name: {one['born']} tracks began, {one['died']} ended; sightings: {seen}"
    return [line if width is None else shortened(line, width)]


def process_lines(team: Table, width: int | None) -> list[str]:
    """The processes of a team, a line for each behind the names of the columns; of at most `width` characters."""
    rows: list[tuple[str, ...]] = [
        ("process", "kind", "sub-team", "state", "tick", "ticks/s", "heard", "dropped", "late", "skipped", "refused")
    ]
    for one in team["processes"]:
        rows.append(
            (
                one["name"],
                one["kind"],
                ",".join(one["sub_teams"]) or "-",
                _state(one),
                cell(one["tick"], "{:d}"),
                f"{one['rate']:.1f}",
                cell(one["age"], "{:.1f}"),
                str(one["dropped"]),
                str(one["late"]),
                str(one["skipped"]),
                ", ".join(f"{reason} {count}" for reason, count in one["refused"].items()) or "-",
            )
        )
    return columns(rows, width, PROCESSES_FALL)


def _state(one: Table) -> str:
    state = one["state"]
    if state != "alive":
        state = "never heard" if one["away"] is None else f"{state} {one['away']:.0f} s"
    follows, namesakes = one["part"] == "follows", one["counters"].get("namesakes")
    return ", ".join([state] + ["follows"] * follows + [f"namesakes {namesakes}"] * bool(namesakes))


def subject_lines(team: Table, width: int | None = None) -> list[str]:
    """What a team believes, a line for each subject behind the names of the columns; of at most `width` characters."""
    rows: list[tuple[str, ...]] = [("subject", "believed at", "entropy", "95 % area", "error", "rule", "sources", "")]
    for name, one in team["subjects"].items():
        rows.append(
            (
                name,
                "-" if one["mean"] is None else ", ".join(f"{x:.2f}" for x in one["mean"]),
                cell(one["entropy"], "{:.2f}"),
                cell(one["area"], "{:.3g}"),
                cell(one["error"], "{:.2f}") + ("" if one["inside"] in (None, True) else " outside"),
                one["rule"] or "-",
                ",".join(one["sources"]) or "-",
                _trouble(one),
            )
        )
    return columns(rows, width, SUBJECTS_FALL)


def _trouble(one: Table) -> str:
    lost = [f"lost with {100 * one['lost']:.0f} %"] if (one["lost"] or 0.0) >= LIKELY_LOST else []
    track = [] if one["existence"] is None else [f"there with {100 * one['existence']:.0f} %"]
    odds: dict[str, float] = {}
    for sighting in one["unclear"]:
        odds[sighting["source"]] = max(sighting["probability"], odds.get(sighting["source"], 0.0))
    unclear = [f"{source} may have seen it ({100 * p:.0f} %)" for source, p in odds.items() if p >= LITTLE]
    left_out = [f"{named(out['source'])} was ignored: {out['reason']}" for out in one["left_out"]]
    dissent = [f"{source} keeps disagreeing" for source in one["dissent"]]
    camps = " against ".join(",".join(camp) for camp in one["camps"])
    return "; ".join([f"conflict {camps}".rstrip()] * one["conflict"] + track + unclear + lost + left_out + dissent)
