"""Tapes: what a team said, recorded, read, cut, shown as a table, and replayed into boards."""
