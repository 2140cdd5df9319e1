"""The doors of the bridges: `blackboard-rerun` and `blackboard tape export`, which look on and send nothing, and `blackboard ros`."""

from __future__ import annotations

import re
import sys
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from blackboard.bridges.stream import TeamStream
from blackboard.config import Scenario
from blackboard.errors import UserError, extra
from blackboard.net.attached import AttachedLink, TwoRouters
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.process.loop import run
from blackboard.run import door
from blackboard.run.flags import WhichTeam
from blackboard.view.source import TeamSource, open_tape
from blackboard.wire.names import NAME

if TYPE_CHECKING:
    from blackboard.bridges.ros.service import RosTopics
    from blackboard.client.member import Member

Topics = Annotated[list[str] | None, Parameter(negative="", show_default=False)]

app = door.new_app("blackboard-rerun", "Show a team that runs, or one on a tape, in the Rerun viewer.")


@app.default
def rerun(
    source: TeamSource = TeamSource(),
    *,
    save: Path | None = None,
    viewer: Annotated[str | None, Parameter(name="--viewer")] = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Show a team that runs until a signal comes, or one on a tape, in the Rerun viewer (extra `rerun`).

    Parameters
    ----------
    save
        Write a recording (.rrd) instead of opening a viewer.
    viewer
        A viewer that runs, as rerun+http://127.0.0.1:9876/proxy [default: one that is started here].
    """
    from blackboard.bridges.rerun import open_viewer

    if save is not None and viewer is not None:
        raise UserError("--save --viewer: give one of them")
    looked, shown = source.open(flags, "rerun", door.PATIENCE, door.Stop()), 0
    sink = open_viewer(looked.team, save, viewer)
    with looked:
        stream = TeamStream(looked.feed, looked.team)

        def show() -> None:
            nonlocal shown
            shown += stream.new(sink)

        looked.read_on(show)
    sink.close()
    if source.file is not None:
        sys.stderr.write(f"{source.file}: {shown} ticks shown\n")
    return door.DONE


@Parameter(name="*")
@dataclass(frozen=True)
class TopicFlags:
    """Which topics of ROS are taken in, each as what."""

    odometry: Topics = None
    "ROBOT=TOPIC, may be given again: a nav_msgs/Odometry that becomes the readings of that robot's `robot-agent`."
    fix: Topics = None
    "ROBOT=TOPIC: a PoseWithCovarianceStamped, such as /initialpose, that becomes an absolute position in these readings."
    pose: Topics = None
    "ROBOT=TOPIC: a PoseWithCovarianceStamped, such as /amcl_pose, reported as that robot's own belief, without a `robot-agent`."
    sees: Topics = None
    "ROBOT:SUBJECT=TOPIC, as r1:object/ball=/r1/ball: a PoseWithCovarianceStamped of what the robot sees, in its own frame."
    detects: Topics = None
    "ROBOT=TOPIC: a vision_msgs/Detection3DArray of what a detector of the robot sees and cannot name, in its own frame."

    def sources(self) -> RosTopics:
        """What the flags name, each robot and each topic in one way. UserError: what cannot be, or not together."""
        from blackboard.bridges.ros.service import RosTopics

        fixes, poses = _topics("--fix", self.fix), _topics("--pose", self.pose)
        sees, detects = _sightings("--sees", self.sees), _topics("--detects", self.detects)
        sources = RosTopics(_topics("--odometry", self.odometry), fixes, poses, sees, detects)
        if both := sources.poses.keys() & sources.driven:
            raise UserError(
                f"--pose {min(both)}: --odometry, --fix, --sees and --detects are for a robot with a `robot-agent`, which reports by "
                "itself; give one of them"
            )
        taken = Counter(topic.strip("/") for kind in (fixes, poses, sees, detects) for topic in kind.values())
        if twice := [topic for topic, number in taken.items() if number > 1]:
            raise UserError(f"/{min(twice)}: a topic is taken in once, by --fix, --pose, --sees or --detects")
        return sources


def ros(
    *,
    which: WhichTeam = WhichTeam(),
    sub_team: str | None = None,
    domain: int = 0,
    namespace: str | None = None,
    topics: TopicFlags = TopicFlags(),
    ros_router: Annotated[str | None, Parameter(name="--ros-router")] = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Join a team to the ROS 2 nodes on a Zenoh router (rmw_zenoh), until it is stopped (extra `ros`).

    Publishes what is agreed on as /TEAM/robot/r1/pose and /TEAM/robot/r1/map, and the state of the processes as /diagnostics.

    Parameters
    ----------
    sub_team
        The sub-team of the robots of --pose [default: as in the scenario].
    domain
        The ROS domain (ROS_DOMAIN_ID).
    namespace
        What the topics of beliefs begin with [default: the team's name].
    ros_router
        The endpoint of the nodes' own router, as tcp/localhost:7447 [default: the team's router]. With --keys it must be another one.
    """
    with extra("ros", "the bridge to ROS 2"):
        from blackboard.bridges.ros import names
        from blackboard.bridges.ros.service import RosBridge
    _check_nodes(flags, domain, ros_router)
    chosen = which.chosen()
    name = chosen.team.name
    space = _space(namespace or names.part(name))
    sources = topics.sources()
    members = {robot: _member(chosen, sub_team, robot) for robot in sources.poses}
    stop, clock = door.Stop(), UnixClock()
    opened = partial(AttachedLink, patience=door.PATIENCE, stopped=stop, clock=clock)
    with ExitStack() as stack:
        team = stack.enter_context(opened(flags.link(who=_certificate(flags, sources)), "ros"))
        theirs = None if ros_router is None else LinkConfig(connect=[ros_router])
        nodes = team if theirs is None else stack.enter_context(opened(theirs, "ros", beside=team))
        node = names.Node("cop_blackboard", nodes.session_id, domain, clock.now)
        service = RosBridge(name, node, sources, members, space)
        nodes.outlet = node.publishers.get
        links = team if nodes is team else TwoRouters(team, nodes)
        ready = partial(
            door.say, "ready", process="ros", domain=domain, topics=f"/{space}/**", tokens=len(service.tokens)
        )
        run(service, links, clock, stop, ready)
    return door.DONE


def _check_nodes(flags: door.ZenohFlags, domain: int, ros_router: str | None) -> None:
    """UserError: nodes of ROS cannot be reached so."""
    from blackboard.bridges.ros.names import MAX_DOMAIN

    if flags.keys is not None and ros_router is None:
        raise UserError(
            "--keys: nodes of ROS have no certificates; name their own router, as --ros-router tcp/localhost:7447"
        )
    if not 0 <= domain <= MAX_DOMAIN:
        raise UserError(f"--domain {domain}: give 0 to {MAX_DOMAIN}, as in ROS_DOMAIN_ID")


def _space(namespace: str) -> str:
    """What the topics of beliefs begin with. UserError: no name of ROS."""
    from blackboard.bridges.ros.names import is_topic

    space = namespace.strip("/")
    if not is_topic(space):
        raise UserError(f"--namespace {space!r}: use letters, digits, '_' and '/', as in names of ROS")
    return space


def _certificate(flags: door.ZenohFlags, sources: RosTopics) -> str:
    """The member whose certificate the bridge connects with. UserError: with keys it speaks for several robots."""
    robots = sorted({*sources.poses, *sources.driven})
    if flags.keys is not None and len(robots) > 1:
        raise UserError(f"--keys: a certificate is one robot; run a bridge for each of {', '.join(robots)}")
    return f"bridge/{robots[0]}" if len(robots) == 1 else "viewer"


def _member(scenario: Scenario, sub_team: str | None, robot: str) -> Member:
    """A robot of --pose, whose reports the bridge makes."""
    from blackboard.client.member import Member

    sub_teams = (sub_team,) if sub_team else tuple(scenario.team.of(robot))
    return Member(
        team=scenario.team.name, sub_teams=sub_teams, robot=robot, grid=scenario.grid, settings=scenario.board
    )


def _topics(flag: str, given: list[str] | None) -> dict[str, str]:
    """ROBOT=TOPIC, each robot and each topic once. UserError: another form."""
    from blackboard.bridges.ros.names import is_topic

    topics: dict[str, str] = {}
    for pair in given or ():
        robot, equals, topic = pair.partition("=")
        if not equals or not is_topic(topic):
            raise UserError(
                f"{flag} {pair}: write ROBOT=TOPIC, as r1=/r1/odom; a topic has letters, digits, '_' and '/'"
            )
        door.check_name(flag, robot)
        if robot in topics or topic.strip("/") in {other.strip("/") for other in topics.values()}:
            raise UserError(f"{flag} {pair}: this robot or topic was given before")
        topics[robot] = topic
    return topics


def _sightings(flag: str, given: list[str] | None) -> dict[tuple[str, str], str]:
    """ROBOT:SUBJECT=TOPIC, each subject of a robot once. UserError: another form."""
    from blackboard.bridges.ros.names import is_topic

    sightings: dict[tuple[str, str], str] = {}
    for text in given or ():
        left, equals, topic = text.partition("=")
        robot, _, subject = left.partition(":")
        if not equals or not is_topic(topic) or not re.fullmatch(f"(robot|object)/{NAME}", subject):
            raise UserError(
                f"{flag} {text}: write ROBOT:SUBJECT=TOPIC, as r1:object/ball=/r1/ball; a subject is robot/NAME or object/NAME"
            )
        door.check_name(flag, robot)
        if subject == f"robot/{robot}":
            raise UserError(f"{flag} {text}: a robot sees others; of itself give --fix")
        if (robot, subject) in sightings:
            raise UserError(f"{flag} {text}: this subject of this robot was given before")
        sightings[robot, subject] = topic
    return sightings


def export(file: Path, out: Path, *, to: Literal["foxglove"] = "foxglove", team: str | None = None) -> int:
    """Write a tape for other people's viewers: an MCAP file with the schemas that Foxglove shows (extra `foxglove`).

    Parameters
    ----------
    out
        The new file.
    to
        For which viewer.
    team
        Its team [default: the one on the tape].
    """
    from blackboard.bridges.foxglove import export as write

    count = write(open_tape(file, team), out)
    sys.stderr.write(f"{out}: {count} messages for {to}\n")
    return door.DONE


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
