"""Unsigned integers as array indices.

A negative index counts from the end of an array. numba therefore tests each signed index, and adds the length of the
array if the index is below 0. Unsigned indices need no such test, and LLVM can vectorise their loops.
"""

import numpy as np

index = np.uint64
