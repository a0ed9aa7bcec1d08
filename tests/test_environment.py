"""The tests hold whatever a user's shell has set, and what the pages install is all that they need."""

import os
import subprocess
import sys
from pathlib import Path

import environment
import pytest

HOME = Path(__file__).parents[1]
# Each of these changed a result, a count of pieces, a colour, a width or an encoding of some test, or could have.
HOSTILE = {
    "NUMBA_NUM_THREADS": "2", "NUMBA_DISABLE_JIT": "1", "NUMBA_BOUNDSCHECK": "1", "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "", "NUMBA_OPT": "0", "NUMBA_THREADING_LAYER": "none", "OMP_NUM_THREADS": "3",
    "MALLOC_ARENA_MAX": "1", "PMI_SIZE": "4", "PMI_RANK": "1", "SLURM_NTASKS": "4", "MPLBACKEND": "svg",
    "TERM": "dumb", "COLUMNS": "23", "LINES": "5", "FORCE_COLOR": "1", "CLICOLOR_FORCE": "1", "GITHUB_ACTIONS": "true",
    "LANG": "de_DE.ISO-8859-1", "LC_ALL": "C", "LANGUAGE": "de", "PYTHONUTF8": "0", "PYTHONIOENCODING": "latin-1",
    "PYTHONWARNINGS": "error",
}  # fmt: skip
# What counts on one piece a loop, and one of what is drawn on a terminal.
SENSITIVE = (
    "tests/numerics/test_neighbours.py::test_windows_hold_all_that_are_within_reach_along_x",
    "tests/numerics/test_neighbours.py::test_candidates_hold_every_neighbour_of_every_image",
    "tests/kernels/test_meeting_sums.py::test_diffusion_sums_the_gas_about_a_grain",
    "tests/run/test_screen.py::test_an_encoding_without_the_letters",
    "tests/run/test_screen.py::test_a_pipe_gets_plain_lines",
)
# All that start processes, draw, print, count threads or look for the cache of kernels.
EXPOSED = (
    "tests/test_cli.py", "tests/test_notebook.py", "tests/test_readme.py", "tests/test_lazy.py", "tests/kernels",
    "tests/numerics", "tests/run", "tests/plot", "tests/preview", "tests/scene", "tests/output", "tests/study",
    "tests/drag/test_pairs_kept.py", "tests/initial/test_relaxation.py",
)  # fmt: skip


def passed(tests, timeout):
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(
        command, cwd=HOME, env=os.environ | HOSTILE, capture_output=True, text=True, errors="replace", timeout=timeout
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]


def test_settled_variables_do_not_depend_on_the_shell():
    plain = {"PATH": "/bin", "NUMBA_CACHE_DIR": "/kernels", "PYTHONPATH": "/packages"}
    hostile = plain | HOSTILE
    environment.settle(plain)
    environment.settle(hostile)
    assert hostile == plain and plain["NUMBA_CACHE_DIR"] == "/kernels" and plain["NUMBA_NUM_THREADS"] == "1"


@pytest.mark.slow
def test_sensitive_tests_pass_in_a_hostile_shell():
    passed(SENSITIVE, 300)


@pytest.mark.slow
def test_exposed_tests_pass_in_a_hostile_shell():
    passed(EXPOSED, 3600)
