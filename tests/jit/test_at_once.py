"""Processes that compile versions of a kernel at once leave each other's machine code alone."""

import os
import subprocess
import sys
import time

import filelock

# A kernel in a file of its own. Says when it is about to compile, and where it is kept.
KERNEL = """
from discsim.jit.decorators import jit

@jit
def twice(x):
    return 2 * x
"""
USE = """
import sys
from discsim.jit import cache
from one_kernel import twice
print(cache.kernel_folder(), flush=True)
print(twice(1.5), sum(twice.stats.cache_hits.values()), flush=True)
"""


def begin(tmp_path):
    """A process that compiles `twice`, or loads it, and the folder where it is kept."""
    (tmp_path / "one_kernel.py").write_text(KERNEL)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", USE], env=environment, stdout=subprocess.PIPE, text=True)
    return process, tmp_path / "cache" / os.path.basename(process.stdout.readline().strip())


def kept(folder):
    return sorted(path.name for path in folder.iterdir() if path.suffix in (".nbi", ".nbc"))


def test_a_process_writes_once_others_have_written(tmp_path):
    first, folder = begin(tmp_path)
    assert first.communicate()[0] == "3.0 0\n" and len(kept(folder)) == 2
    for path in folder.iterdir():
        path.unlink()
    with filelock.FileLock(folder / "lock"):
        second, folder = begin(tmp_path)
        for _ in range(30):  # it compiles in less; where it is late nothing is seen
            time.sleep(0.1)
            assert kept(folder) == []
    assert second.communicate()[0] == "3.0 0\n" and len(kept(folder)) == 2
    third, _ = begin(tmp_path)
    assert third.communicate()[0] == "3.0 1\n"


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    first, folder = begin(tmp_path)
    first.communicate()
    for path in folder.iterdir():
        path.unlink()
    (folder / "lock").symlink_to(tmp_path / "elsewhere")
    second, _ = begin(tmp_path)
    assert second.communicate()[0] == "3.0 0\n" and len(kept(folder)) == 2
    assert not (tmp_path / "elsewhere").exists()
