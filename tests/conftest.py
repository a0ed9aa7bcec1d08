"""One thread for every test: parallel regions of a few particles only wait. Read when numba is first imported."""

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
