"""Numbers and formulas that kernels, runs and previews share. Python and numpy alone: numba compiles what it needs."""
