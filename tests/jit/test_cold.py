"""A process that compiles its kernels gives the bits of one that finds them compiled, in whatever order they come."""

import pytest
from drags import OF_PARTICLES, ON_GRID
from runs import DISC, SHOCK, WAVE, bits_of

from discsim.scene import load_scene


@pytest.mark.slow
def test_a_cold_start_gives_the_same_bits(tmp_path):
    """Sums whose order the compiler chooses are where it could differ: what was compiled alone is optimised anew where
    it is called from, and the linker takes the copy that it meets first.
    """
    texts = {f"wave {scheme}": (WAVE, [f"drag.scheme={scheme}"]) for scheme in OF_PARTICLES}
    texts |= {f"disc {scheme}": (DISC, [f"drag.scheme={scheme}"]) for scheme in OF_PARTICLES}
    on_cells = WAVE.replace("smoothing_length = 0.025\n", "")
    texts |= {f"wave {scheme}": (on_cells, [f"drag.scheme={scheme}"]) for scheme in ON_GRID}
    texts["shock"] = (SHOCK, [])
    paths = []
    for name, (text, changes) in texts.items():
        paths.append(tmp_path / f"{name}.toml")
        paths[-1].write_text(text)
        paths[-1].write_text(load_scene(paths[-1], changes).text)
    given = [f"{path}@1" for path in paths]
    cold, *warm = (
        bits_of(order, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for order in (given, given[::-1], given[1::2])
    )
    assert len(cold) == len(paths) and warm[0] == cold and warm[1].items() <= cold.items()
