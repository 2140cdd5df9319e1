"""The state of teams, folded from what their processes say: for the launcher and for all who look on."""
