"""Loops for numba. All take the same options where they can: numba compiles what it brings itself (np.empty, min, ...)
once for each set of options, and each number given literally to a function makes a version of it.
"""
