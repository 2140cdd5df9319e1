"""Everything that is scored: samples, intervals, the referee and its card. Pure: neither a clock nor a network."""
