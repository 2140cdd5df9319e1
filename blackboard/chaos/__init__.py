"""Chaos: what a team does while its network and its processes fail, measured with real processes; and the soak."""
