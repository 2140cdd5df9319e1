"""What a sighting may name instead of a subject: a class, as `robot/?` or `object/ball?`; and how tracks of a class are named."""

LANDMARK = "landmark/?"  # the class of what a map has; robots find out which themselves
LONGEST = 32  # characters of the name of a class that the names of its tracks have: with a number they are names, too
DIGITS = 9  # of the number in a track's name, so that the next one has room in a name, too
ROBOTS = "object/robot-"  # begins the names of tracks of `robot/?`, which are no members


def is_class(subject: str) -> bool:
    """Whether something is a class of things, and no thing: `object/ball?` is, `object/ball1` is not."""
    return subject.endswith("?")


def could_be(kind: str, subject: str) -> bool:
    """Whether a subject belongs to a class: `object/ball1` and `object/ball-red` to `object/ball?`, every robot to `robot/?`."""
    return is_class(kind) and not is_class(subject) and subject.startswith((kind[:-1], stem(kind)))


def stem(kind: str) -> str:
    """How the names of a class's tracks begin, before their numbers: `person/`, `object/ball-`, and of `robot/?` `object/robot-`."""
    what, _, name = kind[:-1].partition("/")
    begins = ROBOTS if what == "robot" else f"{what}/"
    return f"{begins}{name[:LONGEST]}-" if name else begins


def numbered(name: str) -> tuple[str, int]:
    """How a track's name begins, and its number: of `person/a-7` `person/a-` and 7; 0 where it has none of at most `DIGITS` digits."""
    begins = name.rstrip("0123456789")
    digits = name[len(begins) :]
    return begins, int(digits) if 0 < len(digits) <= DIGITS else 0


def kind_of(subject: str) -> str:
    """`robot`, `object`, `person` or `landmark`; of a track what it is a track of."""
    return "robot" if subject.startswith(ROBOTS) else subject.partition("/")[0]
