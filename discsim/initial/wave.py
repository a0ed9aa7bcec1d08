"""A sin(k x) in the densities and velocities of gas and dust (DustyWave; Laibe & Price 2011).

rho = 1 + A sin(k.x), v = u = boost + A sin(k.x) k/|k|, in code units; k = 2 pi wavenumber (direction / size).
"""

import numpy as np

from discsim.initial.lattice import stretch, uniform


def particles(scene):
    start = scene.initial
    size = np.array(scene.space.size)
    wavevector = 2.0 * np.pi * start.wavenumber * np.array(start.direction) / size
    along = wavevector / np.linalg.norm(wavevector)
    out = uniform(scene, 1.0)
    for arrays in out.values():
        phase = stretch(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
        arrays["vel"] += np.outer(start.amplitude * np.sin(phase), along) + np.array(start.velocity)
    return out
