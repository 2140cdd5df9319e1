"""The flags that several commands share, each declared once: what to run, how long, and how to show what came of it."""

import json
import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from blackboard.config import Scenario, load
from blackboard.config.extent import holds
from blackboard.config.mrclam import fitted, recording_folder, surveyed, ways_of
from blackboard.config.pyfg import read_graph
from blackboard.errors import UserError
from blackboard.faults import without_faults
from blackboard.run import door
from blackboard.run.terminal import in_lines

log = logging.getLogger(__name__)


@Parameter(name="*")
@dataclass(frozen=True)
class RecordingFlags:
    """Which recording to replay, and which part of it."""

    mrclam: str | None = None
    "Replay the recorded team in this folder (MRCLAM format)."
    start: float | None = None
    "Where the replay begins, Unix time."
    protocol: str | None = None
    "Which of its landmark sightings may be used, as A_all or C_blind12; score also takes all."
    pyfg: str | None = None
    "Replay the recorded team in this file (a factor graph in PyFG format)."
    anonymous: Literal["mates", "all"] | None = None
    "Strip the barcodes of mates, or of landmarks, too: robots see `robot/?` and `landmark/?`, and only the referee knows which."

    @property
    def given(self) -> bool:
        """Whether any of these flags is set."""
        return self != RecordingFlags()

    def scenario(self, name: str | None = None) -> Scenario:
        """The named scenario [default: demo; mrclam with --mrclam, pyfg with --pyfg] with these flags applied to its world.

        UserError: --start or --protocol where the world is no recording that has them, or a file that cannot be replayed.
        """
        if self.mrclam is not None and self.pyfg is not None:
            raise UserError("--mrclam and --pyfg: give one of the two")
        if self.anonymous == "all" and self.mrclam is None:
            raise UserError("--anonymous all: the map of a recording is in its folder; name it with --mrclam")
        recorded = None if self.mrclam is None else "mrclam"
        scenario = load(name or recorded or ("pyfg" if self.pyfg else "demo"))
        if self.pyfg is not None:
            scenario = read_graph(self.pyfg).applied(scenario)
        # a missing folder is reported later, by the world that reads it
        if self.mrclam is not None and (folder := Path(self.mrclam)).is_dir():
            scenario = self._fitted(scenario, folder, is_named=name is not None)
        detector = (
            {"anonymous": ["robot", "landmark"] if self.anonymous == "all" else ["robot"]} if self.anonymous else None
        )
        scenario = scenario.changed(
            "world", kind=recorded, dir=self.mrclam, start=self.start, protocol=self.protocol, detector=detector
        )
        if self.anonymous == "all":
            survey = surveyed(recording_folder(self.mrclam))
            scenario = scenario.changed("robot", landmarks={str(number): place for number, place in survey.items()})
        if self.anonymous and scenario.tables["world"].get("kind") not in ("mrclam", "pyfg"):
            raise UserError("--anonymous is about a recording; for a simulated world set world.detector.anonymous")
        about = {"mrclam"} | ({"pyfg"} if self.protocol is None else set())
        if self.given and scenario.tables["world"].get("kind") not in about:
            raise UserError("--start and --protocol are about a recording: name its folder with --mrclam")
        return scenario

    def _fitted(self, scenario: Scenario, folder: Path, *, is_named: bool) -> Scenario:
        """Fit our own scenario to the recording. One that a person named stays; a warning says if robots leave its grid."""
        if not is_named:
            return fitted(scenario, folder)
        if not holds(scenario.grid, ways_of(folder)):
            log.warning("[grid] of %s: robots of %s leave it, and are lost there; enlarge it", scenario.name, folder)
        return scenario


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MemberFlags:
    """Which team a process is of."""

    team: str | None = None
    "Name of the team [default: the scenario's]."
    scenario: str | None = None
    "The team's scenario, a file or the name of one that comes with the package."

    def chosen(self) -> Scenario:
        """The named scenario, or the defaults, with the name of the team. UserError: no such scenario, or no possible name."""
        chosen = self._load()
        if self.team is None:
            return chosen
        door.check_name("--team", self.team)
        return chosen.changed("team", name=self.team)

    def _load(self) -> Scenario:
        return load(self.scenario) if self.scenario else Scenario({})

    def check_member(self, chosen: Scenario, name: str, sub_teams: Sequence[str]) -> None:
        """Check the names of a member, and warn of each of its sub-teams that the named scenario lacks. UserError: a name."""
        for flag, value in (*(("--sub-team", sub_team) for sub_team in sub_teams), ("--id", name)):
            door.check_name(flag, value)
        for warning in chosen.unknown_sub_teams(sub_teams) if self.scenario else ():
            log.warning(warning)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class WhichTeam(MemberFlags):
    """Which team a command is about."""

    team: str | None = None
    "Name of the team [default: the scenario's, or the one that is there]."
    scenario: str | None = None
    "The team's scenario, a file or the name of one in the package; robots in it that never came are shown."

    @property
    def members(self) -> dict[str, list[str]]:
        """Sub-team -> its robots, of the scenario that is named. UserError: no such scenario."""
        return self._load().team.sub_teams if self.scenario else {}

    def _load(self) -> Scenario:
        return load(self.scenario or "demo")


@Parameter(name="*")
@dataclass(frozen=True)
class LengthFlags:
    """The random numbers and the length of a run."""

    seed: int | None = None
    "Seed of the random numbers [default: the scenario's; 1 in lab and tune, where it draws trials and intervals]."
    seconds: float | None = None
    "Length of a run, in seconds of team time [default: the scenario's]."


@Parameter(name="*")
@dataclass(frozen=True)
class RunFlags(LengthFlags):
    """The random numbers, the length and the pace of a run, and where its samples go."""

    realtime: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Pace by the wall clock instead of waiting for everybody."
    table: Annotated[Path | None, Parameter(name=["--table", "--series"])] = None
    "Also write every sample that the referee judges, by tick, subject, level and robot: .csv, .jsonl or .parquet (docs/fields.md)."
    no_faults: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Let nothing be wrong with the robots under a [[fault]], and score them apart all the same, to compare with."

    def apply(self, scenario: Scenario) -> Scenario:
        """The scenario with these flags instead of what it says itself."""
        scenario = without_faults(scenario) if self.no_faults else scenario
        mode = "realtime" if self.realtime else None
        return scenario.changed("world", seed=self.seed).changed("time", seconds=self.seconds, mode=mode)


@Parameter(name="*")
@dataclass(frozen=True)
class ViewFlags:
    """How a run is looked at."""

    view: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Also serve a live page of the run on a free port of 127.0.0.1 (extra `web`); its address is in the log; opens where a display is."
    plot: Path | None = None
    "Also draw error, region, entropy and coverage over time, and all ways with ellipses, into this folder (extra `plot`)."


@Parameter(name="*")
@dataclass(frozen=True)
class TeamFlags:
    """Who is in the team, and how it pools."""

    robots: int | None = None
    "Another number of robots, spread over the sub-teams."
    boards_per_sub_team: int | None = None
    "Boards of each sub-team: one leads, the others take over when it dies [default: the scenario's]."
    rule: str | None = None
    "Another rule than the scenario's for pooling first-hand beliefs; implies --fusion opinions."
    fusion: Literal["opinions", "joint"] | None = None
    "Pool opinions, or keep a joint belief of the team [default: the scenario's]."

    def apply(self, scenario: Scenario) -> Scenario:
        """The scenario with these flags instead of what it says itself. UserError: fewer robots than sub-teams."""
        if self.robots is not None:
            scenario = scenario.changed("team", sub_teams=_spread(list(scenario.team.sub_teams), self.robots))
        scenario = scenario.changed("team", boards=self.boards_per_sub_team)
        fusion = self.fusion or ("opinions" if self.rule is not None else None)  # a rule is for opinions
        return scenario.with_rule(self.rule).changed("board", fusion=fusion)


@Parameter(name="*")
@dataclass(frozen=True)
class OutputFlags:
    """How a result is shown."""

    as_json: Annotated[bool, Parameter(name="--json", negative="", show_default=False)] = False
    "Print the result as one JSON object, and nothing else, on standard output."

    def show(self, result: dict[str, Any], text: Callable[[dict[str, Any]], str]) -> None:
        """Print a result on standard output, as JSON or as the text that `text` makes of it.

        A text within it, such as a name from outside, stays within its line.
        """
        sys.stdout.write((json.dumps(result) if self.as_json else text(in_lines(result))) + "\n")


def _spread(sub_teams: list[str], robots: int) -> dict[str, list[str]]:
    """r1..rN over the sub-teams, in runs whose lengths differ by one at most."""
    n = len(sub_teams)
    if robots < n:
        raise UserError(f"--robots {robots}: at least {n}, one for each sub-team")
    bounds = [round(i * robots / n) for i in range(n + 1)]
    return {
        name: [f"r{k + 1}" for k in range(low, high)]
        for name, low, high in zip(sub_teams, bounds, bounds[1:], strict=False)
    }
