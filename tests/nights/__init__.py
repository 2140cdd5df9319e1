"""Ten thousand bad nights: whole teams in virtual time, each under faults that one seed draws, judged by oracles that know everything."""
