"""How an old belief spreads: by the speed that its robot gave, else by `[board] drift`. Pure."""

import math
from collections.abc import Iterable
from dataclasses import replace

from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion

MAX_ROBOTS = 1024  # whose speed is remembered


class Ageing:
    """What beliefs on one grid are after a time, by subject. Ages are in seconds of team time."""

    def __init__(self, drift: float, grid: Grid) -> None:
        """drift: unit per square root of a second, of what has no speed; nothing spreads by more than the grid's longest side."""
        self.drift, self._grid = drift, grid
        self._farthest = grid.cell * max(grid.shape)
        self._speeds: dict[str, float] = {}  # by subject, the newest last

    def learn_speed(self, robot: str, speed: float) -> None:
        """Take how fast a robot moved lately at most, in units per second."""
        self._speeds.pop(f"robot/{robot}", None)
        self._speeds[f"robot/{robot}"] = speed
        if len(self._speeds) > MAX_ROBOTS:
            del self._speeds[next(iter(self._speeds))]

    def variance(self, subject: str, age: float) -> float:
        """Variance along each axis, in unit^2, that is added to a belief about a subject after an age.

        A robot with a speed v is, after t, v t away in an unknown direction: v^2 t^2 / 2 along each axis. All else walks
        at random: drift^2 t.
        """
        age = max(0.0, age)
        speed = self._speeds.get(subject)
        if speed is None:
            return min(self.drift**2 * age, self._farthest**2)
        return min(speed * age, self._farthest) ** 2 / 2

    def spread(self, belief: Belief, subject: str, age: float) -> Belief:
        """A belief about a subject as it is after an age."""
        sigma = math.sqrt(self.variance(subject, age)) / self._grid.cell
        return Belief(self._grid, blur(belief.p, sigma))

    def aged(self, opinions: Iterable[Opinion], subject: str, age: float) -> list[Opinion]:
        """Opinions about a subject as they are after an age, which they carry from then on."""
        return [replace(opinion, belief=self.spread(opinion.belief, subject, age), age=age) for opinion in opinions]
