"""Decorators of compiled functions: `njit` with the options that kernels need.

    jit               a kernel, which Python calls
    jit_subroutine    a function that only compiled code calls
    inline_jit        a subroutine that is inlined into its callers
    jit_no_alloc      a kernel that makes no arrays
    jit_alloc         a function that makes arrays, called by functions that make none
    jit_sums          a kernel with sums over neighbours, without arrays of its own, in the precision of its packs
    inline_sums       a subroutine of such sums that is inlined into its callers
    jit_sums_alloc    a kernel with such sums that makes arrays

A process that compiles a function may call another copy of a callee than a process that loads the function from disk.
Their results then differ in the last bits. Functions that are `inline_jit` have no separate copy.

`inline_jit` and `jit_no_alloc` functions do not count references to arrays. numba otherwise counts one at each access
to a tuple of arrays, an atomic operation that costs more than the work for a particle. These functions therefore make
no arrays and return none. A kernel that needs scratch arrays makes them once for its chunk of the loop.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

from discsim.jit.cache import located
from discsim.jit.compiler import SumsCompiler

# No wrapper for C: nothing calls kernels by their address, and the wrapper would take 3% of the compile time.
KERNEL: Any = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
NO_ALLOC: Any = {**KERNEL, "_nrt": False}
# No wrapper for Python, which would take 33% of the compile time.
CALLED: Any = {"no_cpython_wrapper": True}
INLINE: Any = {**NO_ALLOC, **CALLED, "forceinline": True}
# Sums over neighbours may be reordered. No 'nnan'/'ninf': NaN and infinities of a failing run must be kept, so that it
# is stopped. With Python's error_model a division may raise, and no loop with a division is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
SUMS: Any = {**NO_ALLOC, "fastmath": FAST, "pipeline_class": SumsCompiler}


def kept(**options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function with these options of `njit` and caches it on disk."""

    def decorate(function: Callable) -> Any:
        with located():
            return njit(**options)(function)

    return decorate


jit = kept(**KERNEL)
jit_subroutine = kept(**KERNEL, **CALLED)
inline_jit = kept(**INLINE)
jit_no_alloc = kept(**NO_ALLOC)
jit_alloc = kept(**{**KERNEL, "_nrt": True})
jit_sums = kept(**SUMS)
inline_sums = kept(**SUMS, **CALLED, forceinline=True)
jit_sums_alloc = kept(**KERNEL, fastmath=FAST)
