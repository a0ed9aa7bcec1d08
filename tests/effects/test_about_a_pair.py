"""Every effect about a tight pair of stars against one star of the same mass, and a central mass that changes."""

import numpy as np
import pytest
from pair import EFFECTS, FIRST, SECOND, differences, found, run, scene

from discsim import Simulation
from discsim.parts import EFFECTS as ALL
from discsim.preview.derived import derived
from discsim.scene import load_scene

BOTH = FIRST + SECOND
# The quadrupole of the pair is 3/4 M_1 M_2 / M^2 (a / r)^2 of the pull, 3.3e-4 at r = 1, of which velocities have half:
# found up to 1.4e-4.
SAME = 1e-3


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_about_a_pair_is_that_about_one_star(name):
    """Energies, velocities, Stokes numbers, cooling, viscosity, sizes: by rings, after some of every effect's time."""
    off = differences(run(True, **EFFECTS[name]), run(False, **EFFECTS[name]))
    assert max(off.values()) < SAME, off


def test_every_effect_that_can_be_is_about_a_pair():
    given = {table for tables in EFFECTS.values() for table in scene(True, **tables)}
    # Without a star's part in them, and what needs the star at the origin.
    assert given | {"external", "background"} >= {name.split(".")[0] for name in ALL}


@pytest.mark.parametrize("name", EFFECTS)
def test_check_tells_of_a_pair_what_it_tells_of_one_star(name):
    """To the four digits that it prints."""
    pair, star = (dict(derived(load_scene(scene(pair, **EFFECTS[name])))) for pair in (True, False))
    own = {row: text for row, text in pair.items() if not row.startswith("companion")}
    assert own == star


@pytest.mark.parametrize("ramp", [0.0, 0.7])
def test_a_disc_turns_about_both_masses_from_the_start(ramp):
    """With a ramp they are one at the barycentre at first, then a pair: v_phi stays what it is at each radius."""
    tables = EFFECTS["cooling, beta"]
    star = run(False, until=1.4, **tables)
    sim = Simulation(scene(True, ramp=ramp, until=1.4, **tables))
    assert sim.state.central_mass == pytest.approx(BOTH, rel=1e-15)
    assert sim.bodies.felt.sum() == pytest.approx(BOTH, rel=1e-15)
    if ramp > 0.0:
        assert np.abs(sim.bodies.felt_pos[0]).max() < 1e-15 and sim.bodies.felt[1] == 0.0
    sim.step(1e-9)
    assert max(differences(found(sim), run(False, until=1e-9, **tables)).values()) < SAME
    sim.run()
    assert max(differences(found(sim), star).values()) < SAME
