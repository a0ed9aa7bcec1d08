"""Operators: each sees and changes what it declares, and those that run at the same time do not meet."""

import hashlib
import re

import numpy as np
import pytest
from stepping import disc

from discsim import Simulation
from discsim.effects import base
from discsim.numerics.operators import Operator, Slot, View
from discsim.parts import PartError
from discsim.run.declarations import checked_limits
from discsim.run.forces import Plan

DECLARED = (Slot.FIELD, Slot.FORCE, Slot.LIMIT, Slot.KICK_INPUT)  # slots whose operators declare arrays
SCENES = {
    "drag": disc(
        gas={"particles": 300, "eos": {"kind": "adiabatic", "gamma": 1.3, "sound_speed": 0.1}, "viscosity": {}},
        dust={"particles": 200, "ratio": 0.3}, self_gravity={"softening": 0.2}, external={"gas": [0.01, 0.0]},
        drag={"law": "stopping-time", "t_stop": 0.3}, radiation_pressure={"beta": 0.1},
        companion=[{"mass": 1e-3, "semi_major_axis": 1.5, "softening": "0.1"}],
    ),
    "quiet": disc(
        gas={"particles": 300, "quiet": True, "eos": {"kind": "isothermal", "sound_speed": 0.1}},
        alpha_viscosity={"alpha": 0.02},
    ),
    "cells": {
        "units": {"system": "code"}, "run": {"until": 0.1}, "initial": {"kind": "shock"},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "open"},
        "gas": {"particles": 60, "eos": {"kind": "adiabatic", "gamma": 1.4}}, "dust": {"particles": 60, "ratio": 0.5},
        "drag": {"law": "stopping-time", "t_stop": 0.1, "scheme": "emsi-ppm"},
    },
}  # fmt: skip


def bits(state):
    """Hash of each array of the particles by name, such as "gas.pos"."""
    return {
        f"{species}.{name}": hashlib.sha256(array.tobytes()).hexdigest()
        for species, p in state.species.items() for name, array in p.arrays().items()
    }  # fmt: skip


@pytest.mark.parametrize("scene", SCENES)
def test_operators_change_only_what_they_declare(scene):
    """Accelerations have their own arrays in a step; here both names are `acc`."""
    sim = Simulation(SCENES[scene])
    sim.step()
    seen = 0
    for slot in DECLARED:
        for _, operator in sim.operators.plan[slot]:
            before = bits(sim.state)
            for field in sim.operators.plan.fields_of(operator):
                sim.state.results[field[1].name] = field[1].run(View(sim.state, field[1], sim.state.results))
                before = bits(sim.state)
            sim.state.results[operator.name] = operator.run(View(sim.state, operator, sim.state.results))
            after = bits(sim.state)
            written = {name.replace("acc_unshared", "acc") for name in operator.writes}
            assert {name for name in after if after[name] != before[name]} <= written, operator.name
            seen += 1
    assert seen >= 4


@pytest.fixture(scope="module")
def sim():
    return Simulation(SCENES["drag"])


def test_an_operator_sees_no_array_that_it_does_not_declare(sim):
    one = Operator("one.force", Slot.FORCE, print, base.arrays("gas", "pos"), base.arrays("gas", "acc"))
    view = View(sim.state, one, {"two.field": 1.0})
    assert view.gas.pos is sim.gas.pos and view.gas.acc is sim.gas.acc and view.gas.count == sim.gas.count
    for use in (
        lambda: view.gas.vel,
        lambda: view.dust.pos,
        lambda: setattr(view.gas, "pos", sim.gas.pos),
        lambda: view.star_mass,
        lambda: view.until,
    ):
        with pytest.raises(AttributeError, match="operator"):
            use()
    with pytest.raises(KeyError, match=r"one[.]force does not declare that it reads two[.]field"):
        view["two.field"]


class Listing(base.Effect):
    """Effect that lists the operators given."""

    def __init__(self, *listed):
        self.listed = [*listed]

    def operators(self, state):
        return self.listed


def operator(name="force", slot=Slot.FORCE, reads=("gas.pos",), writes=("gas.acc",)):
    return Operator(f"other.{name}", slot, print, frozenset(reads), frozenset(writes))


FAULTS = {
    "gas.density and other.field run at the same time, and one of the two changes gas.density, which the": [
        operator("field", Slot.FIELD, writes=["gas.density"]), operator(reads=["other.field"]),
    ],
    "gas.forces and other.input run at the same time, and one of the two changes gas.pressure": [
        operator("input", Slot.KICK_INPUT, ["gas.pressure"], [])
    ],
    "other.force: the force writes nothing": [operator(writes=[])],
    "other.force: another operator has the same name": [operator(), operator()],
    "other.field: no force reads this field": [operator("field", Slot.FIELD, writes=[])],
    'other.force: there is no "gas.sped" to read or write in its slot; did you mean': [
        operator(reads=["gas.sped"])
    ],
    'other.force: there is no "drag.kick" to read': [operator(reads=["drag.kick"])],
    "other.force: gas.acc is complete only in the slot LIMIT": [operator(reads=["gas.acc"])],
    "other.kick: the operator is in the slot KICK": [operator("kick", Slot.KICK)],
    'gas.push: the operator belongs to the effect other; expected a name that begins with the effect': [
        operator()._replace(name="gas.push")
    ],
    "other.force: 'FORCE' is not a slot; expected a slot like base.Slot.FORCE": [operator()._replace(slot="FORCE")],
    "other.force: 'gas.pos' is not a set of names": [operator()._replace(reads="gas.pos")],
    "other.operators returns a list of str; expected a list of base.Operator": ["other.force"],
}  # fmt: skip


@pytest.mark.parametrize("words", FAULTS)
def test_operators_that_do_not_fit_are_one_message(sim, words):
    with pytest.raises(PartError, match=re.escape(words)):
        Plan(sim.effects | {"other": Listing(*FAULTS[words])}, sim.state)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (0.1, "other.limit returns a float; expected limits by species, like {base.ALL: base.Limit(step)}"),
        (None, "other.limit returns a NoneType; expected limits"),
        ({"all": 0.1}, "other.limit returns a dict of float; expected limits"),
        ({"dsut": base.Limit(0.1)}, 'other.limit: "dsut" is not a species; expected "gas", "dust" or base.ALL'),
    ],
)
def test_limits_that_are_none_are_one_message(found, words):
    with pytest.raises(PartError, match=re.escape(words)):
        checked_limits(operator("limit", Slot.LIMIT), found)


def test_a_sum_of_forces_is_changed_in_place(sim):
    view = View(sim.state, operator(), {}, {"gas.acc": np.zeros((3, 2))})
    view.gas.acc += 1.0
    assert view.gas.acc.sum() == 6.0
    with pytest.raises(AttributeError, match="acc is a sum of several forces and cannot be replaced"):
        view.gas.acc = np.zeros((3, 2))


def test_a_step_limit_of_each_effect_is_that_of_its_operators(sim):
    sim.operators.forces()
    found = sim.acceleration("external")[0]
    np.testing.assert_allclose(found, np.broadcast_to([0.01, 0.0], found.shape))
    assert sim.limited_by in sim.effects and 0.0 < sim.limit < np.inf


def test_an_effect_of_the_former_interface_is_refused():
    with pytest.raises(TypeError, match=r"add the method operators [(]docs/recipes/effect[.]md"):
        type("Old", (base.Effect,), {"accelerate": lambda self, state: None})


def test_an_effect_has_few_members():
    assert len([name for name in vars(base.Effect) if not name.startswith("__")]) <= 12
