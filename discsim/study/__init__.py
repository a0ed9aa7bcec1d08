"""Cost and accuracy studies: errors of runs, tables of runs, parameter sweeps, and searches for cheap settings."""
