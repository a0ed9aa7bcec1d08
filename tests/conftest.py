"""One thread for every test: parallel regions of a few particles only wait. Read when numba is first imported.

What runs learn of this machine's speed stays among the tests.
"""

import os
import tempfile

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="discsim-tests-")
