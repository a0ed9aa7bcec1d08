"""Gas of given particles alone, and the formula of a kernel, for sums over neighbours."""

import numpy as np

from discsim import Simulation
from discsim.kernels.sph.smoothing import KERNELS, SUPPORT, shape


def w(kernel, dim, q):
    """w and dw/dq of the code's formula at an array of q."""
    flat = [shape.py_func(KERNELS[kernel], dim, min(x, SUPPORT[KERNELS[kernel]])) for x in q.ravel()]
    return np.array([a for a, _ in flat]).reshape(q.shape), np.array([b for _, b in flat]).reshape(q.shape)


def simulation(pos, dim, boundary, kernel="cubic", mass=None, vel=None, u=None, eos=None, cs=1.0, **gas):
    """A simulation of the given gas alone, its forces made."""
    n = len(pos)
    gas.setdefault("eos", eos or {"kind": "isothermal", "sound_speed": cs})
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"dimensions": dim, "size": 1.0, "boundary": boundary},
        "gas": {"particles": n, "kernel": kernel, **gas},
    }
    given = {
        "pos": pos,
        "vel": np.zeros((n, dim)) if vel is None else vel,
        "mass": np.full(n, 1.0 / n) if mass is None else mass,
    }
    if u is not None:
        given["u"] = u
    sim = Simulation(scene, particles={"gas": given})
    with sim.synchronised():
        return sim


def uneven(n, dim, seed=1):
    """Positions in the unit box, half of them in a clump of a hundredth of its size, and unequal masses."""
    rng = np.random.default_rng(seed)
    pos = rng.random((n, dim))
    pos[: n // 2] = (0.97 + 0.01 * rng.normal(size=(n // 2, dim))) % 1.0  # across the periodic edge
    return pos, rng.uniform(0.5, 2.0, n) / n


def lattice(n):
    x = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
