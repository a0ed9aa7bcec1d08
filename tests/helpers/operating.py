"""Operators of a simulation: replaced, and what they say of an effect."""

from discsim.numerics.operators import Slot, limits, smallest_limits

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
    effect = sim.effects[name]
    return limits(effect, sim.state, sim.state.results)


def longest_step_of(sim, name):
    """Longest step that an effect allows, by the last forces of a simulation."""
    return smallest_limits(limits_of(sim, name), sim.state.dust_is_passive)[0]
