"""Physics at full size, minutes to an hour each: `pytest -m slow`."""

from importlib import import_module as script
from itertools import pairwise

import numpy as np
import pytest
from problems import blast, fall, vortex
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.study.errors import measure_of

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("sound_speed, exact, until", [(0.5, 4.9947, 0.7), (1.2, 4.6939, 2.6)])
def test_jeans_sheet(sound_speed, exact, until):
    """omega^2 = c_s^2 k^2 - 2 pi Sigma k exp(-k eps), on 128^2 particles and cells, over two periods where it swings.

    1%: the lattice's c_s^2 is .4% off under the quintic kernel, and 57 of the 22 in omega^2 are c_s^2 k^2.
    """
    size = ["gas.particles=16384", "space.cells=128", f"gas.eos.sound_speed={sound_speed}"]
    sim = Simulation(load_scene("setups/sheet.toml", size))
    times = np.linspace(0.0, until, 60)[1:]
    amplitude = []
    for time in times:
        sim.run(time)
        amplitude.append(2.0 * np.exp(-2j * np.pi * sim.gas.pos[:, 0]).mean())
    amplitude = np.abs(np.array(amplitude)) if sound_speed < 1 else np.array(amplitude).imag
    trial = exact * np.linspace(0.97, 1.03, 601)
    shape = np.cosh if sound_speed < 1 else np.cos
    shapes = shape(np.outer(trial, times))
    projection = (shapes @ amplitude) ** 2 / (shapes**2).sum(axis=1)
    assert trial[np.argmax(projection)] == pytest.approx(exact, rel=0.01)


def test_disc_keeps_its_mass_and_angular_momentum():
    """The main job with a tenth of the particles: what is left and accretion by the star close."""
    small = ["gas.particles=10000", "dust.particles=20000", "space.cells=128", 'run.until="300 yr"']
    sim = Simulation(load_scene("setups/dusty_disc.toml", small))

    def totals():
        both = (sim.gas, sim.dust)
        mass = sum(p.mass.sum() for p in both)
        spin = sum((p.mass * (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0])).sum() for p in both)
        return mass, spin

    mass, spin = totals()
    sim.run()
    ledger = sim.state.ledger
    left, turning = totals()
    assert ledger.accreted_gas > 0.0
    assert left + ledger.accreted_gas + ledger.accreted_dust == pytest.approx(mass, rel=1e-12)
    # Star and self-gravity are central or antisymmetric but for the grid, pressure exactly so; drag cells lose what
    # their centroids' offsets carry. Seen: 4e-7 of the total.
    assert turning + ledger.accreted_angular_momentum == pytest.approx(spin, rel=1e-5)


@pytest.mark.parametrize(
    "ratio, stokes, limit", [(0.01, 0.1, 0.05), (0.01, 0.01, 0.05), (1.0, 0.1, 0.1), (1.0, 0.01, 0.1)]
)
def test_dust_drifts_as_it_must(ratio, stokes, limit):
    """`analysis/drift.py`: two seeds, orbits 2 to 12, 1e5 particles of gas and of dust."""
    module = script("drift")
    rows = []
    for seed in (1, 2):
        sim = module.ring(ratio, stokes, "tsc", seed, 100_000, 100_000, module.GAS)
        found = module.measure(sim, (2.0, 12.0), lambda share: None)
        rows.append(module.summary(found, {"series": {"gas": [0.0]}}, ratio, stokes))
        # Drag loses less than 1e-6 of the angular momentum in 8 of the 75/Omega.
        assert abs(rows[-1]["spin"]) < 1e-6 * 75 / 8
    assert np.hypot(*(row["error"] for row in rows)) / 2 < 0.02
    assert np.mean([row["relative"] for row in rows]) == pytest.approx(1.0, abs=limit)


def test_gas_alone_keeps_its_disc():
    """`analysis/noise.py`, the choice with the least viscosity, 20 orbits at h/H = .25."""
    module = script("noise")
    gas = module.CHOICES["wendland-c4, eta 2.5, low"]
    found = module.measure_disc(gas, 0.25, 20.0, lambda share: None)
    assert found["sigma"] < 0.03
    assert abs(found["alpha_flux"]) < 0.005 and module.measure_shear(gas, 0.25) < 0.005
    assert abs(found["spin"]) < 1e-8


@pytest.mark.parametrize("orbits", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0])
def test_grains_settle(orbits):
    """400 particles of each over half an orbit: every grain within 1% of the way that it falls, or swings."""
    way, _, terminal = fall(2 * np.pi * orbits, np.pi, particles=400)
    assert way.max() < 0.01  # .007 seen, at the ends, where a cell is a fifth of the height
    if orbits <= 1e-4:
        assert np.quantile(np.abs(terminal - 1.0), 0.9) < 0.01


def test_sedov_at_1e5():
    (radius,), lost = blast(100_000)
    assert radius == pytest.approx(1.0, abs=0.02)
    assert abs(lost) < 0.002


def test_dusty_sedov_at_1e5():
    """1e5 particles of each in cold gas: .5% seen."""
    radii, lost = blast(100_000, 1.0, stop=1e-4)
    assert radii == pytest.approx([1.0, 1.0], abs=0.03)
    assert abs(lost) < 1e-12


def test_gresho_at_100_squared():
    assert vortex(10_000) < 0.05


def test_published_tables():
    """`analysis/paper_tables.py`: shocks within 15% at h = .025 (MK at .01 too), waves within 6%, IDIC within 30%.

    But for shocks in cells of two particles, and for waves at K = .005 and h = .01, of which print has more.
    """
    module = script("paper_tables")
    for row in module.table_1() + module.table_2() + module.table_3():
        found, _ = module.errors_of(row)
        if (row.table, row.scheme, row.h) == (2, "idic", 0.01):
            continue
        if (row.table, row.coefficient, row.h) == (1, 0.005, 0.01):
            assert 0.4 < found / row.printed < 0.8
        else:
            assert module.verdict(row, found).startswith("yes"), (row, found)


def test_a_ring_spreads_as_lynden_bell_and_pringle_have_it():
    """alpha = .05 and H/r = .05 from tau = .016 to .3, 20,000 particles: the mass in other rings than the exact one's.

    .040, .032, .031, .032 and .036 were seen. By the equation of a viscous disc with pressure and an end at the star's
    accretion radius of .1 it is .023, .018, .015, .014 and .014, nearly all of it pressure's, which the exact ring has
    not; to .2 the end would take .011 more. The rest is noise where the ring is thin: the kernel is the quietest.
    """
    scene = {
        "units": {"system": "code"}, "run": {"until": 200.0, "courant": 0.5}, "space": {"size": 5.0},
        "initial": {"kind": "viscous-ring", "radius": 1.0, "mass": 1e-6},
        "gas": {
            "particles": 20_000, "kernel": "wendland-c4", "eta": 2.2,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05, "temperature_index": 1.0},
        },
        "star": {"mass": 1.0, "accretion_radius": 0.1}, "alpha_viscosity": {"alpha": 0.05, "index": -0.5},
    }  # fmt: skip
    sim = Simulation(scene)
    for tau in (0.1, 0.15, 0.2, 0.25, 0.3):
        sim.run((tau - 0.016) / (12.0 * 0.05 * 0.05**2))
        assert measure_of(sim.scene).errors(sim)["gas"] < 0.05


def test_a_steady_disc_carries_one_rate():
    """alpha = .1 and H/r = .1, fed and drained by zones: rates through five annuli of the middle half, orbits 3 to 20.

    What has crossed a radius, meant over each annulus; .93, .89, .87, .91 and .95 of the rate of the start were seen,
    5% about their mean. The zone has to be short: in one of rate R a flow is what is asked for but for 1 in
    (R / Omega)^2, and an edge out of balance moves by 1 / R of that.
    """
    rate = 1e-9
    scene = {
        "units": {"system": "code"}, "run": {"until": 1e3, "courant": 0.5}, "space": {"size": 7.2},
        "initial": {"kind": "steady", "accretion_rate": rate, "inner": 0.4, "outer": 3.0, "inner_taper": 0.1,
                    "outer_taper": 0.3},
        "gas": {
            "particles": 10_000, "kernel": "wendland-c4", "eta": 2.5,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 1.0},
        },
        "star": {"mass": 1.0, "accretion_radius": 0.24}, "alpha_viscosity": {"alpha": 0.1},
        "damping": {"inner": [0.4, 0.8], "outer": [2.2, 3.0], "time": 5e-4},
    }  # fmt: skip
    sim = Simulation(scene)
    edges = np.linspace(1.05, 2.35, 6)
    orbits = np.arange(3.0, 20.1, 0.5)
    within = []
    for orbit in orbits:
        sim.run(2.0 * np.pi * orbit)
        r = np.sqrt((sim.gas.pos**2).sum(axis=1))
        shares = [np.clip((outer - r) / (outer - inner), 0.0, 1.0) for inner, outer in pairwise(edges)]
        within.append([sim.state.ledger.accreted_gas + sim.gas.mass @ share for share in shares])
    rates = np.polyfit(2.0 * np.pi * orbits, np.array(within) / rate, 1)[0]
    np.testing.assert_allclose(rates / rates.mean(), 1.0, atol=0.1)
    assert rates.mean() == pytest.approx(1.0, abs=0.15)


def test_planet_opens_a_gap_and_traps_dust(tmp_path):
    """planet_dust with a third of its gas, 15 orbits: dust leaves the gap faster than gas, for the top of the pressure.

    5% of its place is what the setup is to hold; a ring of the profile is .9% of its radius.
    """
    few = ["gas.particles=20000", "dust.particles=10000", "run.until=94.25", "run.snapshots=15"]
    changes = [word for change in few for word in ("--set", change)]
    run = tmp_path / "run"
    done = CliRunner().invoke(app, ["run", "setups/planet_dust.toml", "-o", str(run), "--quiet", *changes])
    assert done.exit_code == 0
    gap = script("gap").Gap(run, 5.0)
    assert gap.summit(gap.profiles["dust.0"]) == pytest.approx(gap.summit(gap.pressure), rel=0.05)
    assert gap.theory < gap.depth("gas") < 0.8  # still opening, in noise that keeps it shallow
    assert gap.depth("dust.0") < 0.5 * gap.depth("gas")
    depths = [depth for _, depth in gap.history()]
    assert depths == sorted(depths, reverse=True)


def test_a_dead_zone_of_quiet_gas_stays_circular():
    """Slow eccentric modes of a disc are stable (Tremaine 2001, AJ 121, 1776).

    With a pressure that lags behind the mass e was .01 by now, a factor of e more every 300 years. The noise of the
    particles makes 2e-4.
    """
    size = ["gas.particles=20000", 'run.until="2000 yr"']
    sim = Simulation(load_scene("setups/dead_zone_sph.toml", size, without=["dust", "drag", "growth"]))
    sim.run()
    gas = sim.gas
    r = np.hypot(*gas.pos.T)
    radial, direction = (gas.pos * gas.vel).sum(axis=1) / r, (gas.pos[:, 0] + 1j * gas.pos[:, 1]) / r
    inside = (r > 7.0) & (r < 18.0)  # au
    assert 2.0 * abs((radial * direction * np.sqrt(r / 0.8))[inside].mean()) < 1e-3
