"""Cost and accuracy studies: errors of runs, tables of runs, parameter sweeps, and the search for cheap settings."""
