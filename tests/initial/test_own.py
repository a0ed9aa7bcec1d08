"""Own particles are taken as they are meant, or refused with the array, the shape wanted and the first wrong entry."""

import numpy as np
import pytest
from astropy import units as u

from discsim import SceneError, Simulation

N = 64


def scene(dim=2, boundary="periodic", eos=None, dust=1, **tables):
    eos = eos or {"kind": "isothermal", "sound_speed": 1.0}
    out = {
        "units": {"system": "code"}, "run": {"until": 1.0},
        "space": {"size": 1.0, "dimensions": dim, "boundary": boundary},
        "gas": {"eos": eos}, "drag": {"law": "constant", "K": 3.0},
        "dust": {"ratio": 1.0} if dust == 1 else [{"ratio": 1.0}] * dust,
    }  # fmt: skip
    return {name: table for name, table in (out | tables).items() if table is not None}


def lattice(dim=2):
    side = round(N ** (1 / dim))
    x = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(*[x] * dim, indexing="ij"), axis=-1).reshape(-1, dim)


def particles(dim=2, **changes):
    """Gas and dust on a lattice; a change is `gas_pos=...`, or None to leave the array out."""
    rng = np.random.default_rng(1)
    given = {
        name: {"pos": lattice(dim), "vel": 0.1 * rng.normal(size=(N, dim)), "mass": np.full(N, 1 / N)}
        for name in ("gas", "dust")
    }
    for name, value in changes.items():
        species, _, key = name.partition("_")
        given[species][key] = value
        if value is None:
            del given[species][key]
    return given


def bad(key, index, value, species="gas", start=None, dim=2):
    """Particles with one wrong entry."""
    given = particles(dim)
    array = np.array(given[species].get(key, start), float)
    array[index] = value
    given[species][key] = array
    return given


ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}


@pytest.mark.parametrize(
    "given, message",
    [
        (bad("vel", (5, 1), np.nan), r"gas vel\[5, 1\] is nan; expected a finite number"),
        (bad("pos", (7, 0), np.inf, "dust"), r"dust pos\[7, 0\] is inf; expected a finite number"),
        (bad("mass", 3, -1.0), r"gas mass\[3\] is -1; expected a positive number"),
        (bad("mass", 3, 1e300), r"gas mass\[3\] is 1e\+300; expected less than 1e\+150 code units"),
        (bad("mass", 3, 1e30), r"gas mass\[3\] is 6\.4e\+31 times mass\[0\]; expected at most 1e\+12 times"),
        (bad("density", 9, np.inf, start=np.ones(N)), r"gas density\[9\] is inf; expected a finite number"),
        (particles(gas_density=np.inf), r"gas density\[0\] is inf; expected a finite number"),
        (particles(gas_density=0.0), r"gas density\[0\] is 0; expected a positive number"),
        (particles(gas_pos=np.zeros(N)), rf"gas pos has shape \({N},\); expected \(n, 2\)"),
        (particles(gas_vel=np.zeros((N, 3))), rf"gas vel has shape \({N}, 3\); expected \({N}, 2\)"),
        (particles(dust_mass=np.ones(N - 1)), rf"dust mass has shape \({N - 1},\); expected \({N},\)"),
        (particles(dust_mass=1.0), rf"dust mass has shape \(\); expected \({N},\)"),
        (particles(gas_pos=np.zeros((0, 2))), r"gas pos has shape \(0, 2\); expected \(n, 2\)"),
        (particles(dust_species=np.zeros(10)), rf"dust species has shape \(10,\); expected \({N},\)"),
        (particles(dust_species=np.full(N, 0.5)), r"dust species\[0\] is 0\.5; expected a population"),
        (particles(dust_species=np.full(N, 2)), r"dust species\[0\] is 2; expected a population of the scene, 0 to 0"),
        (particles(gas_vel=None), "gas vel is missing; give all"),
        (particles(gas_vel=None, gas_vell=np.zeros((N, 2))), 'gas has an unknown array "vell".* did you mean "vel"?'),
        (particles(dust_u=np.ones(N)), 'dust has an unknown array "u"; expected "pos", "vel", "mass", "species"'),
        (particles(gas_u=np.ones(N)), 'gas u is given, but the gas is "isothermal"'),
        (particles(gas_mass=["a"] * N), "gas mass: a list cannot be read as an array of numbers"),
        (particles(gas_pos=lattice() + 0j), "gas pos: a ndarray cannot be read as an array of numbers"),
        (particles(gas_immobile=np.ones(N)), "gas immobile is true for all"),
        (particles(gas_immobile=np.full(N, 2)), r"gas immobile\[0\] is 2; expected true or false"),
        (particles() | {"dsut": {}}, '"dsut" is unknown; expected "gas", "dust"; did you mean "dust"?'),
        ({"gas": particles()["gas"]}, r'\[dust\]: particles has no key "dust"; add the key, or remove the table'),
        (particles() | {"gas": np.ones(3)}, "gas is a ndarray; expected a dict with the arrays"),
        ([1, 2], "particles: a list is not a dict"),
    ],
)
def test_what_is_wrong_is_named(given, message):
    with pytest.raises(SceneError, match=message):
        Simulation(scene(), particles=given)


@pytest.mark.parametrize(
    "energy, message",
    [
        (np.ones((N, 1)), rf"gas u has shape \({N}, 1\); expected \({N},\)"),
        (np.r_[np.ones(8), np.nan, np.ones(N - 9)], r"gas u\[8\] is nan"),
        (np.r_[np.ones(8), -1.0, np.ones(N - 9)], r"gas u\[8\] is -1; expected a positive number"),
    ],
)
def test_energies_are_looked_at(energy, message):
    with pytest.raises(SceneError, match=message):
        Simulation(scene(eos=ADIABATIC), particles=particles(gas_u=energy))


def test_a_missing_temperature_is_told():
    with pytest.raises(SceneError, match=r"gas u is missing; add an array of energies, or gas\.eos\.sound_speed"):
        Simulation(scene(eos={"kind": "adiabatic", "gamma": 1.4}), particles=particles())


def test_several_populations_need_their_numbers():
    with pytest.raises(SceneError, match=r"dust species is missing; add an array of the index .* 0 to 1"):
        Simulation(scene(dust=2), particles=particles())
    with pytest.raises(SceneError, match="dust species 1 has no particle that can move"):
        Simulation(scene(dust=2), particles=particles(dust_species=np.zeros(N)))


def test_quantities_are_converted():
    physical = scene(
        units={}, run={"until": "1 yr"}, space={"size": "4 au", "boundary": "periodic"}, drag=None, dust=1,
        gas={"eos": ADIABATIC | {"sound_speed": "1 km/s"}},
    )  # fmt: skip
    given = particles()
    for arrays in given.values():
        arrays["pos"] = (4.0 * arrays["pos"] * u.au).to(u.km)
        arrays["vel"] = arrays["vel"] * u.km / u.s
        arrays["mass"] = arrays["mass"] * u.Mearth
    given["gas"]["u"] = np.full(N, 2.0) * (u.km / u.s) ** 2
    sim = Simulation(physical, particles=given)
    units = sim.units
    np.testing.assert_allclose(sim.gas.pos, 4.0 * lattice(), rtol=1e-12)  # rounding
    np.testing.assert_allclose(sim.dust.vel * units.cgs("velocity"), 1e5 * particles()["dust"]["vel"], rtol=1e-9)
    np.testing.assert_allclose(sim.gas.mass * units.cgs("mass"), u.Mearth.to(u.g) / N, rtol=1e-9)
    np.testing.assert_allclose(sim.gas.u * units.cgs("specific_energy"), 2e10, rtol=1e-9)
    given["gas"]["vel"] = given["gas"]["vel"] * u.s
    with pytest.raises(SceneError, match=r'gas vel: "km" is a length; expected a velocity, like "1 km/s"'):
        Simulation(physical, particles=given)
    with pytest.raises(SceneError, match=r"gas mass: .*code units"):
        Simulation(scene(), particles=particles(gas_mass=np.ones(N) * u.kg))
    Simulation(scene(), particles=particles(gas_mass=np.ones(N) * u.dimensionless_unscaled))


def test_arrays_stay_those_of_the_caller():
    """What is accreted is overwritten in place."""
    free = np.zeros(N, bool)
    given = particles(dust_species=np.arange(N) % 2, gas_u=np.ones(N), gas_immobile=free, dust_immobile=free.copy())
    sim = Simulation(scene(dust=2, eos=ADIABATIC), particles=given)
    for name, particles_of in sim.state.species.items():
        for array in particles_of.arrays().values():
            assert not any(np.shares_memory(array, theirs) for theirs in given[name].values())


@pytest.mark.parametrize("dim", [1, 2])
def test_a_periodic_box_has_them_wherever_they_are(dim):
    """Shifted by whole boxes they are the same particles: the same forces, but for the rounding of places."""
    found = []
    for shift in (0.0, 3.0, -5.0):
        given = particles(dim)
        rng = np.random.default_rng(2)
        for arrays in given.values():
            arrays["pos"] = arrays["pos"] + 0.1 * rng.random((N, dim)) / N + shift
        sim = Simulation(scene(dim), particles=given)
        sim.step(most=1e-3)
        assert (sim.gas.pos >= 0.0).all() and (sim.gas.pos < 1.0).all()
        found.append(sim.acceleration("gas")[0])
    assert np.abs(found[0]).max() > 0.0
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-9 * np.abs(found[0]).max())


def test_a_place_a_rounding_below_zero_is_within_the_box():
    sim = Simulation(scene(), particles=bad("pos", (0, 0), -1e-20))
    assert sim.gas.pos[0, 0] == 0.0


@pytest.mark.parametrize("said", [None, 1, 7, 10**6])
def test_numbers_of_particles_are_those_given(said):
    """Sparse dust has its stopping time from its own density: what the scene says of numbers decides nothing."""
    tables = scene(dim=1, dust=2, drag={"law": "constant", "K": 3.0})
    if said is not None:
        tables["gas"] |= {"particles": said}
        tables["dust"] = [{"particles": said, "ratio": 1.0} for _ in range(2)]
    sim = Simulation(tables, particles=particles(dim=1, dust_species=np.arange(N) % 4 // 3))
    assert sim.scene.gas.particles == N and [p.particles for p in sim.scene.dust] == [48, 16]
    again = Simulation(tables | {"dust": [{"particles": 48, "ratio": 1.0}, {"particles": 16, "ratio": 1.0}]},
                       particles=particles(dim=1, dust_species=np.arange(N) % 4 // 3))  # fmt: skip
    for one in (sim, again):
        one.step(most=0.01)
    np.testing.assert_array_equal(sim.dust.vel, again.dust.vel)
    assert f"particles = {N}" in sim.scene.text and "particles = 48" in sim.scene.text
