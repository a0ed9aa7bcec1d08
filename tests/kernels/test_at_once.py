"""Processes that compile variants of a kernel at once leave each other's code alone."""

import os

from numba.core import caching

from discsim.kernels.cache import CacheFile

COUNT = 60


def test_what_two_processes_save_is_all_there(tmp_path):
    def cache():
        return CacheFile(str(tmp_path), "forces", "stamp")

    children = []
    for who in range(3):
        children.append(os.fork())
        if children[-1] == 0:
            try:
                for k in range(COUNT):
                    cache().save((who, k), f"{who} {k}")
            finally:
                os._exit(0)
    for child in children:
        os.waitpid(child, 0)
    assert caching.IndexDataCacheFile is CacheFile  # what numba makes for a kernel
    assert all(cache().load((who, k)) == f"{who} {k}" for who in range(3) for k in range(COUNT))
