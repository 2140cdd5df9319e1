"""The joint belief of a team, from increments in to marginals out. Pure: numpy only."""
