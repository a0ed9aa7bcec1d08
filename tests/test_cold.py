"""A process that compiles its kernels gives the bits of one that finds them compiled, in whatever order they come."""

import os
import subprocess
import sys

import pytest
from test_runner import DISC, SHOCK, WAVE

from discsim.drag import GRID_SCHEMES, SCHEMES
from discsim.scene import load_scene

BITS = """
import hashlib, sys
from discsim import Simulation, load_scene
for path in sys.argv[1:]:
    sim = Simulation(load_scene(path))
    for _ in range(3):
        sim.step()
    bits = hashlib.sha256()
    for particles in sim.state.species.values():
        for array in particles.arrays().values():
            bits.update(array.tobytes())
    print(path, bits.hexdigest())
"""


@pytest.mark.slow
def test_a_cold_start_gives_the_same_bits(tmp_path):
    """Sums whose order the compiler chooses are where it could differ: what was compiled alone is optimised anew where
    it is called from, and the linker takes the copy that it meets first.
    """
    texts = {f"wave {scheme}": (WAVE, [f"drag.scheme={scheme}"]) for scheme in SCHEMES}
    texts |= {f"disc {scheme}": (DISC, [f"drag.scheme={scheme}"]) for scheme in SCHEMES}
    on_cells = WAVE.replace("smoothing_length = 0.025\n", "")
    texts |= {f"wave {scheme}": (on_cells, [f"drag.scheme={scheme}"]) for scheme in GRID_SCHEMES}
    texts["shock"] = (SHOCK, [])
    paths = []
    for name, (text, changes) in texts.items():
        paths.append(tmp_path / f"{name}.toml")
        paths[-1].write_text(text)
        paths[-1].write_text(load_scene(paths[-1], changes).text)
    found = []
    for order in (paths, paths[::-1], paths[1::2] + paths[::2]):
        done = subprocess.run(
            [sys.executable, "-c", BITS, *map(str, order)],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            check=True,
        )
        found.append(set(done.stdout.splitlines()))
    assert len(found[0]) == len(paths)
    assert found[1] == found[0] and found[2] == found[0]
