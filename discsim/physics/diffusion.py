"""Turbulent diffusivity of dust (`[dust_diffusion]`), as functions of a scene. Numpy only.

    D   = D_g / (1 + St^2),  St = t_stop Omega                                      (1)  Youdin & Lithwick 2007
    D_g = alpha c_s H = alpha c_s^2 / Omega, or nu of [alpha_viscosity]             (2)

c_s is the isothermal sound speed, as in `physics/viscosity.py`. Omega is the frequency of circular orbits about the
central mass; in a vertical layer without a star it is `external.vertical_frequency`. A given D applies to grains of
any Stokes number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.physics import laws, viscosity

if TYPE_CHECKING:
    from discsim.physics.local import GasSamples
    from discsim.scene import Scene

Array = np.ndarray
NODES, INWARDS = 4096, 1e5  # number of nodes of the table in ln r; ratio of its largest to its smallest radius


def is_viscosity(scene: Scene) -> bool:
    """Return whether the gas diffusivity D_g is the viscosity of [alpha_viscosity]."""
    keys = scene.table("dust_diffusion")
    return keys.alpha is None and keys.D is None


def uniform_diffusivity(scene: Scene) -> float | None:
    """Return the uniform diffusivity of a scene, D of [dust_diffusion] or nu of [alpha_viscosity].

    Returns None if the diffusivity of the gas is alpha c_s H.
    """
    keys = scene.table("dust_diffusion")
    return scene.table("alpha_viscosity").nu if is_viscosity(scene) else keys.D


def alpha(scene: Scene, r: Array) -> Array:
    """Return alpha (n,) at radii `r` (n,), for scenes in which `uniform_diffusivity` returns None."""
    keys = scene.table("dust_diffusion")
    return viscosity.alpha(scene, r) if is_viscosity(scene) else np.full(np.shape(r), keys.alpha)


def alpha_table(scene: Scene) -> tuple[Array, float, float]:
    """Return (table, first, nodes) of alpha as a function of ln r.

    table (n, 2): alpha and d alpha / d ln r at equidistant ln r; no rows if the diffusivity is uniform. first: ln r
    of the first node. nodes: number of nodes per unit of ln r.
    """
    if uniform_diffusivity(scene) is not None:
        return np.empty((0, 2)), 0.0, 1.0
    last = np.log(max(scene.space.size))
    log = np.linspace(last - np.log(INWARDS), last, NODES)
    values = alpha(scene, np.exp(log))
    return np.stack([values, np.gradient(values, log)], axis=1), float(log[0]), (NODES - 1) / float(log[-1] - log[0])


def frequency(scene: Scene) -> float:
    """Return `external.vertical_frequency`, the uniform Omega of a vertical layer; 0 without it, or with a star."""
    return scene.external.vertical_frequency if scene.star is None and scene.external is not None else 0.0


def diffusivities(scene: Scene, at: GasSamples) -> list[tuple[Array, Array]]:
    """Return (D, St), arrays (n,) at the points of `at`, for each population; an empty list if they are undefined."""
    omega = np.full_like(at.density, frequency(scene)) if at.omega is None else at.omega
    given = uniform_diffusivity(scene)
    if scene.table("dust_diffusion").D is not None:
        return [(np.full_like(at.density, given), np.zeros_like(at.density))] * len(scene.dust or ())
    if given is not None:
        of_gas = np.full_like(at.density, given)
    elif at.thermal_speed is None or (scene.star is not None and at.radius is None):
        return []
    else:
        radius = np.ones_like(at.density) if at.radius is None else at.radius
        of_gas = alpha(scene, radius) * at.thermal_speed**2 / omega  # eq. (2)
    times = laws.stopping_times(scene, at.density, at.thermal_speed, at.omega)
    return [(of_gas / (1.0 + (time * omega) ** 2), time * omega) for time in times]  # eq. (1)
