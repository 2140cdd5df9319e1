"""The robots of client.py, each with a Kalman filter of its own for its wheels and its GPS; mates and ball go to the team.

    blackboard router -l tcp/127.0.0.1:7447
    blackboard serve --scenario examples/field/field.toml --sub-team a -e tcp/127.0.0.1:7447
    python -m examples.field.own_filter -e tcp/127.0.0.1:7447 --seconds 30

The filter takes nothing from the team. At the end it prints how far off each was.
"""

from blackboard.client import Robot
from examples.field.central import Central
from examples.field.client import main, parser
from examples.field.world import Said, World

FILTERS: dict[str, Central] = {}


def tell(robot: Robot, said: Said, world: World) -> None:
    """The filter's posterior and the odometry since the last one; and the sightings."""
    name, truth = robot.robot, world.truth
    own = FILTERS.setdefault(name, Central({name: truth}))
    own.step({name: Said(said.distance, said.turn, said.dt, said.start, said.gps)}, said.dt)
    mean, covariance = own.of(f"robot/{name}")
    robot.belief(mean, covariance, (said.distance, said.turn, said.dt))
    for sighting in said.seen:
        robot.see(sighting.subject, sighting.range, sighting.bearing, truth.range, truth.bearing)


if __name__ == "__main__":
    main(parser(__doc__).parse_args(), tell)
