"""Constants and formulas shared by kernels, runs and previews. Python and numpy only; numba compiles some of them."""
