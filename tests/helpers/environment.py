"""Environment variables of the tests: those of the user's shell that change results, threads or texts are removed.

numba, numpy, typer and matplotlib read theirs when they are imported, so the tests settle them first. Child processes
inherit them. Variables that say where packages are (PATH, PYTHONPATH, PIP_*, NUMBA_CACHE_DIR) are left as they are.
"""

from collections.abc import MutableMapping

KEPT = ("NUMBA_CACHE_DIR",)
# How names begin, by what reads them.
REMOVED = (
    "NUMBA_", "NPY_", "OMP_", "GOMP_", "KMP_", "MKL_", "OPENBLAS_", "BLIS_",  # loops and their threads
    "MALLOC_", "GLIBC_",  # discsim/cli/process.py leaves malloc as they say
    "PMI_", "PMIX_", "OMPI_", "MV2_", "HYDRA_", "SLURM_",  # tests in a job of a cluster are no ranks of it
    "MPLBACKEND", "MATPLOTLIBRC", "SOURCE_DATE_EPOCH",
    "TERM", "COLUMNS", "LINES", "COLORTERM", "NO_COLOR", "FORCE_COLOR", "CLICOLOR", "PY_COLORS", "TTY_",
    "GITHUB_ACTIONS", "TYPER_", "_TYPER_",  # typer and rich colour by these too
    "LANG", "LC_", "PYTHONUTF8", "PYTHONIOENCODING",
    "PYTHONWARNINGS", "PYTHONOPTIMIZE", "PYTHONDEVMODE",
)  # fmt: skip
# One thread: parallel regions of a few particles only wait.
SET = {"NUMBA_NUM_THREADS": "1", "TERM": "xterm-256color", "LANG": "C.UTF-8"}


def settle(variables: MutableMapping[str, str]) -> None:
    """Remove what a shell may have set, and set what every test has."""
    for name in [name for name in variables if name.startswith(REMOVED) and name not in KEPT]:
        del variables[name]
    variables.update(SET)
