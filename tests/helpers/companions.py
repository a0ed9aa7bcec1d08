"""Scenes with companions of the star, and sums over all that moves."""

import numpy as np

GRAIN = {"pos": [[2.5, 0.0]], "vel": [[0.0, 0.63]], "mass": [1e-12]}
PLANET = {"mass": 1e-3, "semi_major_axis": 1.0, "softening": "0.02"}


def tables(companion, grains=1, star=None, **other):
    """Dust alone about a star with companions."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 8.0, "cells": 32},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 0.5, "outer": 2.0},
        "dust": {"particles": grains, "ratio": 0.01},
        "star": {"mass": 1.0} | (star or {}),
        "companion": companion if isinstance(companion, list) else [companion],
    }  # fmt: skip
    return {key: value for key, value in (scene | other).items() if value not in (None, [None])}


def disc(companion, star=None, gas=400, dust=100, **other):
    """Gas and dust with two-way drag about a softened star, in step with the gas of a planet's disc."""
    return tables(
        companion, dust, {"softening": 0.1} | (star or {}),
        gas={"particles": gas, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
        **{"drag": {"law": "stokes-number", "stokes": 0.3, "scheme": "idic-linear"}} | other,
    )  # fmt: skip


def relative(sim, k=1):
    with sim.synchronised() as state:
        b = state.bodies
        return b.pos[k] - b.pos[0], b.vel[k] - b.vel[0]


def totals(sim):
    """Momentum, the sum of its sizes, and the mass of all that moves; velocities closed."""
    with sim.synchronised() as state:
        everybody = [state.bodies, *state.species.values()]
        momentum = sum((p.mass[:, None] * p.vel).sum(axis=0) for p in everybody)
        size = sum(np.abs(p.mass[:, None] * p.vel).sum() for p in everybody)
        return momentum, size, sum(p.mass.sum() for p in everybody)


def by_ids(p, name):
    return getattr(p, name)[np.argsort(p.ids)]
