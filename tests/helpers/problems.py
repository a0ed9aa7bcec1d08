"""Problems with exact solutions, at any resolution."""

import numpy as np

from discsim import Simulation
from discsim.exact import gresho, sedov, settling
from discsim.initial.blast import shock_radius


def layer(stop, until, law="stopping-time", particles=120, gas=None):
    """A layer of H = 1 with Omega = 1, +-2 high; grains with t_stop = `stop` in the midplane."""
    drag = {"law": law, "convention": "papers", "direction": "one-way"}
    return {
        "units": {"system": "code"}, "run": {"until": until}, "space": {"dimensions": 1, "size": 4.0},
        "initial": {"kind": "settling"},
        "gas": {"particles": particles, "eos": {"kind": "isothermal", "sound_speed": 1.0}} | (gas or {}),
        "dust": {"particles": particles, "ratio": 1e-6, "grain_size": stop, "grain_density": 1.0},
        "external": {"vertical_frequency": 1.0},
        "drag": drag | ({"t_stop": stop} if law == "stopping-time" else {}),
    }  # fmt: skip


def fall(stop, until, law="stopping-time", particles=120):
    """Errors of the way and of the velocity of each grain, over its own and over the largest."""
    sim = Simulation(layer(stop, until, law, particles))
    start = sim.dust.pos[:, 0].copy()
    sim.run()
    order = np.argsort(sim.dust.ids)
    z, u = sim.dust.pos[order, 0], sim.dust.vel[order, 0]

    def stopping_time(height):
        return stop / (settling.gas_density(height, 1.0, 1.0) if law == "epstein" else np.ones_like(height))

    exact, velocity = settling.trajectories(until, start, stopping_time, 1.0)
    terminal = settling.terminal_velocity(z, stopping_time(z), 1.0)
    return np.abs(z - exact) / np.abs(exact - start), np.abs(u - velocity) / np.abs(velocity).max(), u / terminal


def blast(particles, ratio=0.0, stop=0.0, sound_speed=0.01):
    """Shock radii of the species over the exact one, and what the energy lost, when the exact shock is at .35."""
    time = sedov.arrival_time(0.35, 1.0, 1.0 + ratio)
    gas = {"particles": particles, "kernel": "quintic", "viscosity": {}}
    tables = {
        "units": {"system": "code"}, "run": {"until": time}, "space": {"size": 1.0, "cells": int(particles**0.5)},
        "initial": {"kind": "blast", "radius": 2.5 * particles**-0.5},
        "gas": gas | {"eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": sound_speed}},
    }  # fmt: skip
    if ratio:
        tables["dust"] = {"particles": particles, "ratio": ratio}
        tables["drag"] = {"law": "stopping-time", "t_stop": stop * time}
    sim = Simulation(tables)
    before = energy(sim)
    sim.run()
    return [shock_radius(p.pos, p.mass, particles**-0.5) / 0.35 for p in sim.state.species.values()], energy(
        sim
    ) / before - 1.0


def energy(sim):
    with sim.synchronised() as state:
        kinetic = sum(0.5 * (p.mass * (p.vel**2).sum(axis=1)).sum() for p in state.species.values())
        return kinetic + (state.gas.mass * state.gas.u).sum()


def vortex(particles, **gas):
    """Mean error of the azimuthal velocity within the vortex over its largest, after a time of 1."""
    best = {"kernel": "wendland-c4", "eta": 3.0, "viscosity": {"alpha": 0.1, "switch": "balsara"}}
    tables = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "initial": {"kind": "vortex"},
        "space": {"size": 1.0, "boundary": "periodic"},
        "gas": {"particles": particles, "eos": {"kind": "adiabatic", "gamma": 1.4}} | best | gas,
    }  # fmt: skip
    sim = Simulation(tables)
    sim.run()
    x, y = (sim.gas.pos - 0.5).T
    r = np.hypot(x, y)
    error = np.abs((x * sim.gas.vel[:, 1] - y * sim.gas.vel[:, 0]) / r - gresho.speed(r))
    return error[r < 0.4].mean()
