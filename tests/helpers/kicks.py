"""Gas and dust of a kick of drag by itself, and what it must keep."""

import numpy as np

from discsim import Simulation


def kicked(scheme, particles, coefficient, dt, step=0, law="constant", **drag):
    """Velocities of gas and dust, by ids, after a kick without any accelerations."""
    key = {"constant": "K", "stopping-time": "t_stop"}[law]
    sim = Simulation(
        {
            "units": {"system": "code"}, "run": {"until": 1.0},
            "space": {"size": 1.0, "boundary": "periodic", "cells": 16},
            "gas": {"particles": len(particles["gas"]["mass"]), "eos": {"kind": "isothermal", "sound_speed": 1.0}},
            "dust": {"particles": len(particles["dust"]["mass"]), "ratio": 1.0},
            "drag": {"law": law, key: coefficient, "scheme": scheme, **drag},
        },
        particles=particles,
    )  # fmt: skip
    sim.state.step = step
    sim._prepare()
    for rates in (sim.gas.acc, sim.dust.acc, sim.state.acc_unshared["gas"]):
        rates[:] = 0.0
    sim.operators.kick(dt)
    return [p.vel[np.argsort(p.ids)] for p in (sim.gas, sim.dust)]


def momentum_and_energy(particles, velocities, frame=0.0):
    terms = [p["mass"][:, None] * v for p, v in zip(particles.values(), velocities, strict=True)]
    energy = sum(
        0.5 * (p["mass"][:, None] * (v - frame) ** 2).sum() for p, v in zip(particles.values(), velocities, strict=True)
    )
    return sum(t.sum(axis=0) for t in terms), sum(np.abs(t).sum() for t in terms), energy


def start(particles):
    return [p["vel"] for p in particles.values()]


def barycentre(particles):
    return momentum_and_energy(particles, start(particles))[0] / sum(p["mass"].sum() for p in particles.values())
