"""Decorators of compiled functions: `njit` with the options that kernels need.

    jit               a kernel: a function that Python calls
    jit_subroutine    a function that only compiled code calls
    inline_jit        a subroutine that is inlined into its callers; it must not allocate arrays
    jit_no_alloc      a kernel that allocates no arrays
    jit_alloc         a function that allocates arrays for callers that must not
    jit_sums          a kernel of sums over neighbours, in the precision of its packs; it must not allocate arrays
    inline_sums       a subroutine of such sums that is inlined into its callers
    jit_sums_alloc    a kernel of such sums that allocates arrays

A process that compiles a function may use a differently optimised copy of a called function than a process that loads
the function from disk. The results of the two processes then differ in the last bits. `inline_jit` avoids this, as
inlined functions have no separate copy.

`inline_jit`, `jit_no_alloc` and `jit_sums` switch numba's reference counting off. numba otherwise counts a reference at
each access to a tuple of arrays, an atomic operation that costs more than the work for a particle. These functions
therefore neither allocate nor return arrays. Kernels allocate scratch arrays once per chunk of their loop.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

from discsim.jit.cache import LOCATOR, config
from discsim.jit.compiler import SumsCompiler

# No wrapper for calls from C: nothing calls kernels by their address, and it would take 3% of the compile time.
KERNEL: Any = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
NO_ALLOC: Any = {**KERNEL, "_nrt": False}
# No wrapper for calls from Python: it would take 33% of the compile time.
NO_PYTHON_WRAPPER: Any = {"no_cpython_wrapper": True}
INLINE: Any = {**NO_ALLOC, **NO_PYTHON_WRAPPER, "forceinline": True}
# Sums over neighbours may be reordered. The flags nnan and ninf are not set: NaN and infinities must be kept, as they
# stop a failing run. error_model "numpy" (KERNEL) lets loops with divisions be vectorised, as no division can raise.
FAST = {"reassoc", "contract", "arcp", "nsz"}
SUMS: Any = {**NO_ALLOC, "fastmath": FAST, "pipeline_class": SumsCompiler}


def cached_njit(**options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function with these options of `njit` and caches it in the kernel folder."""

    def decorate(function: Callable) -> Any:
        before, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, LOCATOR
        try:
            return njit(**options)(function)
        finally:  # other packages keep their own caches
            config.CACHE_LOCATOR_CLASSES = before

    return decorate


jit = cached_njit(**KERNEL)
jit_subroutine = cached_njit(**KERNEL, **NO_PYTHON_WRAPPER)
inline_jit = cached_njit(**INLINE)
jit_no_alloc = cached_njit(**NO_ALLOC)
jit_alloc = cached_njit(**{**KERNEL, "_nrt": True})
jit_sums = cached_njit(**SUMS)
inline_sums = cached_njit(**SUMS, **NO_PYTHON_WRAPPER, forceinline=True)
jit_sums_alloc = cached_njit(**KERNEL, fastmath=FAST)
