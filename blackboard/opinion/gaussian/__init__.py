"""Gaussian beliefs over named parts: robots with their nuisance states, biases, objects; numpy only."""
