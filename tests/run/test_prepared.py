"""What effects prepare beside each other changes no bit, and is of the state that the step then has."""

from dataclasses import replace

import numpy as np
import pytest
from runs import DISC, scene_of, state_bits

from discsim import Simulation
from discsim.parts import SCHEMES
from discsim.run import forces
from discsim.run.simulation import PhysicsError

BLOCKS = [name for name, scheme in SCHEMES.items() if scheme.build is not None]


def unprepared(monkeypatch):
    """Each effect makes all that it needs where it accelerates or kicks."""
    monkeypatch.setattr(forces, "several_threads", lambda: False)


def test_who_relaxes_in_blocks_prepares_them():
    assert {"tsc", "idic", "idic-linear"} <= {*BLOCKS}


@pytest.mark.parametrize("scheme", BLOCKS)
def test_a_kick_takes_what_was_prepared_for_it(tmp_path, four_cores, scheme):
    sim = Simulation(scene_of(tmp_path, DISC, f"drag.scheme={scheme}"))
    sim.evolve(0.1)
    engine, first, made = sim.effects["drag"].engine, sim.state.step, []
    build = engine.scheme.build

    def noted(*given):
        made.append(sim.state.step)
        return build(*given)

    engine.scheme = replace(engine.scheme, build=noted)
    sim.evolve(0.8)
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


@pytest.mark.parametrize("scheme", BLOCKS)
def test_who_looks_at_changed_particles_sees_these(tmp_path, monkeypatch, four_cores, scheme):
    """Between steps of euler no kick is open: what was prepared for the next one is still there."""

    def seen():
        sim = Simulation(scene_of(tmp_path, DISC, f"drag.scheme={scheme}", "run.integrator=euler"))
        sim.evolve(0.3)
        sim.dust.remove(np.arange(0, sim.dust.count, 2))
        with sim.synchronised() as state:
            times = sim.effects["drag"].current_stopping_times(state)
        assert len(times) == sim.dust.count
        return times.tobytes()

    prepared = seen()
    unprepared(monkeypatch)
    assert prepared == seen()


def test_a_fault_leaves_nothing_prepared(tmp_path, monkeypatch, four_cores):
    """Of the field that another effect had made in time, of where particles were."""
    sim = Simulation(scene_of(tmp_path, DISC))
    sim.evolve(0.3)

    def fail(*given):
        raise FloatingPointError("no density")

    monkeypatch.setattr(sim.effects["gas"].sph, "density", fail)
    with pytest.raises(PhysicsError, match="no density"):
        sim.step()
    sim.gas.pos[:], sim.dust.pos[:] = 0.9 * sim.gas.pos, 0.9 * sim.dust.pos
    first, second = (sim.acceleration("self_gravity")[0] for _ in range(2))
    assert np.array_equal(first, second)
