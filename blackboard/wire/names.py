"""What a name may be: one chunk of a Zenoh key. The one definition of the pattern, without anchors."""

from __future__ import annotations

LONGEST_NAME = 64  # characters
NAME = rf"[A-Za-z0-9_.-]{{1,{LONGEST_NAME}}}"
SUBJECT_KINDS = "robot|object|landmark"  # what a subject is about: `<kind>/<name>`
MAX_FRAME = 64  # characters of the name of a frame
