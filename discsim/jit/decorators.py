"""Decorators of compiled functions: `njit` with the options that kernels need.

    compiled     a kernel that Python calls
    subroutine   a function that only compiled code calls
    inner        the same, forced into its callers
    lean         a kernel that makes no arrays
    making       a function that makes arrays and is called by lean ones
    lean_sums    a lean kernel with sums over neighbours, in double precision; lean_sums_in_single in single precision
    compiled_sums    a kernel with such sums that makes arrays

A process that compiles a function may call another copy of it than a process that loads it from disk, and differ in
the last bits. Hence `inner`. Neither `inner` nor `lean` counts references to arrays: numba counts one at each look
into a tuple of arrays, an atomic operation that costs more than what is done with a particle. So these make no arrays
and return none; a kernel that needs scratch arrays makes them once for its piece of the loop.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

from discsim.jit.cache import located
from discsim.jit.single import SingleCompiler

# Without the wrapper for C: nothing calls kernels by their address, and it would take a thirtieth of the compile time.
KERNEL: Any = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
LEAN: Any = {**KERNEL, "_nrt": False}
# Without the wrapper for Python, which would take a third of the compile time.
CALLED: Any = {"no_cpython_wrapper": True}
INNER: Any = {**LEAN, **CALLED, "forceinline": True}
# Sums over neighbours: their terms may be taken in any order. No 'nnan'/'ninf': a run that goes wrong must still be
# seen to. With Python's error_model a division may raise, and no loop with one is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
SUMS: Any = {**LEAN, "fastmath": FAST}


def kept(**options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function with these options of `njit`, kept in the folder of kernels."""

    def decorate(function: Callable) -> Any:
        with located():
            return njit(**options)(function)

    return decorate


compiled = kept(**KERNEL)
subroutine = kept(**KERNEL, **CALLED)
inner = kept(**INNER)
lean = kept(**LEAN)
making = kept(**{**KERNEL, "_nrt": True})
lean_sums = kept(**SUMS)
lean_sums_in_single = kept(**SUMS, pipeline_class=SingleCompiler)
compiled_sums = kept(**KERNEL, fastmath=FAST)
