"""Loops for numba. All take the same options where they can: numba compiles what it brings itself (np.empty, min, ...)
once for each set of options, and each number given literally to a function makes a version of it. An array assigned to
a slice of another takes two seconds to compile, as numba brings the text of an error about shapes with it, and all that
puts texts together: a loop takes none of that.
"""
