"""A uniform periodic box with a velocity of its own for gas and dust (DustyBox; Laibe & Price 2011)."""

import numpy as np

from discsim.initial.lattice import uniform


def particles(scene):
    start = scene.initial
    out = uniform(scene, start.density)
    for name, arrays in out.items():
        arrays["vel"] += np.array(getattr(start, f"{name}_velocity"))
    return out
