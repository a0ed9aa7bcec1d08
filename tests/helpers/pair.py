"""Discs about a tight pair of stars, about one star of the same central mass, and what each effect makes of them."""

import numpy as np

from discsim import Simulation

FIRST, SECOND, APART, SOFT = 0.9, 0.27, 0.05, 0.13
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.07, "temperature_index": 0.6, "reference_radius": 1.3}
LOCALLY = {**ADIABATIC, "kind": "locally-isothermal"}
del LOCALLY["gamma"]
GRAINS = {"particles": 300, "ratio": 0.02, "inner": 1.2, "outer": 1.8, "grain_size": 3e-5, "grain_density": 1.5}
STOKES = {"law": "epstein-stokes", "mean_free_column": 1e-6, "convention": "kinetic", "direction": "two-way"}
PASSIVE = {"aspect_ratio": 0.05, "temperature_index": 0.4, "reference_radius": 1.7}

EFFECTS = {
    "locally isothermal": {"gas": LOCALLY},
    "adiabatic": {},
    "cooling, beta": {"cooling": {"kind": "beta", "beta": 5.0, **PASSIVE}},
    "cooling, passive": {"cooling": {"kind": "constant", "t_cool": 0.8, **PASSIVE}},
    "cooling, own H/r": {"cooling": {"kind": "constant", "t_cool": 0.8}},
    "damping": {"damping": {"inner": [1.0, 1.3], "outer": [1.7, 2.0], "time": 0.2}},
    "drag, Stokes regime": {"dust": GRAINS, "drag": STOKES},
    "drag, stokes-number": {"dust": GRAINS, "drag": {"law": "stokes-number", "stokes": 0.3}},
    "growth": {
        "gas": LOCALLY, "dust": GRAINS | {"ratio": 0.3, "grain_size": 1e-6},
        "drag": {"law": "epstein", "convention": "kinetic"},
        "growth": {"fragmentation_speed": 0.02, "alpha": 2e-3, "small_size": 1e-7, "smallest": 1e-9},
    },
    "diffusion": {"dust": GRAINS, "drag": {"law": "epstein"}, "dust_diffusion": {"alpha": 0.02}},
    "alpha viscosity": {"gas": LOCALLY, "alpha_viscosity": {"alpha": 0.05, "index": 0.5}},
    "radiation pressure": {"dust": GRAINS, "drag": {"law": "epstein"}, "radiation_pressure": {"beta": 0.2}},
    "self-gravity": {"gas": LOCALLY, "self_gravity": {"softening": 0.2}},
    "relaxed start": {"gas": LOCALLY, "initial": {"relax": 0.2}},
}  # fmt: skip


def scene(pair, gas=ADIABATIC, initial=(), ramp=0.0, grows=False, until=1.5, **tables):
    """A disc from 1 to 2 about a pair 0.05 apart, or about one star of both masses."""
    star = {"mass": FIRST if pair else FIRST + SECOND, "softening": SOFT, "frame": "inertial"}
    if pair:
        star["centre"] = "barycentre"
        tables["companion"] = [
            {"mass": SECOND, "semi_major_axis": APART, "phase": 40.0, "softening": str(SOFT), "ramp": ramp}
        ]
    elif "radiation_pressure" in tables:  # one of the pair shines, of a share FIRST / (FIRST + SECOND) of the pull
        tables["radiation_pressure"] = {"beta": tables["radiation_pressure"]["beta"] * FIRST / (FIRST + SECOND)}
    return {
        "units": {"system": "code"},
        "run": {"until": until, "timestep": 0.025},
        "space": {"size": 8.0, "cells": 64},
        "initial": {"kind": "disc", "mass": 0.002, "inner": 1.0, "outer": 2.0, "reference_radius": 1.4} | dict(initial),
        "gas": {"particles": 900, "kernel": "wendland-c4", "eos": gas, "viscosity": {"alpha": 0.3, "beta": 0.6}},
        "star": star,
    } | tables  # fmt: skip


def found(sim):
    """Numbers by name (n,) that the table compares, in the order of ids, with closed velocities."""
    out, gas = {}, sim.state.gas
    with sim.synchronised() as state:
        for name, p in state.species.items():
            place, speed = state.centre
            pos, vel = p.pos - place, p.vel - speed
            order, r = np.argsort(p.ids), np.hypot(*pos.T)
            out[f"r {name}"] = r[order]
            out[f"v_phi {name}"] = ((pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]) / r)[order]
        if state.cooled_energy is not None:
            still = gas.copy()
            still.kick_rate[:] = 0.0
            out["u cooled"] = state.cooled_energy(still, 0.1)[np.argsort(gas.ids)]
        if gas.u is not None:
            out["u"] = gas.u[np.argsort(gas.ids)].copy()
        else:
            out["c_s"] = gas.sound_speed[np.argsort(gas.ids)].copy()
        if gas.nu is not None:
            out["nu"] = gas.nu[np.argsort(gas.ids)].copy()
        if "drag" in sim.effects:
            order = np.argsort(state.dust.ids)
            out["St"] = sim.effects["drag"].columns(state)["dust"]["stokes"][order]
            if state.dust.size is not None:
                out["size"] = state.dust.size[order].copy()
    return out


def differences(one, other):
    """By name the largest relative difference of the means of 6 rings between two runs."""
    out = {}
    for name in one:
        ring = np.argsort(np.argsort(other["r dust" if name in ("St", "size") or "dust" in name else "r gas"])) * 6
        ring //= len(ring)
        means = [np.bincount(ring, run[name]) / np.bincount(ring) for run in (one, other)]
        out[name] = float(np.abs(means[0] / means[1] - 1.0).max())
    return out


def run(pair, until=1.5, **tables):
    sim = Simulation(scene(pair, until=until, **tables))
    sim.run()
    return found(sim)
