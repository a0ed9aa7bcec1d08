"""Operators of a simulation: replaced, and what they say of an effect."""

from discsim.numerics.operators import Slot

FORCES = (Slot.FORCE, Slot.DRIFT_FORCE)


def replace_operator(sim, name, run):
    """Let the operator `name` of a simulation call `run`, and return what it called before."""
    for slot in Slot:
        for k, (effect, operator) in enumerate(sim.operators.plan[slot]):
            if operator.name == name:
                sim.operators.plan[slot][k] = effect, operator._replace(run=run)
                return operator.run
    raise KeyError(name)


def accelerated(effect, state):
    """Accelerations that an effect says it writes: "gas.acc" and the like."""
    written = {name for each in effect.operators(state) if each.slot in FORCES for name in each.writes}
    return {name for name in written if name.partition(".")[2] in ("acc", "acc_unshared")}


def limits_of(sim, name):
    """Limits of an effect by the last forces of a simulation, by species."""
    from discsim.numerics.operators import accelerate, limits

    effect = sim.effects[name]
    return limits(effect, sim.state, accelerate(effect, sim.state))
