"""What effects prepare beside each other changes no bit, and is of the state that the step then has."""

import pytest
from runs import DISC, scene_of, state_bits

from discsim import Simulation
from discsim.parts import SCHEMES
from discsim.run import forces

BLOCKS = [name for name, scheme in SCHEMES.items() if scheme.places is not None]


def unprepared(monkeypatch):
    """Each effect makes all that it needs where it accelerates or kicks."""
    monkeypatch.setattr(forces, "several_threads", lambda: False)


def test_who_relaxes_in_blocks_prepares_them():
    assert {"tsc", "idic", "idic-linear"} <= {*BLOCKS}


@pytest.mark.parametrize("scheme", BLOCKS)
def test_a_kick_takes_what_was_prepared_for_it(tmp_path, four_cores, scheme):
    sim = Simulation(scene_of(tmp_path, DISC, f"drag.scheme={scheme}"))
    sim.evolve(0.1)
    effect = sim.effects["drag"]
    made, places = [], effect.scheme.places

    def noted(*given):
        made.append(sim.state.step)
        return places(*given)

    object.__setattr__(effect.scheme, "places", noted)
    try:
        first = sim.state.step
        sim.evolve(0.8)
    finally:
        object.__setattr__(effect.scheme, "places", places)
    # Once a step, beside its forces; for the first kick anew, as somebody had the arrays.
    assert sim.state.step > first + 5
    assert made == [*range(first, sim.state.step + 1)]


@pytest.mark.parametrize("scheme", BLOCKS)
@pytest.mark.parametrize("way", ["apart", "moved", "shown", "restored"])
def test_what_is_prepared_changes_no_bit(tmp_path, monkeypatch, four_cores, scheme, way):
    """Also where somebody changes places between forces and the kick, looks at the state, or goes back in time."""

    def act(sim):
        if way == "moved":
            sim.dust.pos[:] *= 1.01
        elif way == "shown":
            with sim.synchronised():
                sim.effects["drag"].columns(sim.state)
        return False

    def end():
        sim = Simulation(scene_of(tmp_path, DISC, f"drag.scheme={scheme}"))
        sim.evolve(0.1)
        sim.save(tmp_path / "old.h5")
        sim.evolve(0.5, lambda: act(sim))
        if way == "restored":
            sim.restore(tmp_path / "old.h5")
            sim.evolve(0.4)
        return state_bits(sim), sim.time

    prepared = end()
    unprepared(monkeypatch)
    assert prepared == end()
