"""Indices without a sign.

A negative index counts from the end of an array, so that numba tests each signed index and adds the length if it is
below 0. For an unsigned one there is no test, and LLVM can vectorise the loop.
"""

import numpy as np

index = np.uint64
