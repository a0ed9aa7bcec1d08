"""What `discsim check` foretells is what a run of the scene has: grid, drag cells, masses, Omega, Stokes numbers, Q."""

import numpy as np
import pytest

from discsim import Simulation
from discsim.drag import cells, nodes
from discsim.kernels.drag import blocks
from discsim.numerics.layout import LEVELS
from discsim.preview.check import report
from discsim.preview.derived import derived_rows
from discsim.scene import load_scene

DISC = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 8.0},
    "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 3.0},
    "gas": {"particles": 5000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": {"particles": 9000, "ratio": 0.01},
    "star": {"mass": 1.0},
    "drag": {"law": "stopping-time", "t_stop": 0.1},
}
BOX = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "box"},
    "gas": {"particles": 1000, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    "dust": {"particles": 2000, "ratio": 1.0},
    "drag": {"law": "stopping-time", "t_stop": 0.1},
}
TUBE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"dimensions": 1, "size": 1.0},
    "initial": {"kind": "shock"},
    "gas": {"particles": 300, "smoothing_length": 0.017, "eos": {"kind": "adiabatic", "gamma": 1.4}},
    "dust": {"particles": 300, "ratio": 1.0},
    "drag": {"law": "constant", "K": 10.0},
}


def with_keys(tables, **changes):
    """The tables with more keys in some of them."""
    return tables | {name: tables.get(name, {}) | keys for name, keys in changes.items()}


def rows_of(tables):
    return dict(derived_rows(load_scene(tables)))


def numbers(text):
    return [float(word) for word in text.split(", ")]


@pytest.fixture
def sorted_blocks(monkeypatch):
    """The blocks that the drag of a Simulation sorts its particles into, of its first kick."""

    def first_blocks(sim):
        found = []
        sort = cells.sort_into_blocks
        for module in (cells, nodes):
            monkeypatch.setattr(module, "sort_into_blocks", lambda *a, **k: found.append(sort(*a, **k)) or found[-1])
        sim.step()
        return found[0]

    return first_blocks


def particles_in_blocks(sim, found, where):
    """Median side of the blocks `where` (mask of (n, 2) centres), and mean numbers of gas and dust in those."""
    corners, sides = found.squares()
    full = where(corners + 0.5 * sides[:, None])
    side = np.median(sides[full])
    full &= sides == side
    populations = sim.effects["drag"].law.populations
    gas, dust = np.diff(found.gas_start)[:-2], np.diff(found.dust_start[::populations])[:-2]
    return side, gas[full].mean(), dust[full].mean()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"drag": {"cell": 3.2}},
        {"drag": {"scheme": "idic"}},
        {"drag": {"scheme": "idic-linear", "cell": 3.0}},
        {"drag": {"cell_length": 1.4 * 8 / 64}},
        {"drag": {"scheme": "idic", "cell_length": 1.4 * 8 / 64}},
        {"space": {"cells": 300}},
        {"space": {"cells": 100}, "gas": {"particles": 1200}},
    ],
)
def test_drag_cells_of_a_disc(changes, sorted_blocks):
    tables = with_keys(DISC, **changes)
    rows, sim = rows_of(tables), Simulation(load_scene(tables))
    blocks = sorted_blocks(sim)
    near = lambda centre: np.abs(np.hypot(centre[:, 0], centre[:, 1]) - 2.0) < 0.15  # noqa: E731
    side, gas, dust = particles_in_blocks(sim, blocks, near)
    assert numbers(rows["side of a drag cell"])[1] == pytest.approx(side, rel=1e-3)  # four digits are shown
    # Means of a hundred cells and more in a ring about the place, which the disc's slope leaves even.
    assert numbers(rows["gas particles in a drag cell"])[1] == pytest.approx(gas, rel=0.1)
    assert numbers(rows["dust particles in a drag cell"])[1] == pytest.approx(dust, rel=0.1)


@pytest.mark.parametrize(
    "tables, sides",
    [
        (with_keys(TUBE, drag={"scheme": "idic"}), 2),
        (TUBE, 2),
        # Grows for want of particles on the left; on the right there is none in most cells.
        (with_keys(TUBE, gas={"smoothing_length": 0.005}, drag={"scheme": "idic"}), 1),
    ],
)
def test_drag_cells_of_a_tube(tables, sides, sorted_blocks):
    rows, sim = rows_of(tables), Simulation(load_scene(tables))
    blocks = sorted_blocks(sim)
    for number, (left, right) in enumerate([(-0.4, -0.1), (0.1, 0.4)][:sides]):
        side, gas, dust = particles_in_blocks(sim, blocks, lambda x: (x[:, 0] > left) & (x[:, 0] < right))  # noqa: B023
        assert numbers(rows["side of a drag cell"])[number] == pytest.approx(side, rel=1e-3)
        # Some ten cells, whose ends round by one of the particles in all.
        assert numbers(rows["gas particles in a drag cell"])[number] == pytest.approx(gas, rel=0.15)
        assert numbers(rows["dust particles in a drag cell"])[number] == pytest.approx(dust, rel=0.15)


@pytest.mark.parametrize(
    "tables",
    [
        DISC,
        BOX,
        with_keys(BOX, space={"size": [1.0, 0.5], "cells": 32}),
        with_keys(DISC, space={"size": [8.0, 7.0], "cells": 50}, self_gravity={"softening": 0.1}),
        {name: keys for name, keys in DISC.items() if name != "drag"} | {"space": {"size": 8.0, "cells": 50}},
    ],
)
def test_grid(tables):
    grid, rows = Simulation(load_scene(tables)).state.grid, rows_of(tables)
    if grid is None:
        assert "grid" not in rows and "memory of the grid, estimated" not in rows
    else:
        assert rows["grid"] == f"{grid.shape[0]} x {grid.shape[1]} cells of {grid.cell:.4g}"


def test_masses_are_those_of_the_particles_that_there_are():
    """1000 particles in a square are 32 x 31 of them, 2000 are 45 x 44."""
    sim, rows = Simulation(load_scene(BOX)), rows_of(BOX)
    assert (sim.gas.count, sim.dust.count) == (992, 1980)
    assert numbers(rows["particle mass of gas"]) == pytest.approx([sim.gas.mass[0]], rel=1e-3)
    assert numbers(rows["particle mass of dust"]) == pytest.approx([sim.dust.mass[0]], rel=1e-3)
    # h of an even lattice under the cubic kernel is right to some per cent, against .8% of the number's own rounding.
    sim.step()
    assert numbers(rows["smoothing length h"])[0] == pytest.approx(sim.gas.h.mean(), rel=4e-3)


SOFT = {"star": {"softening": 0.8}}
GRAINS = {"dust": {"grain_size": 1e-4, "grain_density": 30.0}}
ADIABATIC = {"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.05}}}


@pytest.mark.parametrize(
    "changes",
    [
        SOFT,
        SOFT | {"drag": {"law": "stokes-number", "stokes": 0.3, "t_stop": None}},
        GRAINS | SOFT | {"drag": {"law": "epstein", "t_stop": None}},
        GRAINS | ADIABATIC | {"drag": {"law": "epstein", "t_stop": None, "convention": "kinetic"}},
        # Between Epstein's law and Stokes', where the gas's volume density, so its H, counts.
        GRAINS | ADIABATIC | {"drag": {"law": "epstein-stokes", "t_stop": None, "mean_free_column": 2e-6}},
    ],
)
def test_stokes_numbers_of_the_first_snapshot(changes):
    tables = with_keys(DISC, **changes)
    sim = Simulation(load_scene(tables))
    with sim.synchronised() as state:
        stokes = sim.effects["drag"].columns(state)["dust"]["stokes"]
    r = np.hypot(*sim.dust.pos.T)
    near = np.abs(r - 2.0) < 0.15
    expected = np.polyval(np.polyfit(r[near] - 2.0, stokes[near], 1), 0.0)
    # Of some thousand grains, where the density of the gas about them is that of its cell: noise of a per cent.
    assert numbers(rows_of(tables)["Stokes number"])[1] == pytest.approx(expected, rel=0.02)


def test_omega_is_that_of_the_softened_star():
    tables = with_keys(DISC, **SOFT)
    period = numbers(rows_of(tables)["orbital period"])
    exact = 2 * np.pi * (np.array([1.0, 2.0, 3.0]) ** 2 + 0.8**2) ** 0.75
    assert period == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("given", [{"sound_speed": 0.05}, {"aspect_ratio": 0.05}])
def test_toomre_q_of_adiabatic_gas_has_the_adiabatic_sound_speed(given):
    """Q asked is Q shown, and that of the gas made: 2 at its least."""
    tables = with_keys(DISC, gas={"eos": {"kind": "adiabatic", "gamma": 5 / 3} | given})
    tables = tables | {"initial": {"kind": "disc", "toomre_q": 2.0, "inner": 1.0, "outer": 3.0}}
    rows = rows_of(tables)
    assert min(numbers(rows["Toomre Q"])) == pytest.approx(2.0, rel=1e-3)
    sim = Simulation(load_scene(tables))
    sim.step(1e-9)
    r = np.hypot(*sim.gas.pos.T)
    near = np.abs(r - 2.0) < 0.05
    assert numbers(rows["sound speed"])[1] == pytest.approx(sim.gas.sound_speed[near].mean(), rel=5e-3)
    q = sim.gas.sound_speed * r**-1.5 / (np.pi * sim.gas.density)
    assert numbers(rows["Toomre Q"])[1] == pytest.approx(q[near].mean(), rel=0.02)  # the kernel's sums, on rings


def test_dust_is_counted_where_it_is():
    tables = DISC | {"dust": {"particles": 3000, "ratio": 0.5, "inner": 1.5, "outer": 2.5}}
    count = numbers(rows_of(tables)["dust particles in a drag cell"])
    assert count[0] == count[2] == 0.0 and count[1] > 1.0
    assert "dust particles in a drag cell" not in report(load_scene(tables)).partition("warnings")[2]


def test_levels_are_those_of_the_kernels():
    assert LEVELS == blocks.LEVELS
