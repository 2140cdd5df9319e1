"""Bridges into other people's viewers: Rerun (extra `rerun`) and Foxglove (extra `foxglove`). Each is loaded when it is asked for."""
