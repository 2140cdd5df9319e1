"""Robots of one make: how far off one's wheels and camera are says much of how far off the next one's are.

The scales of such robots are exchangeable (Gelman et al., Bayesian Data Analysis, chapter 5). A share of the variance that a
`Nuisance` gives them is the make's, and all have it in common. So a robot enters a joint with what the scales of those `like` it
say there.
"""

from collections.abc import Sequence

import numpy as np

from blackboard.opinion.gaussian.increment import gained, likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import CURVED_TURN, CURVED_WAY, FORWARD, LAG, RANGE, TURN, Nuisance

#: What the make decides. A bias of the bearing is how a camera was mounted, and a drift what one wheel has lost.
MADE = [FORWARD, TURN, RANGE, CURVED_WAY, CURVED_TURN, LAG]


def add_alike(joint: Joint, robot: str, belief: Moments, nuisance: Nuisance, like: Sequence[str]) -> None:
    """Add a robot by its first-hand belief, shape (12,), with scales like those of some robots that the joint has.

    What those claim counts for one sigma of a scale at most: a state with which a robot enters passes no gate. What the belief has
    learned of its own scales beyond their prior corrects the robot alone.
    """
    prior = nuisance.prior()
    made = [state for state in MADE if prior.covariance[state - FORWARD, state - FORWARD]]
    if not like or not made:
        joint.add(robot, belief)
        return
    scales = [state - FORWARD for state in made]
    expected, variances = prior.mean[scales], prior.covariance.diagonal()[scales]
    # the block by its scales: by_made @ scales + a rest that is independent of them
    by_made = np.linalg.solve(belief.covariance[np.ix_(made, made)], belief.covariance[made]).T
    rest = belief.covariance - by_made @ belief.covariance[made]
    share = nuisance.alike / (1 + (len(like) - 1) * nuisance.alike)  # of the deviation of each of those like it
    own = variances * (1 - nuisance.alike * share * len(like))
    unlearned = Moments(
        belief.mean + by_made @ (expected - belief.mean[made]), rest + (by_made * variances) @ by_made.T
    )
    follows = np.zeros((len(belief.mean),) * 2)
    follows[:, made] = share * by_made
    sigmas = np.sqrt(variances)
    deviations = [np.clip(joint.mean[joint.blocks[other]][made] - expected, -sigmas, sigmas) for other in like]
    entering = Moments(unlearned.mean + share * by_made @ sum(deviations), rest + (by_made * own) @ by_made.T)
    joint.add(robot, entering, dict.fromkeys(like, follows))
    learned = gained(unlearned, belief)
    factor = None if learned is None else likelihood(joint, robot, learned)
    if factor is not None:
        joint.update(factor, [robot])
