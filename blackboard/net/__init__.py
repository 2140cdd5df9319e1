"""The network: the one Zenoh session of a process, its settings and its inbox."""
