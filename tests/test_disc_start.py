"""Velocities that a disc starts with."""

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.exact import nsh
from discsim.physics import profile

ASPECT = 0.05


def disc(dust, **drag):
    """Sigma ~ 1/r and H/r = .05 everywhere, from 1 to 3."""
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0, "cells": 32},
            "initial": {"kind": "disc", "mass": 1e-4, "inner": 1.0, "outer": 3.0},
            "gas": {
                "particles": 2000,
                "eos": {"kind": "locally-isothermal", "aspect_ratio": ASPECT, "temperature_index": 1.0},
            },
            "dust": dust,
            "star": {"mass": 1.0},
            "drag": {"law": "epstein"} | drag,
        }
    )


def beyond_kepler(particles):
    """Radius, and radial and azimuthal velocity beyond Kepler's over the headwind eta v_K."""
    r = np.sqrt((particles.pos**2).sum(axis=1))
    radial = (particles.pos * particles.vel).sum(axis=1) / r
    azimuthal = (particles.pos[:, 0] * particles.vel[:, 1] - particles.pos[:, 1] * particles.vel[:, 0]) / r
    unit = ASPECT**2 * r**-0.5
    return r, radial / unit, (azimuthal - r**-0.5) / unit


def grains(stokes, ratio, **keys):
    """Grains whose Stokes number at r = 1 is given: St = s rho_s sqrt(2 pi) / Sigma, so that it grows with r."""
    sigma = 1e-4 / (4 * np.pi)  # of the disc's mass, at r = 1
    return {
        "particles": 400,
        "ratio": ratio,
        "grain_size": stokes * sigma / np.sqrt(2 * np.pi),
        "grain_density": 1.0,
    } | keys


@pytest.mark.parametrize(
    ("stokes", "ratios"),
    [((0.02, 0.1, 0.6), (0.2, 0.3, 0.5)), (np.logspace(-3, 1, 8), np.full(8, 0.1))],
    ids=["three", "eight"],
)
def test_populations_start_at_their_common_drift(stokes, ratios):
    sim = disc([grains(st, ratio) for st, ratio in zip(stokes, ratios, strict=True)])
    r, *gas = beyond_kepler(sim.gas)
    found = nsh.of_populations(np.outer(stokes, r), np.outer(ratios, np.ones(len(r))), 1.0)
    # To rounding of the Keplerian velocity over the headwind.
    np.testing.assert_allclose(gas, [found.gas_radial, found.gas_azimuthal], rtol=1e-9, atol=1e-12)
    r, *dust = beyond_kepler(sim.dust)
    found = nsh.of_populations(np.outer(stokes, r), np.outer(ratios, np.ones(len(r))), 1.0)
    own = sim.dust.species, np.arange(len(r))
    np.testing.assert_allclose(dust, [found.dust_radial[own], found.dust_azimuthal[own]], rtol=1e-9, atol=1e-12)


def test_gas_where_there_is_no_dust_feels_none():
    """A population beyond r = 2 alone: within, gas turns with its whole headwind and dust-free."""
    sim = disc([grains(0.1, 1.0, inner=2.0), grains(0.1, 1e-9)])
    r, radial, azimuthal = beyond_kepler(sim.gas)
    within = r < 2.0
    np.testing.assert_allclose(azimuthal[within], -1.0, atol=1e-6)
    np.testing.assert_allclose(radial[within], 0.0, atol=1e-6)
    assert azimuthal[~within].max() < -0.3 and azimuthal[~within].min() > -0.7 and radial[~within].min() > 0.05


def test_one_way_dust_starts_as_if_alone():
    sim = disc([grains(0.1, 1.0), grains(1.0, 1.0)], direction="one-way")
    r, radial, _ = beyond_kepler(sim.dust)
    alone = nsh.velocities(np.array([0.1, 1.0])[sim.dust.species] * r, 0.0, 1.0)
    np.testing.assert_allclose(radial, alone.dust_radial, rtol=1e-9)
    np.testing.assert_allclose(beyond_kepler(sim.gas)[1], 0.0, atol=1e-9)


def test_the_start_is_held_by_the_pressure_of_its_tapers():
    """-(1/Sigma) dP/dr by differences, but next to the edges, where no rotation balances the fall."""
    start = {"kind": "disc", "mass": 1e-4, "inner": 1.0, "outer": 3.0, "inner_taper": 0.6, "outer_taper": 0.8}
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 0.7}
    scene = load_scene(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0},
            "initial": start,
            "gas": {"particles": 10, "eos": eos},
            "star": {"mass": 1.0},
        }
    )
    r, step = np.linspace(1.25, 2.4, 50), 1e-5

    def pressure(r):
        return profile.sound_speed(scene, r, r) ** 2 * profile.surface_density(scene, r)

    slope = (pressure(r + step) - pressure(r - step)) / (2 * step)
    expected = -slope / profile.surface_density(scene, r)
    # Of the difference, step^2, and its rounding, 1e-16 / step.
    np.testing.assert_allclose(profile.pressure_acceleration(scene, r), expected, rtol=1e-6, atol=1e-9)
