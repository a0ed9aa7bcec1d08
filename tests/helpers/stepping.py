"""Small scenes of every kind, and what some steps of them must keep."""

import math

import numpy as np

from discsim.scene import fields

ISOTHERMAL = {"kind": "isothermal", "sound_speed": 1.0}
LOCALLY = {"kind": "locally-isothermal", "aspect_ratio": 0.1}


def scene(initial, gas=None, dimensions=1, boundary="periodic", **tables):
    """A scene in code units, of 64 gas particles in 1D and 400 in 2D."""
    gas = {"particles": 64 if dimensions == 1 else 400, "eos": ISOTHERMAL} | (gas or {})
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0} | tables.pop("run", {}),
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": boundary} | tables.pop("space", {}),
        "initial": initial,
        "gas": gas,
        **tables,
    }


def disc(**more):
    start = {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0}
    whole = scene(start, {"eos": LOCALLY}, 2, "open", star={"mass": 1.0}, space={"size": 6.0, "cells": 32})
    return whole | more


def choices(model, key):
    return fields.choices_in(model.model_fields[key].annotation)


def kinds(annotation):
    return {model.model_fields["kind"].default for model in fields.models_in(annotation)}


def moving(sim):
    """The particles of each species that move: mass (n,), pos and vel (n, d); and what one-way gas carries of dust."""
    for p in sim.state.species.values():
        free = slice(None) if p.immobile is None else ~p.immobile
        yield p.mass[free], p.pos[free], p.vel[free]
    gas = sim.gas
    if gas is not None and gas.small is not None and sim.scene.drag.direction == "one-way":
        yield gas.small, gas.pos, gas.vel  # beside its mass, as it must not notice


def totals(sim):
    """Mass, momentum and (2D) angular momentum of gas and dust, with what the star and companions have taken."""
    ledger, found = sim.state.ledger, {"mass": 0.0, "momentum": 0.0, "spin": 0.0, "size": 0.0}
    found["mass"] += ledger.accreted_gas + ledger.accreted_dust + ledger.accreted_small + ledger.damped_gas
    found["spin"] += ledger.accreted_angular_momentum
    if sim.bodies is not None:
        found["mass"] += sim.bodies.accreted[1:].sum()  # the star's is in the ledger
    for mass, pos, vel in moving(sim):
        found["mass"] += mass.sum()
        found["momentum"] += mass @ vel
        found["size"] += mass @ np.abs(vel).sum(axis=1)
        if vel.shape[1] == 2:
            found["spin"] += mass @ (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])
    return found


def momentum(sim):
    """Momentum of gas and dust whose sum is not rounded: a step far beyond its limit makes velocities of 1000."""
    products = np.concatenate([mass[:, None] * vel for mass, _, vel in moving(sim)])
    return np.array([math.fsum(column) for column in products.T])


def assert_sane(sim):
    for p in sim.state.species.values():
        for name, array in p.arrays().items():
            assert np.isfinite(array).all(), name
    if sim.gas is not None:
        assert (sim.gas.density > 0).all() and (sim.gas.h > 0).all()
    assert sim.time > 0
