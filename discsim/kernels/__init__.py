"""Loops compiled by numba.

All kernels use the same compile options where possible. numba compiles its own functions (np.empty, min, ...) once
per set of options, and one specialisation per literal argument. Assigning an array to a slice of another array takes
two seconds to compile, as numba compiles an error message about shapes and all its string formatting with it. Kernels
copy by loops instead.
"""
