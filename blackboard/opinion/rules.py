"""What a rule is: a frozen, checked set of parameters that pools opinions and returns the result with its story.

Each rule is one class, `Rule` with the decorator `rule`. Those that come with the package stand beside their formulas and in the
table `blackboard.opinion.pools.POOLS`; others come from a user's own script, or from an installed package that names them under
the entry point `cop_blackboard.pools` (docs/rules.md, "A rule of your own").
"""

import dataclasses
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from typing import Any, ClassVar, Literal, TypeVar, dataclass_transform

import numpy as np
import numpy.typing as npt

from blackboard.errors import RuleError, UnknownKeyError, UserError, nearest
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.vectors import checked, checked_weights
from blackboard.opinion.weights import entropy_weights

BOUNDS = (("least", -math.inf), ("above", -math.inf), ("most", math.inf))  # of a number, where none are given

#: What became of a fusion: the rule pooled, or a veto left it no cell and the linear pool was taken instead.
Outcome = Literal["pooled", "veto: linear"]


@dataclass(frozen=True, eq=False)
class Pooled:
    """What a rule made of N opinions, and why.

    p: the pooled belief, in the grid's shape. weights: what each opinion contributed in this rule, shape (N,); each rule says what
    the number is (a share, an exponent, the mass of the coalitions that the opinion is in, ...). components: the shares of C_1..C_N in
    the choice of coalitions, summing to 1; empty where a rule has none. outcome: see `Outcome`. if_independent: makes the
    belief that the rule would claim if it were told that the opinions are independent; None where that is `p`.
    """

    p: Array
    weights: Array
    components: Array = field(default_factory=lambda: np.zeros(0))
    outcome: Outcome = "pooled"
    if_independent: Callable[[], Array] | None = None

    def claim(self) -> Array:
        """The belief that is put to the paper's test for a conflict: without the caution of a rule that claims less."""
        return self.p if self.if_independent is None else self.if_independent()


def parameter(
    *,
    default: Any,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    words: Sequence[str] = (),
    tried: Sequence[float] = (),
) -> Any:
    """A field of a rule: its default, the bounds of a number, and the values that `blackboard tune` tries.

    A default of None means an optional number. `words` may be given instead of a number.
    """
    bounds = {"least": least, "above": above, "most": most}
    return field(default=default, metadata={**bounds, "words": tuple(words), "tried": tuple(tried)})


class Rule:
    """A rule and its parameters. A subclass gives `pool`, its parameters as fields, and is registered by the decorator `rule`."""

    name: ClassVar[str] = ""
    #: Parameters of which at most one is given: setting one in a subject's table drops the others that a board set.
    exclusive: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for own in dataclasses.fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            object.__setattr__(self, own.name, _checked_value(own, getattr(self, own.name)))
        given = [name for name in self.exclusive if getattr(self, name) is not None]
        if len(given) > 1:
            raise RuleError(given[0], f"give it or {given[1]}, not both")

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        """Pool checked opinions (N, *grid shape), each with a non-negative weight, shape (N,); None: as the rule prefers.

        cell_ratio = v_ref / v_cell is 1 without a reference cell. Raises VetoError where no cell is left.
        """
        raise NotImplementedError(f"rule {self.name!r} does not say how it pools")

    def belief(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Array:
        """The `p` of `pool` alone: a rule whose story takes its time can say it faster."""
        return returned(self, self.pool(opinions, weights, cell_ratio=cell_ratio)).p

    def weigh(self, opinions: Array, cell_ratio: float) -> Array | None:
        """The weights that a board pools with, shape (N,); None: none."""
        return None

    def cell_ratio(self, grid: Grid) -> float:
        """v_ref / v_cell on a grid: 1 for a rule without a reference cell."""
        edge = getattr(self, "reference_cell", None)
        return 1.0 if edge is None else float((edge / grid.cell) ** grid.ndim)

    def in_force(self) -> dict[str, str | float]:
        """The rule's name and every parameter that counts, as a flat table; `read_rule` makes the same rule of it."""
        values = {own.name: getattr(self, own.name) for own in dataclasses.fields(self)}  # type: ignore[arg-type]
        return {"rule": self.name, **{name: value for name, value in values.items() if value is not None}}

    @classmethod
    def keys(cls, table: Mapping[str, Any]) -> tuple[str, ...]:
        """The parameters that this rule has; `table` matters only where one parameter decides which others there are."""
        return tuple(own.name for own in dataclasses.fields(cls))  # type: ignore[arg-type]

    @classmethod
    def read(cls, table: Mapping[str, Any]) -> "Rule":
        """The rule with the parameters of a table that has no unknown key."""
        return cls(**table)


@dataclass(frozen=True, kw_only=True)
class EntropyWeighted(Rule):
    """A rule that weighs opinions by 1 / H^k (III-A.1): the paper's own rules.

    reference_cell: the edge, in the grid's unit, of the cell that masses are expressed in; None is the grid's own cell, as in the
    paper's formulas.
    """

    k: float = parameter(default=2.0, least=0, most=10)
    "[factor] Opinions weigh 1 / entropy^k."
    reference_cell: float | None = parameter(default=None, above=0)
    "[unit] Edge of the cell that masses are expressed in; the grid's own where it is not given."

    def weigh(self, opinions: Array, cell_ratio: float) -> Array | None:
        return entropy_weights(opinions, self.k, cell_ratio=cell_ratio)


def _checked_value(own: dataclasses.Field[Any], value: Any) -> Any:
    """The value of a parameter, a number as float or int; RuleError where it has another type or is out of its bounds."""
    if (value is None and own.default is None) or own.default is dataclasses.MISSING:
        return value
    words = own.metadata.get("words", ())
    if isinstance(own.default, str | bool) and own.default not in words:
        if type(value) is not type(own.default):
            raise RuleError(own.name, f"give {bounds_in_words(own)}", repr(value))
        return value
    if isinstance(value, str) and value in words:
        return value
    whole = isinstance(own.default, int)
    least, above, most = (own.metadata.get(name, bound) for name, bound in BOUNDS)
    number = isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)
    if number and least <= value <= most and value > above and (not whole or value == int(value)):
        return int(value) if whole else float(value)
    raise RuleError(own.name, f"give {bounds_in_words(own)}", value)


def bounds_in_words(own: dataclasses.Field[Any]) -> str:
    """What a parameter may be, as `a finite value of at least 0 and at most 1, or "learn"`."""
    if isinstance(own.default, bool | str) and own.default not in own.metadata.get("words", ()):
        return "a text" if isinstance(own.default, str) else "a boolean"
    least, above, most = (own.metadata.get(name, bound) for name, bound in BOUNDS)
    bounds = {"of at least": least, "above": above, "at most": most}
    limits = " and ".join(f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound))
    instead = "".join(f', or "{word}"' for word in own.metadata.get("words", ()))
    return f"a {'whole' if isinstance(own.default, int) else 'finite'} value {limits}".strip() + instead


# --- the registry ------------------------------------------------------------------------------------------------------

#: The package's own rules as they are listed, and the module beside this one in which each registers when it is asked for.
OWN = {
    "linear": "averages",
    "logarithmic": "averages",
    "geometric": "averages",
    "chernoff": "chernoff",
    "hoelder": "averages",
    "harmonic": "averages",
    "cooperative": "cooperative",
    "calibrated": "cooperative",
    "coalition": "cooperative",
    "median-log": "robust",
    "geometric-median": "robust",
    "clique": "robust",
    "channel-filter": "averages",
}
#: The rules that are loaded, by name; `registered` also names those that can be.
REGISTRY: dict[str, type[Rule]] = {}
R = TypeVar("R", bound=Rule)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(parameter, field))
def rule(name: str) -> Callable[[type[R]], type[R]]:
    """Register a subclass of `Rule` under a name; the class becomes a frozen dataclass with keyword-only fields."""

    def register(cls: type[R]) -> type[R]:
        made = dataclass(frozen=True, kw_only=True)(cls)
        made.name = name
        if not made.__module__.startswith("blackboard.opinion."):
            _load(name)
        known = REGISTRY.setdefault(name, made)
        if (known.__module__, known.__qualname__) != (made.__module__, made.__qualname__):
            raise ValueError(f"rule {name!r} is already {known.__module__}.{known.__qualname__}; choose another name")
        REGISTRY[name] = made
        return made

    return register


def returned(rule: Rule, pooled: object) -> Pooled:
    """What a rule returned. ValueError: it is no `Pooled`."""
    if isinstance(pooled, Pooled):
        return pooled
    kind = type(pooled).__name__
    raise ValueError(f"rule {rule.name!r} returned {kind}: give Pooled(belief, what each opinion contributed)")


def find(name: str) -> type[Rule]:
    """The class of a rule by its name, from a plug-in where none is registered; RuleError for an unknown name."""
    from blackboard import plugins

    _load(name)
    if name not in REGISTRY:
        offered = plugins.load(plugins.POOLS, name)
        if offered is None:
            known = f"{', '.join(sorted(names()))}{nearest(name, names())}"
            raise RuleError(
                "rule", f"{name!r} is none of {known}; one of your own is installed as a package (docs/rules.md)"
            )
        if REGISTRY.get(name) is not offered:
            raise UserError(f"plug-in {name!r} of {plugins.POOLS}: offers {offered!r}, which is no Rule of this name")
    return REGISTRY[name]


def _load(name: str) -> None:
    """Load the package's own rule of this name, if there is one."""
    if name in OWN:
        import_module(f"blackboard.opinion.{OWN[name]}")


def names() -> list[str]:
    """All rules: those that are registered, then those of plug-ins, which are not loaded for it."""
    from blackboard import plugins

    return list(dict.fromkeys([*registered(), *plugins.names(plugins.POOLS)]))


def registered() -> list[str]:
    """The rules that come with the package, then those of scripts that were loaded, in the order in which they were registered."""
    return list(dict.fromkeys([*OWN, *REGISTRY]))


def read_rule(table: Mapping[str, Any]) -> Rule:
    """The rule of a flat table: `rule` and its parameters. RuleError names the wrong key, UnknownKeyError one that the rule lacks."""
    own = {key: value for key, value in table.items() if key != "rule"}
    cls = find(table["rule"])
    known = cls.keys(own)
    for key in own:
        if key not in known:
            raise UnknownKeyError(
                key, f"rule {cls.name!r} has no such key; it has {', '.join(sorted(known)) or 'none'}"
            )
    try:
        return _read((cls, tuple((key, type(value), value) for key, value in own.items())))
    except TypeError:  # a value that cannot be hashed is wrong, and the rule says why
        return cls.read(own)


@lru_cache(256)
def _read(told: tuple[type[Rule], tuple[tuple[str, type, Any], ...]]) -> Rule:
    """Kept, because a board asks for the rule of each subject in every tick. The key has the types, because True equals 1."""
    cls, items = told
    return cls.read({key: value for key, _, value in items})


def merged(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A rule's table with some keys set; the parameters of a rule that is thereby replaced are left behind."""
    if changes.get("rule", table["rule"]) != table["rule"]:
        return dict(changes)
    cls = find(table["rule"])
    kept = {key: value for key, value in table.items() if not _replaced(cls, key, table, changes)}
    return {**kept, **changes}


def _replaced(cls: type[Rule], key: str, table: Mapping[str, Any], changes: Mapping[str, Any]) -> bool:
    """Whether changes drop a key: they set an alternative to it, or choose another inner rule, which has no such parameter."""
    if key in cls.exclusive and any(other in changes for other in cls.exclusive):
        return True
    return key in cls.keys(table) and key not in cls.keys({**table, **changes})


# --- pooling by a rule -------------------------------------------------------------------------------------------------


def pooled(by: Rule, opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, cell_ratio: float = 1.0) -> Array:
    """The belief alone, of opinions and weights that are checked here: what the functions of POOLS return."""
    stack = checked(opinions)
    given = None if weights is None else checked_weights(weights, len(stack))
    return by.belief(stack, given, cell_ratio=cell_ratio)
