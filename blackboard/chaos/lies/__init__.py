"""Lies: what a member may claim within the format, as data; a team with liars in one process, and the table of what each lie costs."""
