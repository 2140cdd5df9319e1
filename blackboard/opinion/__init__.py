"""Pure math on probability grids: numpy only."""
