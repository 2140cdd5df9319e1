"""The door of the calibration: `blackboard calibrate` finds what a team's sensors are like, from a tape or a recording."""

from pathlib import Path

from blackboard.calibrate import report
from blackboard.calibrate.drives import Drives, drives_of
from blackboard.calibrate.found import calibrated
from blackboard.calibrate.model import Noise
from blackboard.config import Scenario
from blackboard.errors import UserError, extra
from blackboard.lab.ideal import assumed
from blackboard.lab.team import played
from blackboard.run.flags import OutputFlags, RecordingFlags
from blackboard.run.progress import progress
from blackboard.tape.content import load_tape, messages
from blackboard.wire import keys
from blackboard.wire.messages import Readings

STAMPED = {"odometry_lag": 0.0, "sighting_latency": 0.0}  # of [world]: a replay by its stamps
TICK = 0.25  # seconds: ticks of a recording, which are shorter than a lag


def calibrate(
    file: Path | None = None,
    *,
    recording: RecordingFlags = RecordingFlags(),
    seconds: float | None = None,
    scenario: str | None = None,
    track: float = 0.26,
    plot: Path | None = None,
    output: OutputFlags = OutputFlags(),
) -> int:
    """Find what the wheels and cameras of a team are like, from its own readings without the truth, and print it to paste.

    The first half is fitted, the second is scored.

    Parameters
    ----------
    file
        A tape of a team that ran; or give a recording.
    seconds
        How much of a recording is taken [default: the scenario's].
    scenario
        The team's scenario, instead of the one on the tape.
    track
        From wheel to wheel, in the grid's unit: it tells a curve from a turn on the spot.
    plot
        Also draw the residuals of each robot into this folder (extra `plot`).
    """
    if plot is not None:
        with extra("plot", "--plot"):
            from blackboard.lab import calibrate_drawing
    if (file is None) == (recording.mrclam is None):
        raise UserError("calibrate: give either a tape or a recording, as --mrclam DIR")
    if track <= 0:
        raise UserError(f"--track {track:g}: give the distance from wheel to wheel, more than 0")
    chosen, drives = _taped(file, scenario) if file is not None else _replayed(recording, seconds, scenario)
    with progress("calibrate") as show:
        calibration = calibrated(
            drives, track, {"the scenario's": Noise.alike(len(drives.robots), **assumed(chosen))}, show
        )
    if plot is not None:
        calibrate_drawing.draw(calibration, chosen.grid.unit, plot)
    told = report.report(calibration, STAMPED if file is None else {})
    output.show(told, lambda told: report.text(told, chosen.grid.unit))
    return 0


def _taped(file: Path, scenario: str | None) -> tuple[Scenario, Drives]:
    """The scenario of a tape, and the readings of its last run."""
    tape = load_tape(file, scenario)
    readings = [reading for _, _, reading in messages(tape.envelopes, keys.READING, Readings)]
    if not readings:
        raise UserError(f"{file}: no readings are on it; record the team with its robots' readings")
    return tape.scenario, drives_of(one for one in readings if one.run == readings[-1].run)


def _replayed(recording: RecordingFlags, seconds: float | None, scenario: str | None) -> tuple[Scenario, Drives]:
    """The scenario of a recording, and its readings as they were stamped. What comes from the truth is left out."""
    chosen = recording.scenario(scenario).changed("time", seconds=seconds)
    stamped = chosen.changed("time", tick=TICK).changed("world", **STAMPED)
    return chosen, drives_of((one for tick in played(stamped) for one in tick.readings), trusted=False)
