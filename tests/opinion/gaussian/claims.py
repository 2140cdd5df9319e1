"""What two robots say of one place, with errors as large as a test wants them."""

from collections.abc import Callable

import numpy as np

from blackboard.opinion.gaussian.contacts import Claim, Contacts
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Nuisance, entering
from blackboard.opinion.grid import Array

#: Sigmas of a robot's place and of a sighting, per axis.
PLACE = 1.2
SIGHTING = 1.0
NOTHING = np.zeros((2, 2))


def own(at: Array) -> Claim:
    return Claim(at, np.eye(2) * PLACE**2, NOTHING)


def seen_at(at: Array) -> Claim:
    return Claim(at, np.eye(2) * PLACE**2, np.eye(2) * SIGHTING**2)


def corrected(contacts: Contacts, robot: str, share: float) -> None:
    """New evidence that leaves this share of the error of a robot's place."""
    belief = entering(Moments(np.zeros(3), np.eye(3)), Nuisance())
    information = np.zeros((STATES, STATES))
    information[AXES, AXES] = np.eye(2) * (1 - share)
    contacts.correct(robot, belief, Increment(np.zeros(STATES), information, np.zeros(STATES)))


def contradictions(lie: Callable[[int], float], seed: int, seconds: int) -> list[bool]:
    """Whether a witness contradicts a robot, of five ticks a second, each of them; with each second both halve their errors.

    `lie` is how far off the robot says that it is, by the second.
    """
    chance, contacts, contradicted = np.random.default_rng(seed), Contacts(), []
    errors = {name: chance.normal(0, PLACE, 2) for name in ("liar", "witness")}
    for second in range(seconds):
        for name in errors if second else ():
            corrected(contacts, name, 0.5)
            errors[name] = 0.5 * errors[name] + chance.normal(0, PLACE * 0.75**0.5, 2)
        for _ in range(5):
            claims = {
                "liar": own(errors["liar"] + [lie(second), 0.0]),
                "witness": seen_at(errors["witness"] + chance.normal(0, SIGHTING, 2)),
            }
            contacts.judge(claims)
            contradicted.append(contacts.contradict("witness", "liar"))
    return contradicted
