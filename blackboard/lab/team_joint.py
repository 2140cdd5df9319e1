"""The joint beliefs (`[board] fusion = "joint"`) of teams of one, two, ... robots of the same world, for Figs. 6 and 7. Pure.

What a robot sends as evidence rests on its own readings alone, so it is made once and settled by the joint of every team. Left out,
against a running team, is the place at which a robot's filter linearises, which comes back from the board and is no evidence.
"""

from collections.abc import Sequence

from blackboard.config import Scenario
from blackboard.lab.cases import Case, Run
from blackboard.lab.comparison import DEFAULT, fused
from blackboard.lab.team import played
from blackboard.lab.team_size import TeamSizeScores, add_case, team
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from robot_agent.team import first_hand_of


def joint_sizes(
    scenario: Scenario, parts: Sequence[tuple[Run, Sequence[int]]], number: int
) -> tuple[TeamSizeScores, ...]:
    """What `score_sizes` does, with the joint in place of a rule: for some cases of a run, each with the sizes that are scored.

    The scenario is the variant that the cases come from. What a joint does not know is pooled by the default rule, as on a board.
    """
    robots = scenario.team.robots
    filters = {robot: first_hand_of(scenario, robot) for robot in robots}
    told = scenario.board
    objects = Objects(told.objects_drift, told.objects_drifts, model=told.objects_motion, models=told.objects_motions)
    sizes = {size for _, some in parts for size in some}
    joints = {team(robot, robots, size): TeamJoint(objects) for robot in robots for size in sizes}
    by_part = tuple(TeamSizeScores() for _ in parts)
    for tick in played(scenario):
        evidence = {one.robot: filters[one.robot].step(one) for one in tick.readings}
        for members, joint in joints.items():
            joint.settle(tick.number, tick.dt, [evidence[robot] for robot in sorted(members)])
        for scores, (run, some) in zip(by_part, parts, strict=True):
            for case in (case for case in run if case.time == tick.truth.time):

                def believed(members: frozenset[str], case: Case = case) -> Belief:
                    joint = joints[members]
                    known = joint.knows(case.subject)
                    return (
                        joint.drawn(case.subject, case.grid)
                        if known
                        else Belief(case.grid, fused(case.of(members), DEFAULT).p)
                    )

                add_case(scores, number, case, robots, some, believed)
    return by_part
