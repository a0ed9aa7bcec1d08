"""Decorators of compiled functions: `njit` with the options that kernels need.

    compiled     a kernel that Python calls
    subroutine   a function that only compiled code calls
    inner        a subroutine that is inlined into its callers
    lean         a kernel that makes no arrays
    making       a function that makes arrays and is called by lean ones
    lean_sums    a lean kernel with sums over neighbours, in double precision; lean_sums_in_single in single precision
    compiled_sums    a kernel with such sums that makes arrays

A process that compiles a function may call another copy of a callee than a process that loads the function from disk.
Their results then differ in the last bits. Functions that are `inner` have no separate copy.

`inner` and `lean` functions do not count references to arrays. numba otherwise counts one at each access to a tuple
of arrays, an atomic operation that costs more than the work for a particle. These functions therefore make no arrays
and return none. A kernel that needs scratch arrays makes them once for its chunk of the loop.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

from discsim.jit.cache import located
from discsim.jit.single import SingleCompiler

# No wrapper for C: nothing calls kernels by their address, and the wrapper would take 3% of the compile time.
KERNEL: Any = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
LEAN: Any = {**KERNEL, "_nrt": False}
# No wrapper for Python, which would take 33% of the compile time.
CALLED: Any = {"no_cpython_wrapper": True}
INNER: Any = {**LEAN, **CALLED, "forceinline": True}
# Sums over neighbours may be reordered. No 'nnan'/'ninf': NaN and infinities of a failing run must be kept, so that it
# is stopped. With Python's error_model a division may raise, and no loop with a division is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
SUMS: Any = {**LEAN, "fastmath": FAST}


def kept(**options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function with these options of `njit` and caches it on disk."""

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
