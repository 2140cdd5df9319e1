"""The terminal that shows a team live: `blackboard top` (extra `tui`)."""
