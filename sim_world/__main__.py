"""The door of the world: `sim-world SCENARIO.toml`, a simulated team or a recorded one, and a scorecard at the end."""

from blackboard.judge.card import scorecard, text
from blackboard.judge.samples import series_file
from blackboard.run import door
from blackboard.run.flags import OutputFlags, RecordingFlags, RunFlags
from sim_world.service import world_of

app = door.new_app("sim-world", "Simulate a robot team, or replay a recorded one, and judge what it believes.")


@app.default
def sim_world(
    scenario: str | None = None,
    *,
    run: RunFlags = RunFlags(),
    recording: RecordingFlags = RecordingFlags(),
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Run the world of a scenario until its time is over, then print the scorecard; exit status 1 where it is no PASS.

    Parameters
    ----------
    scenario
        A scenario file (TOML or JSON), or the name of one that comes with the package [default: demo, or mrclam].
    """
    with series_file(run.table) as record:
        service = world_of(run.apply(recording.scenario(scenario)), record)
        door.serve(service, "world", flags)
    card = scorecard(service.result())
    output.show(card, text)
    return 0 if card["verdict"] == "PASS" else 1


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
