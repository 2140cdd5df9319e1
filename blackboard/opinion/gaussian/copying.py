"""Machines that can be copied, so that a step may be tried and taken back."""

from copy import copy
from typing import Self


class Copyable:
    """A machine with a copy that may be changed without changing it.

    The copy has maps, lists, arrays and machines of its own. What these hold is shared, so it must not be changed in place.
    """

    def copy(self) -> Self:
        other = copy(self)
        for name, value in vars(self).items():
            if hasattr(value, "copy"):
                setattr(other, name, value.copy())
        return other
