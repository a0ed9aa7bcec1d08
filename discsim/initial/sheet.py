"""A periodic sheet at rest with Sigma = Sigma_0 (1 + A sin(k x)): sound against self-gravity."""

import numpy as np

from discsim.initial.lattice import stretch, uniform


def particles(scene):
    start = scene.initial
    size = np.array(scene.space.size)
    wavevector = np.zeros(len(size))
    wavevector[0] = 2.0 * np.pi * start.wavenumber / size[0]
    out = uniform(scene, start.surface_density)
    for arrays in out.values():
        stretch(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
    return out
