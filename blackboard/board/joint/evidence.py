"""Evidence as it comes from the wire, and why it was left out."""

import itertools
import math
from collections.abc import Iterable

from blackboard.errors import Refused
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.coalitions import named
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.innovations import Innovations
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import FORWARD, TURN
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import (
    unpack_camera,
    unpack_compass,
    unpack_increment,
    unpack_motion,
    unpack_nuisance,
    unpack_relatives,
    unpack_state,
)
from blackboard.wire.messages import Learned

MOST = 1e7  # of places and their variances: ten times what stands for a place of which nothing is known
MOST_ERROR = 1e3  # of angles (rad), of scales, and of their errors and walks
#: Motions that no robot has more than `MOST` of.
WAYS = ("distance", "along", "across", "curved", "driven", "faster", "quicker", "aside")
#: Seconds since an epoch began, up to which a sum of times that stays the same means that no time passed. Later it may be rounding,
#: because a robot on a poor link rounds what it sends.
TICK = 10.0
GROWING = ("time", "moving", "along", "across", "heading")  # sums of an epoch that never shrink


def unpack(robot: str, tick: int, time: float, packed: PackedEvidence) -> Evidence:
    """The evidence of a robot's tick that ended at a team time (s), under the name of its subject.

    Refused: "mass", a matrix that is no covariance; "fields", a number that no robot has (`MOST`, `MOST_ERROR`).
    """
    check(packed)
    subject = f"robot/{robot}"
    relatives: tuple[Relative, ...] = unpack_relatives(packed, subject)
    return Evidence(
        robot=subject,
        epoch=packed.epoch,
        tick=tick,
        travelled=unpack_motion(packed.travelled),
        nuisance=unpack_nuisance(packed.nuisance),
        belief=None if packed.state is None else unpack_state(packed.state),
        increment=None if packed.increment is None else unpack_increment(packed.increment),
        relatives=tuple(relative for relative in relatives if not relative.subject.startswith("landmark/")),
        time=time,
        returned=None if packed.returned is None else unpack_state(packed.returned),
        camera=None if packed.camera is None else unpack_camera(packed.camera),
        compass=None if packed.compass is None else unpack_compass(packed.compass),
    )


def check(packed: PackedEvidence) -> None:
    """Refused: "fields", for numbers so large that they would spoil, by rounding, what others say in the same joint.

    Also for a scale of the wheels that is 0, and for a profile that is not in the order of its distances.
    """
    places, errors = [abs(getattr(packed.travelled, name)) for name in WAYS], [0.0]
    states = {name: state for name in ("state", "returned") if (state := getattr(packed, name)) is not None}
    for state in states.values():
        places += [abs(value) for value in (*state.mean, *state.covariance)]
    for relative in packed.relatives:
        places += [relative.range, relative.range_variance, *(sigma for sigma, _ in relative.biases)]
        errors += [abs(relative.bearing), relative.bearing_variance]
    if packed.compass is not None:
        errors += [abs(number) for number in (packed.compass.heading, packed.compass.sigma, packed.compass.bias)]
    for seen in packed.seen:
        numbers = [abs(number) for number in (*seen.values, *seen.covariance, *(sigma for sigma, _ in seen.biases))]
        (errors if seen.kind == "bearing" else places).extend(numbers)
    places += [number for pair in packed.profile for number in pair]
    if any(then >= now for (then, _), (now, _) in itertools.pairwise(packed.profile)):
        raise Refused("fields", "evidence.profile: give pairs (distance, variance) whose distances grow")
    nuisance = packed.nuisance
    scales = {"nuisance": (nuisance.forward, nuisance.turn)}
    scales |= {name: (state.mean[FORWARD], state.mean[TURN]) for name, state in states.items()}
    for place, both in scales.items():
        if 0.0 in both:
            raise Refused("fields", f"evidence.{place}: a scale of its wheels is 0; 1 is a scale without an error")
    errors += [abs(nuisance.forward), abs(nuisance.turn), *nuisance.sigmas, *nuisance.walks]
    for largest, most in ((max(places), MOST), (max(errors), MOST_ERROR)):
        if largest > most:
            raise Refused("fields", f"evidence holds {largest:.3g}; at most {most:g} can be")


def shrank(before: PackedEvidence, packed: PackedEvidence) -> bool:
    """Whether a time or a variance that is summed over an epoch shrank within the epoch, or it moved while no time passed.

    That happens where a robot tells the odometry of each tick instead of its sum.
    """
    sums = [(getattr(before.travelled, name), getattr(packed.travelled, name)) for name in GROWING]
    then, now = ((its.time, its.distance, its.turn) for its in (before.travelled, packed.travelled))
    in_no_time = 0.0 < then[0] == now[0] < TICK and then != now
    return packed.epoch == before.epoch and (in_no_time or any(now < then for then, now in sums))


def names(sources: Iterable[str]) -> str:
    """Sources in a sentence for people."""
    return ", ".join(named(source.removeprefix("robot/")) for source in sorted(sources))


def reason(verdict: Verdict) -> str:
    """Why evidence was not multiplied in, for people."""
    if verdict.outvoted_by:
        return f"contradicted by {names(verdict.outvoted_by)}"
    if verdict.kind == "echo":
        return "it says more of its own place than its belief gained"
    most = quantile(GATE, verdict.freedom)
    if verdict.squared > most:
        what = {"relative": "sighting", "compass": "compass"}.get(verdict.kind, "own place")
        far, limit = math.sqrt(verdict.squared), math.sqrt(most)
        return f"its {what} is {far:.1f} sigmas from what the team believes (limit {limit:.1f})"
    return "most of the team contradicts it or what it saw"


def learned(innovations: Innovations, sources: Iterable[str]) -> list[Learned]:
    """How over-confident the evidence of some robots is: the larger factor of what they say of themselves and of others."""
    rows = []
    for source in sources:
        kinds = [(source, kind) for kind in ("increment", "compass", "relative")]
        samples = max(innovations.samples(kind) for kind in kinds)
        variance = max(innovations.variance(kind) for kind in kinds)
        name = source.removeprefix("robot/")
        rows.append(Learned(level="agreed", source=name, samples=samples, variance=variance, correlation=0.0))
    return rows
