"""Loops for numba. All take the same options where they can: numba compiles what it brings itself (np.empty, min, ...)
once for each set of options, and each number given literally to a function makes a version of it. An array assigned to
a slice of another takes two seconds to compile, as numba brings the text of an error about shapes with it, and all that
puts texts together: a loop takes none of that.

LLVM leaves half of a 512-bit vector unused on the processors that have them unless told not to. The SPH sums wait for
chains of instructions rather than for their number, and take a seventh less time with whole vectors. The choice is
that of the process, before anything is compiled; NUMBA_CPU_FEATURES in the environment comes first.
"""

from pathlib import Path

from llvmlite.binding import get_host_cpu_name
from numba import config
from numba.core.codegen import get_host_cpu_features

from discsim.kernels import bookkeeping, cache, copied, kept

features = get_host_cpu_features()
if config.CPU_FEATURES is None and "+avx512f" in features:  # type: ignore[attr-defined]
    config.CPU_FEATURES = features + ",-prefer-256-bit"  # type: ignore[attr-defined]
# Numbers of single precision in a vector, at most.
SINGLES = 16 if "+avx512f" in (config.CPU_FEATURES or "") else 8  # type: ignore[attr-defined]

bookkeeping.take_over()
copied.take_over()
kept.take_over()
target = (config.CPU_NAME or get_host_cpu_name(), config.CPU_FEATURES or features)  # type: ignore[attr-defined]
cache.follow(Path(__file__).parent, repr(target))
cache.ensure(lambda: None)  # of this directory, as the kernels are
