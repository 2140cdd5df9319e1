"""What a name may be: one chunk of a Zenoh key. The one definition of the pattern, without anchors."""

LONGEST_NAME = 64  # characters
NAME = rf"[A-Za-z0-9_.-]{{1,{LONGEST_NAME}}}"
SUBJECT_KINDS = "robot|object|landmark|person"  # what a subject is about: `<kind>/<name>`
#: What a sighting names: a subject, or a class of them (`opinion.classes`), as `robot/?` or `object/ball?`.
CLASS = rf"(robot|object|person)/[A-Za-z0-9_.-]{{0,{LONGEST_NAME - 1}}}\?"
SIGHTED = rf"({SUBJECT_KINDS})/{NAME}|{CLASS}"
MAX_FRAME = 64  # characters of the name of a frame
VIA = "from."  # what the name of a process begins with that speaks for another team (`blackboard share`): it has no body and no place
OF_TEAM = ".."  # between a team and a robot, where robots of several teams are named: `north..r1`
