"""Scenes of runs that several tests make, and what a run leaves."""

import csv
import os
import subprocess
import sys

import numpy as np

from discsim import Simulation, read_snapshot
from discsim.effects.base import kick_effect_name
from discsim.numerics import thread_pool, threads
from discsim.output.checkpoint import read_checkpoint
from discsim.output.open_step import open_step_of
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

DISC = """\
title = "a disc with everything"
units.system = "code"
[run]
until = 2.5
every = 0.25
[space]
size = 6
cells = 64
[initial]
kind = "disc"
mass = 0.05
inner = 0.5
outer = 2
[gas]
particles = 1000
eos = {kind = "locally-isothermal", aspect_ratio = 0.1, reference_radius = 1}
viscosity = {alpha = 1.0}
[dust]
particles = 1100
ratio = 0.1
[star]
mass = 1
accretion_radius = 0.55
[self_gravity]
softening = 0.1
[drag]
law = "stokes-number"
stokes = 0.1
"""


RINGS = """\
title = "gas on a polar grid, and dust"
units.system = "code"
run = {until = 2.5, every = 0.25}
space = {size = 6.0, cells = 64}
initial = {kind = "disc", surface_density = 1e-2, inner = 0.5, outer = 2.0, surface_density_index = 0.7}
star.mass = 1.3
gas = {method = "grid", particles = 4000, eos = {kind = "locally-isothermal", aspect_ratio = 0.07}}
dust = {particles = 2000, ratio = 0.3}
drag = {law = "stokes-number", stokes = 0.1}
"""


# Settings of RINGS with effects that need the gas around grains, and a companion that takes gas from cells.
GROWING_RINGS = [
    "dust.grain_size=1e-6", "dust.grain_density=1.0", 'drag={law = "epstein"}', "dust_diffusion.alpha=0.02",
    "growth={fragmentation_speed = 0.1, alpha = 1e-3, small_size = 1e-9}",
    'companion=[{mass = 3e-3, semi_major_axis = 1.1, softening = 0.05, orbit = "live", accretion_radius = 0.1}]',
]  # fmt: skip


SHOCK = """\
units.system = "code"
[run]
until = 0.1
snapshots = 4
[space]
dimensions = 1
size = 1
[initial]
kind = "shock"
right = [0.55, 0.4, 0]
[gas]
particles = 200
eos = {kind = "adiabatic", gamma = 1.4}
viscosity = {alpha = 1.0}
conductivity = {alpha = 1.0}
"""


WAVE = """\
units.system = "code"
[run]
until = 0.1
snapshots = 2
[space]
dimensions = 1
size = 1
boundary = "periodic"
[initial]
kind = "wave"
[gas]
particles = 100
smoothing_length = 0.025
eos = {kind = "isothermal", sound_speed = 1}
[dust]
particles = 100
ratio = 1
[drag]
law = "stopping-time"
t_stop = 0.002
"""


def scene_of(tmp_path, text, *overrides, without=()):
    path = tmp_path / "a.toml"
    path.write_text(text)
    return load_scene(path, overrides, without)


def errors_of(text):
    """The lines on standard error of a quiet run, without the warnings of its scene."""
    return [line for line in text.splitlines() if not line.startswith("warning: ")]


def rows(directory, name="history.csv"):
    with (directory / name).open(newline="") as file:
        return list(csv.DictReader(file))


def assert_same_run(one, other):
    """Every snapshot and every row to the last bit (rows hold floats with all their digits)."""
    names = sorted(path.name for path in (one / "snapshots").glob("*.h5"))
    assert names == sorted(path.name for path in (other / "snapshots").glob("*.h5"))
    for name in names:
        a, b = (read_snapshot(directory / "snapshots" / name) for directory in (one, other))
        assert a.time == b.time
        for kind in a.species:
            assert_same_arrays(vars(a.species[kind]), vars(b.species[kind]))
    assert (one / "history.csv").read_text() == (other / "history.csv").read_text()


def assert_same_files(one, other):
    """Snapshots, rows, and the state that the runs could go on from; seconds of CPU differ."""
    assert_same_run(one, other)
    groups, values = read_checkpoint(one / "checkpoint.h5")
    found, found_values = read_checkpoint(other / "checkpoint.h5")
    assert values == found_values
    for group in set(groups) - {"costs"}:
        assert {name: a.tobytes() for name, a in groups[group].items()} == {
            name: a.tobytes() for name, a in found[group].items()
        }
    assert sorted(os.listdir(one)) == sorted(os.listdir(other))


def assert_same_arrays(one, other):
    for name, array in one.items():
        if isinstance(array, np.ndarray):
            assert array.tobytes() == other[name].tobytes(), name


def assert_same_content(one, other, but=("parts", "made")):
    """All that HDF5 itself finds in two files or groups, as other readers do, but for some names."""
    assert {*one.attrs} - {*but} == {*other.attrs} - {*but}
    for name in {*one.attrs} - {*but}:
        assert np.array_equal(one.attrs[name], other.attrs[name]), name
    if hasattr(one, "dtype"):
        assert one.dtype == other.dtype and one[()].tobytes() == other[()].tobytes(), one.name
        return
    assert {*one} == {*other}
    for name in {*one} - {*but}:
        assert_same_content(one[name], other[name], but)


def state_bits(sim):
    return {name: {k: v.tobytes() for k, v in p.arrays().items()} for name, p in sim.state.species.items()}


def assert_resumes(scene, path, half, end):
    """From a checkpoint at `path` of the time `half` it goes on to `end` with the bits of a straight run; that run."""
    straight, resumed = Simulation(scene), Simulation(scene)
    straight.evolve(half)
    straight.save(path)
    straight.evolve(end)
    resumed.restore(path)
    assert resumed.time == half
    resumed.evolve(end)
    assert state_bits(straight) == state_bits(resumed)
    for one, other in ((straight.state.ledger, resumed.state.ledger), (straight.bodies, resumed.bodies)):
        if one is not None:
            assert_same_arrays({k: np.atleast_1d(v) for k, v in vars(one).items()},
                               {k: np.atleast_1d(v) for k, v in vars(other).items()})  # fmt: skip
    return straight


def at_step(monkeypatch, step, act):
    """Have `act(sim)` done at the end of the given step of any run."""
    advance = Simulation._advance

    def advance_and_act(sim, *arguments):
        advance(sim, *arguments)
        if sim.state.step == step:
            act(sim)

    monkeypatch.setattr(Simulation, "_advance", advance_and_act)


BITS = """
import hashlib, sys
from discsim import Simulation, load_scene
for given in sys.argv[1:]:
    path, threads = given.rsplit("@")
    sim = Simulation(load_scene(path, [f"run.threads={threads}"]))
    for _ in range(3):
        sim.step()
    bits = hashlib.sha256()
    for particles in sim.state.species.values():
        for array in particles.arrays().values():
            bits.update(array.tobytes())
    print(given, bits.hexdigest(), sep="=")
"""


def bits_of(given, **environment):
    """What a process finds in the end for each "path@threads"."""
    done = subprocess.run(
        [sys.executable, "-c", BITS, *given], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    return dict(line.split("=") for line in done.stdout.splitlines())


def contents(directory):
    return {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def put_out(sim, path):
    """The snapshot that a run writes of a simulation between two steps."""
    step = open_step_of(sim.state, kick_effect_name(sim.effects) is not None)
    with sim.synchronised() as state:
        write_snapshot(path, sim.scene, state.time, state.gas, state.dust, {}, state.bodies, step)


def on_threads(monkeypatch, numbers=(1, 3), least=50):
    """Numbers of threads, each in force while it is there; loops over `least` particles are divided already."""
    chunks = threads.chunks
    monkeypatch.setattr(threads, "chunks", lambda count, own, number: chunks(count, min(own, least), number))
    for number in numbers:
        monkeypatch.setattr(thread_pool, "number_of_threads", lambda number=number: number)
        yield number
