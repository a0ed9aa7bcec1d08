"""Discs that turn clockwise, or both ways: drag in cells takes velocities relative to orbits in their own sense."""

from types import SimpleNamespace

import numpy as np
import pytest

from discsim import Simulation
from discsim.drag import frame
from discsim.kernels.drag.frame import Frame, rotation_sign

SOUND = 0.08


def tables(scheme, **start):
    return {
        "units": {"system": "code"},
        "run": {"until": 0.4, "timestep": 0.04},
        "space": {"size": 4.0, "cells": 128},
        "gas": {
            "particles": 2000,
            "eos": {"kind": "isothermal", "sound_speed": SOUND},
            "viscosity": {"alpha": 0.3, "beta": 0.5, "pairs": "all"},
        },
        "dust": {"particles": 2000, "ratio": 1.0},
        "star": {"mass": 1.0, "accretion_radius": 0.3},
        "drag": {"law": "stokes-number", "stokes": 0.1, "scheme": scheme},
    } | start


def particles(scheme):
    """Gas and dust that turn counter-clockwise, from .7 to 1.4."""
    tapers = {"inner_taper": 0.1, "outer_taper": 0.1}
    disc = {"kind": "disc", "mass": 0.01, "inner": 0.7, "outer": 1.4} | tapers
    sim = Simulation(tables(scheme, initial=disc))
    return {name: {"pos": p.pos, "vel": p.vel, "mass": p.mass} for name, p in sim.state.species.items()}


def turned(given, changed, which=lambda r: r > 0):
    """The same with the velocities of some multiplied by `changed`."""
    out = {}
    for name, p in given.items():
        some = which(np.sqrt((p["pos"] ** 2).sum(axis=1)))[:, None]
        out[name] = p | {"vel": np.where(some, p["vel"] * changed, p["vel"])}
    return out


def run(scheme, given):
    """By species positions and velocities (n, 2) in the order of ids."""
    sim = Simulation(tables(scheme), particles=given)
    sim.run()
    orders = {name: np.argsort(p.ids) for name, p in sim.state.species.items()}
    return {name: (p.pos[orders[name]], p.vel[orders[name]]) for name, p in sim.state.species.items()}


def noise(state, low, high):
    """Scatter of the radial velocity between two radii, gas and dust together."""
    found = []
    for pos, vel in state.values():
        r = np.sqrt((pos**2).sum(axis=1))
        radial = (pos * vel).sum(axis=1) / r
        found.append(radial[(r > low) & (r < high)].std())
    return np.hypot(*found)


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_a_mirrored_disc_stays_the_mirror_image(scheme):
    given, mirror = particles(scheme), np.array([1.0, -1.0])
    image = {name: p | {"pos": p["pos"] * mirror, "vel": p["vel"] * mirror} for name, p in given.items()}
    plain, mirrored = run(scheme, given), run(scheme, image)
    for name, (_, vel) in plain.items():
        # Sums in another order, and ten steps.
        np.testing.assert_allclose(mirrored[name][1] * mirror, vel, rtol=0, atol=1e-12 * SOUND)


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_a_disc_is_as_quiet_whichever_way_it_turns(scheme):
    """The same places with all velocities reversed; then two rings of which the outer one alone is reversed."""
    given = particles(scheme)
    plain, backwards = run(scheme, given), run(scheme, turned(given, -1.0))
    assert noise(backwards, 0.8, 1.3) < 1.5 * noise(plain, 0.8, 1.3)
    rings = {}
    for name, p in given.items():
        r = np.sqrt((p["pos"] ** 2).sum(axis=1))
        rings[name] = {key: value[abs(r - 1.05) > 0.15] for key, value in p.items()}
    alike, against = run(scheme, rings), run(scheme, turned(rings, -1.0, lambda r: r > 1.05))
    for low, high in ((0.75, 0.9), (1.2, 1.35)):
        assert noise(against, low, high) < 1.5 * noise(alike, low, high)


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_gas_and_dust_that_turn_against_each_other_only_slow_down(scheme):
    """They come to rest together, and what they lose is gone: no velocity grows."""
    given = particles(scheme)
    against = given | {"dust": turned(given, -1.0)["dust"]}
    energy = {}
    for name, state in (
        ("start", {k: (p["pos"], p["vel"]) for k, p in against.items()}),
        ("end", run(scheme, against)),
    ):
        energy[name] = sum((vel**2).sum() for _, vel in state.values())
        fastest = max(np.sqrt((vel**2).sum(axis=1)).max() for _, vel in state.values())
        assert fastest < 1.5
    assert energy["end"] < 0.5 * energy["start"]


def test_orbits_have_the_sense_of_a_ring_in_its_middle():
    """In ln r^2, linear between the middles of rings, and beyond the first and the last middle what it is there."""
    sense = np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    about = Frame(0.7, 0.1, np.log(0.3**2), 2.5, sense)
    middles = 0.3**2 * np.exp((np.arange(5) + 0.5) / 2.5)  # to rounding of logarithms
    assert [rotation_sign.py_func(r2, about) for r2 in middles] == pytest.approx(sense, abs=1e-12)
    quarter = middles[:-1] * np.exp(0.25 / 2.5)
    wanted = 0.75 * sense[:-1] + 0.25 * sense[1:]
    assert [rotation_sign.py_func(r2, about) for r2 in quarter] == pytest.approx(wanted, abs=1e-12)
    assert [rotation_sign.py_func(r2, about) for r2 in (0.01, 99.0)] == [1.0, -1.0]


def test_the_frame_finds_whom_it_looks_at_where_others_come_and_go(monkeypatch):
    """On ranks: in rows noted as loose and at the end; all over again once all are sorted, or in other memory."""
    rng, searches, search = np.random.default_rng(4), [], frame.multiples_of
    monkeypatch.setattr(frame, "SAMPLE", 16)
    monkeypatch.setattr(frame, "multiples_of", lambda *given: searches.append(given) or search(*given))
    monkeypatch.setattr(frame.world, "processes", SimpleNamespace(is_parallel=True))
    whole, samples = rng.permutation(1000), {}
    ids, loose = whole[:400], np.empty(0, np.int64)
    for step in range(30):
        if step in (10, 20):  # sorted; or in other memory, without having lost their rows
            whole = np.sort(whole) if step == 10 else whole.copy()
            loose = loose[:0] if step == 10 else loose
        else:
            left = len(ids) + (rng.integers(-20, 30) if step > 0 else 0)
            rows = rng.choice(400, 9)
            others = rng.choice(400, 9) % left
            whole[rows % left], whole[others] = whole[others], whole[rows % left].copy()
            loose = np.concatenate([loose, others, rows % left, np.arange(min(left, len(ids)), 700)])
            ids = whole[:left]
        ids = whole[: len(ids)]
        found = frame._sampled_rows(samples, "dust", SimpleNamespace(ids=ids, global_count=1000, unsorted_rows=loose))
        assert found.tolist() == search(ids, 64).tolist() and len(found) > 0
    assert len(searches) == 3


def test_the_frame_looks_at_the_same_particles_wherever_they_are(monkeypatch):
    """What it has noted of rows goes when they are sorted, or some that it looks at are gone; not where others are."""
    monkeypatch.setattr(frame, "SAMPLE", 100)
    searches, search = [], frame.multiples_of
    monkeypatch.setattr(frame, "multiples_of", lambda *given: searches.append(given) or search(*given))
    disc, star = {"kind": "disc", "mass": 0.01, "inner": 0.7, "outer": 1.4}, {"mass": 1.0, "accretion_radius": 0.75}
    sim = Simulation(tables("tsc", initial=disc, star=star))
    first = sim.dust.ids[:20].tolist()
    for _ in range(18):  # sorted after the 1st and the 17th
        sim.step()
        for name, p in sim.state.species.items():
            _, power, rows, _ = sim.effects["drag"].engine.samples[name]
            every = 1 << max(0, -(-p.count // 100) - 1).bit_length()
            assert power == every and p.ids[rows].tolist() == p.ids[p.ids % every == 0].tolist()
    assert sim.dust.count < 2000 and sim.dust.ids[:20].tolist() != first
    for looked_at in (False, True):
        before, seen = len(searches), sim.dust.ids % sim.effects["drag"].engine.samples["dust"][1] == 0
        sim.dust.remove(np.flatnonzero(seen[:-1] == looked_at)[:1])
        sim.step()
        assert len(searches) - before == looked_at
