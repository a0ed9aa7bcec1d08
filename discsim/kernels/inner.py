"""What kernels are made of: `compiled` functions, each a `subroutine` where none but compiled code calls it; functions
that are forced into others, `inner`; and kernels that make no arrays, `lean`.

A process that compiles may else call another copy of a function than one that loads it, and differ in the last bits:
hence `inner`. Neither it nor `lean` counts references to arrays: numba counts one at each look into a tuple of arrays,
an atomic operation that costs more than what is done with a particle. So these make no arrays and return none; a kernel
that does makes them once for all of its piece. Functions that need arrays of their own and are called by such are
`making` (a function takes after its caller unless told).
"""

from typing import Any

from numba import njit

from discsim.kernels.inlining import Compiler, SingleCompiler

# Without what lets C call them by their address: nothing does, and it would take a thirtieth of their compilation.
KERNEL: Any = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
LEAN: Any = {**KERNEL, "_nrt": False}
# Called by compiled code alone: what lets Python call them would take a third of their compilation.
CALLED: Any = {"no_cpython_wrapper": True}
WITHIN: Any = {**LEAN, **CALLED, "forceinline": True}

compiled = njit(**KERNEL)
subroutine = njit(**KERNEL, **CALLED)  # not forced into what calls it
inner = njit(**WITHIN)
lean = njit(**LEAN)
# Sums over neighbours: their terms may be taken in any order. No 'nnan'/'ninf': a run that goes wrong must still be
# seen to. With Python's error_model a division may raise, and no loop with one is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
SUMS: Any = {**LEAN, "fastmath": FAST}
lean_sums = njit(**SUMS, pipeline_class=Compiler)
lean_sums_in_single = njit(**SUMS, pipeline_class=SingleCompiler)
# Other loops over neighbours, which make arrays and inline nearly all that they call.
GATHERING: Any = {**KERNEL, "pipeline_class": Compiler}
gathering = njit(**GATHERING)
gathering_sums = njit(**GATHERING, fastmath=FAST)
making = njit(**{**KERNEL, "_nrt": True})
