"""What a robot has found out of its wheels, camera, fixes and compass while it drives, in numbers by name, for its status. Pure."""

import math
from collections.abc import Mapping

import numpy as np

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.mounts import surely
from blackboard.opinion.gaussian.vehicle import (
    BEARING,
    CURVED_TURN,
    CURVED_WAY,
    DRIFT,
    FORWARD,
    LAG,
    RANGE,
    STATES,
    TURN,
)
from blackboard.opinion.grid import Array
from robot_agent.gaussian.absolute import AbsoluteSensors
from robot_agent.gaussian.mishaps import Mishaps
from robot_agent.gaussian.noise import CameraNoise, WheelNoise


def _of(*states: int, times: float = 1.0) -> Array:
    row = np.zeros(STATES)
    row[list(states)] = times
    return row


#: What is reported of the lasting errors, by name: a number, and the row that is multiplied with the states and added to it.
FOUND: dict[str, tuple[float, Array]] = {
    "way scale": (0.0, _of(FORWARD)),
    "curve way scale": (0.0, _of(FORWARD, CURVED_WAY)),
    "spin scale": (0.0, _of(TURN)),
    "curve turn scale": (0.0, _of(TURN, CURVED_TURN)),
    "drift": (0.0, _of(DRIFT)),
    "lag": (0.0, _of(LAG)),
    "bearing bias": (0.0, _of(BEARING)),
    "range scale": (1.0, _of(RANGE, times=-1.0)),
}


def findings(
    belief: Moments,
    wheels: WheelNoise,
    camera: CameraNoise,
    absolute: AbsoluteSensors,
    mishaps: Mishaps,
    errors: Mapping[str, tuple[float, float]],
) -> dict[str, float]:
    """Of a belief of the whole block, shape (12,) and (12, 12), and of lasting `errors` beside it, each with its sigma, by name.

    Scales are true over told; sigmas follow their value.
    Noise is the factor of the model's sigma. `stuck`: seconds for which its wheels have turned while it stood; `moved`: 1 while it is
    elsewhere than its odometry led, or while its odometry is not believed.
    """
    told = {}
    for name, (base, row) in FOUND.items():
        told[name] = base + float(row @ belief.mean)
        told[f"{name} sigma"] = math.sqrt(max(0.0, float(row @ belief.covariance @ row)))
    for name, (value, sigma) in errors.items():
        told |= {name: value, f"{name} sigma": sigma}
    noise = wheels.found | {"range": camera.range, "bearing": camera.bearing}
    told |= {f"{name} noise": math.sqrt(learned.variance) for name, learned in noise.items()}
    claimed = {"fix": absolute.fix} | absolute.headings
    told |= {f"{name} noise": math.sqrt(surely(*learned.log)) for name, learned in claimed.items()}
    told |= {"stuck": mishaps.stuck, "moved": mishaps.moved}
    return {name: round(value, 4) for name, value in told.items()}
