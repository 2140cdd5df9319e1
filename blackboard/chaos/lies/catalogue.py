"""The catalogue of lies: what is changed, from when, by whom, and how many collude. Pure; nothing but data.

Issue 23's findings are `certain`, `pulls-mates`, `epochs-*`, `knows-*`, `mates-always`, `guests-*`, `invents-*`.
"""

from dataclasses import dataclass

from blackboard.chaos.lies.changes import (
    Absurd,
    Change,
    EchoesTeam,
    Epochs,
    Gains,
    Invents,
    Knows,
    Mirrors,
    Off,
    Replays,
    Sees,
    Sure,
    Tells,
    Unnames,
    WrongClock,
    WrongWheels,
)

HOUR = 3600.0


@dataclass(frozen=True)
class Lie:
    """Who changes what, from `start` until `end`, in shares of a run; `on` and `off`: in turns of so many seconds."""

    name: str
    changes: tuple[Change, ...]
    liars: int = 1  # robots of the scenario that lie, all the same
    guests: int = 0  # robots that are not in the scenario, join when the lie begins, and lie
    start: float = 0.2
    end: float = 0.8
    on: float = 0.0
    off: float = 0.0

    def is_told(self, since: float) -> bool:
        """Whether it lies so many seconds after its beginning, before its end."""
        return not self.on or since % (self.on + self.off) < self.on


ASIDE = (3.0, 0.0)  # units
CREEP = (0.05, 0.0)  # units a tick

CATALOGUE = {
    lie.name: lie
    for lie in (
        # --- where it is
        Lie("off-2", (Off((2.0, 0.0)),)),
        Lie("off-3", (Off(ASIDE),)),
        Lie("off-8", (Off((8.0, 0.0)),)),
        Lie("off-20", (Off((-20.0, 15.0)),)),
        Lie("off-always", (Off(ASIDE),), start=0.0, end=1.0),
        Lie("bias-slow", (Off(rate=(0.1, 0.0)),)),
        Lie("bias", (Off(rate=(0.3, 0.1)),)),
        Lie("bias-fast", (Off(rate=(1.0, 0.0)),)),
        Lie("comes-and-goes", (Off(ASIDE),), on=1.0, off=1.0),
        Lie("comes-and-goes-slowly", (Off((4.0, 0.0)),), on=3.0, off=2.0),
        # --- how sure it is
        Lie("sure-3", (Sure(3.0),)),
        Lie("sure-10", (Sure(10.0),)),
        Lie("sure-100", (Sure(100.0),)),
        Lie("sure-off", (Off((2.0, 0.0)), Sure(5.0))),
        Lie("sure-bias", (Off(rate=(0.2, 0.0)), Sure(3.0))),
        Lie("certain", (Gains(ASIDE, 1e9),)),
        Lie("certain-true", (Gains((0.0, 0.0), 1e9),)),
        Lie("certain-1e3", (Gains(ASIDE, 1e3),)),
        Lie("certain-near", (Gains((0.3, 0.0), 100.0),)),
        Lie("certain-bias", (Off(rate=(0.2, 0.0)), Gains((0.0, 0.0), 1e9))),
        # --- what it sees
        Lie("pulls-mates", (Sees("mates", CREEP, 0.01, always=True),)),
        Lie("pulls-mate", (Sees("mate", CREEP, 0.01, always=True),)),
        Lie("pulls-objects", (Sees("objects", CREEP, 0.01, always=True),)),
        Lie("pulls-object", (Sees("object", CREEP, 0.01, always=True),)),
        Lie("mates-off", (Sees("mates", ASIDE),)),
        Lie("mates-always", (Sees("mates", (4.0, 0.0), 0.5, always=True),)),
        Lie("mates-unnamed", (Sees("mates", (4.0, 0.0), 0.5, always=True), Unnames())),
        Lie("one-mate", (Sees("mate", ASIDE),)),
        Lie("one-mate-sure", (Sees("mate", (2.0, 0.0), 0.05, always=True),)),
        Lie("objects-off", (Sees("objects", (4.0, 0.0)),)),
        Lie("objects-always", (Sees("objects", (4.0, 0.0), 0.5, always=True),)),
        Lie("one-object", (Sees("object", (5.0, 0.0)),)),
        Lie("one-object-sure", (Sees("object", (2.0, 0.0), 0.05, always=True),)),
        Lie("no-variance", (Sees("others", sigma=1e-6),)),
        Lie("no-variance-off", (Sees("others", (1.0, 0.0), 1e-6),)),
        Lie("tells-ranges", (Tells("range", "mates", ASIDE, 0.1),)),
        Lie("tells-bearings", (Tells("bearing", "mates", ASIDE, 0.01),)),
        Lie("tells-positions", (Tells("position", "mates", CREEP, 0.01),)),
        Lie("tells-poses", (Tells("pose", "mates", ASIDE, 0.1),)),
        Lie("apart", (Tells("position", "mates", (1.0, 0.0), 0.5, noise=0.5, apart=True),)),
        Lie("apart-bearings", (Tells("bearing", "mates", (1.0, 0.0), 0.05, noise=0.5, apart=True),)),
        Lie("noisy-bearings", (Tells("bearing", "mates", (1.0, 1.0), 0.03, noise=0.3),)),
        Lie("noisy-objects", (Tells("position", "objects", (1.0, 0.0), 0.5, noise=0.5),)),
        Lie("bearings-of-objects", (Tells("bearing", "objects", (1.0, 1.0), 0.05, noise=0.5),)),
        Lie("noisy-objects-in-turns", (Tells("position", "objects", (1.0, 0.0), 0.5, noise=0.5),), on=2.0, off=1.0),
        Lie("mirrors", (Mirrors(),)),
        Lie("tells-objects", (Tells("position", "objects", ASIDE, 0.1),)),
        # --- records and numbering
        Lie("epochs-true", (Epochs(),)),
        Lie("epochs-off", (Off(ASIDE), Epochs())),
        Lie("epochs-bias", (Off(rate=(0.1, 0.0)), Epochs())),
        Lie("epochs-certain", (Sure(100.0), Epochs())),
        Lie("epochs-pulls", (Sees("mates", CREEP, 0.01, always=True), Epochs())),
        Lie("replays-5", (Replays(5.0),)),
        Lie("replays-first", (Replays(HOUR),)),
        Lie("replays-hour", (WrongClock(-HOUR),)),
        Lie("replays-stamped", (Replays(3.0, stamped=True),)),
        Lie("clock-ahead", (WrongClock(5.0),)),
        Lie("clock-behind", (WrongClock(-3.0),)),
        Lie("clock-slow", (WrongClock(rate=-0.3),)),
        # --- what others said
        Lie("knows-all", (Knows("all", (6.0, 0.0), 0.5),)),
        Lie("knows-itself", (Knows("self", (4.0, 0.0), 0.5),)),
        Lie("knows-object", (Knows("object", (5.0, 0.0), 0.3),)),
        Lie("echoes", (EchoesTeam(),)),
        Lie("echoes-sure", (EchoesTeam(5.0),)),
        # --- what there is
        Lie("invents-64", (Invents(64),)),
        Lie("invents-fresh", (Invents(16, fresh=True),)),
        Lie("invents-groups", (Invents(64, grouped=True),)),
        Lie("absurd-1", (Absurd(1),)),
        Lie("absurd-10", (Absurd(10),)),
        Lie("drives-double", (WrongWheels(2.0, 1.0),)),
        Lie("drives-back", (WrongWheels(-1.0, -1.0),)),
        Lie("drives-aside", (WrongWheels(aside=5.0),)),
        Lie("wheels-vague", (WrongWheels(sigma=100.0),)),
        # --- several
        Lie("two-off", (Off(ASIDE),), liars=2),
        Lie("two-bias", (Off(rate=(0.2, 0.0)), Sure(3.0)), liars=2),
        Lie("two-certain", (Gains(ASIDE, 1e9),), liars=2),
        Lie("two-pull", (Sees("mates", CREEP, 0.01, always=True),), liars=2),
        Lie("two-one-mate", (Sees("mate", ASIDE, 0.3, always=True),), liars=2),
        Lie("two-know", (Knows("all", (6.0, 0.0), 0.5),), liars=2),
        Lie("guest-off", (Off(ASIDE),), liars=0, guests=1),
        Lie("guests-off", (Off(ASIDE),), liars=0, guests=2),
        Lie("guests-sure", (Off(ASIDE), Sure(10.0)), liars=0, guests=2),
        Lie("guests-pull", (Sees("mates", CREEP, 0.01, always=True),), liars=0, guests=2),
    )
}
