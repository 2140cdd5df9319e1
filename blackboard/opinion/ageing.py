"""How an old belief spreads: by the speed that its robot told, else by `[board] drift`. Pure."""

from __future__ import annotations

MAX_ROBOTS = 1024  # whose speed is remembered


class Ageing:
    """Variances by subject and age."""

    def __init__(self, drift: float, farthest: float) -> None:
        """drift: unit per square root of a second, of what tells no speed; farthest: unit, how far anything can be."""
        self.drift, self._farthest = drift, farthest
        self._speeds: dict[str, float] = {}  # by subject, the newest last

    def hear(self, robot: str, speed: float) -> None:
        """A robot tells how fast it moved lately at most, in units per second."""
        self._speeds.pop(f"robot/{robot}", None)
        self._speeds[f"robot/{robot}"] = speed
        if len(self._speeds) > MAX_ROBOTS:
            del self._speeds[next(iter(self._speeds))]

    def variance(self, subject: str, age: float) -> float:
        """Variance along each axis, in unit^2, that is added to a belief about a subject after an age in seconds.

        A robot with a speed v is, after t, v t away in an unknown direction: v^2 t^2 / 2 along each axis. All else walks
        at random: drift^2 t.
        """
        age = max(0.0, age)
        speed = self._speeds.get(subject)
        if speed is None:
            return min(self.drift**2 * age, self._farthest**2)
        return min(speed * age, self._farthest) ** 2 / 2
