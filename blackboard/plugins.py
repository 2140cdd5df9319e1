"""Plug-ins: what installed packages offer under an entry-point group, loaded only when it is asked for by name.

A package offers a rule or a localizer in its `pyproject.toml`, for example

    [project.entry-points."cop_blackboard.pools"]
    trimmed = "my_package.rules:Trimmed"
"""

from typing import Any

from blackboard.errors import UserError

POOLS = "cop_blackboard.pools"
LOCALIZERS = "cop_blackboard.localizers"


def names(group: str) -> list[str]:
    """The names that installed packages offer in a group, sorted; nothing is loaded."""
    from importlib.metadata import entry_points  # here, so that `import blackboard` stays light

    return sorted(entry_points(group=group).names)


def load(group: str, name: str) -> Any:
    """The object that a plug-in offers under a name, or None where there is no plug-in of this name.

    Raises UserError where its package cannot be imported, or where two packages offer the same name.
    """
    from importlib.metadata import entry_points

    found = sorted(entry_points(group=group, name=name), key=lambda point: point.value)
    if not found:
        return None
    if len({point.value for point in found}) > 1:
        offers = " and ".join(point.value for point in found)
        raise UserError(f"plug-in {name!r} of {group}: offered by {offers}; uninstall all but one")
    try:
        return found[0].load()
    except Exception as error:  # whatever its module does when it is imported
        raise UserError(
            f"plug-in {name!r} of {group}: {found[0].value} cannot be loaded "
            f"({type(error).__name__}: {error}); mend or uninstall its package"
        ) from error
