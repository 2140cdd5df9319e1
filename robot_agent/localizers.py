"""Which localizers there are: the package's own, those of installed packages, and those that a script registers.

A localizer is named in a scenario, `[robot] localizer = "mine"`, and made by a factory. `factory(settings, grid)` gets the
RobotSection and the team's Grid, and returns a `robot_agent.localizer.Localizer` without any reading yet. A package offers its
factory as an entry point of the group `cop_blackboard.localizers`; a script registers one with `localizer`.
"""

import math
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any, TypeVar

from blackboard import plugins
from blackboard.errors import UserError

Factory = Callable[..., Any]
F = TypeVar("F", bound=Factory)

#: The package's own, loaded when they are asked for: they import the settings, which ask this module for the known names.
_OWN = {
    "position": EntryPoint("position", "robot_agent.position:PositionLocalizer.unknown", plugins.LOCALIZERS),
    "pose": EntryPoint("pose", "robot_agent.pose:PoseLocalizer.unknown", plugins.LOCALIZERS),
}

_registered: dict[str, Factory] = {}


def localizer(name: str) -> Callable[[F], F]:
    """Register a factory (a function, or a class whose constructor takes settings and grid) for use in this process.

    ValueError: the name is taken.
    """

    def register(factory: F) -> F:
        if name in known_localizers():
            raise ValueError(f"localizer {name!r} is already there; choose another name")
        _registered[name] = factory
        return factory

    return register


def known_localizers() -> tuple[str, ...]:
    """The names that `[robot] localizer` may have, sorted."""
    return tuple(sorted({*_OWN, *_registered, *plugins.names(plugins.LOCALIZERS)}))


def localizer_factory(name: str) -> Factory:
    """The factory of a known localizer. UserError: there is none of this name, or its package fails to load."""
    if name in _registered:
        return _registered[name]
    factory: Factory | None = _OWN[name].load() if name in _OWN else plugins.load(plugins.LOCALIZERS, name)
    if factory is None:
        raise UserError(f"robot.localizer: no localizer {name!r}; known are {', '.join(known_localizers())}")
    return factory


def heading_of(localizer: Any) -> tuple[float, float]:
    """The mean heading of a localizer (radians) and its variance; that of any heading where it has none."""
    headings = getattr(localizer, "heading_moments", None)
    return (0.0, math.pi**2 / 3) if headings is None else headings()
