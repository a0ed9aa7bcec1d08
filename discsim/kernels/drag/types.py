"""Arguments of the drag kernels: gas and dust sorted into blocks, and the drag law."""

from typing import NamedTuple

import numpy as np


class Species(NamedTuple):
    """Particles of the gas, or of all dust populations, sorted into blocks.

    pos, vel, acc (n, d), mass (n,): arrays of the state; a kick changes `vel`. source (n, d): accelerations that act
    on this species only, without rows if there are none. density (n,): density of the gas. For dust the array has
    `Dust.per_grain` of `drag/base.py`, or is empty. sound (n,): sqrt(P / rho) of the gas; empty for dust. order,
    start: particle indices sorted by block and, in a block, by population; the particles of population p in block b
    are order[start[i] : start[i + 1]] with i = b number + p. number: number of populations, 1 for gas. first: index
    of the first population among all species, 0 for gas and 1 for dust.
    """

    pos: np.ndarray
    vel: np.ndarray
    acc: np.ndarray
    source: np.ndarray
    mass: np.ndarray
    density: np.ndarray
    sound: np.ndarray
    order: np.ndarray
    start: np.ndarray
    number: int
    first: int


class LawOverStep(NamedTuple):
    """Drag over a step dt.

    code, grains: form of the drag law and parameters of each population (`formulas/laws.py`). two_way: whether drag
    acts on the gas too. exponential: whether slips relax by the exact exponential; False for implicit Euler.
    """

    code: int
    grains: np.ndarray
    two_way: bool
    dt: float
    exponential: bool
