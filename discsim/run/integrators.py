"""Integrators: the order of operators in a step, one function each, named in `run.integrator`.

    kdk     kick(dt/2)  operate(dt/2)  drift(dt)  operate(dt/2)  events  forces  kick(dt/2)
    euler   kick(dt)  operate(dt)  drift(dt), with the velocities before the kick  events  forces

A kick changes velocities by the accelerations. With drag it is the exact relaxation of gas and dust, which includes
the accelerations. The closing kick of a step and the opening kick of the next have the same sources, and the
relaxation composes exactly. Therefore `kdk` makes both as one kick: between steps the velocities are behind the
positions by `state.velocity_lag`, the length of the closing kick. `euler` is the first-order scheme of the papers.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Particles
    from discsim.run.operators import Operators


def kdk(step: "Operators", dt: float, until: float) -> None:
    """Advance the state of `step` by dt with second-order accuracy (kick, drift, kick).

    The closing kick of the previous step is made first; the closing kick of this step is left to the next step. If the
    step ends within rounding of `until`, the time is set to `until`.
    """
    state = step.state
    step.kick(state.velocity_lag + 0.5 * dt)
    state.velocity_lag = -0.5 * dt
    step.operate(0.5 * dt)
    step.move(dt)
    state.velocity_lag = 0.5 * dt
    step.operate(0.5 * dt, backwards=True)
    state.advance_time(dt, until)
    step.events()
    step.forces()


def euler(step: "Operators", dt: float, until: float) -> None:
    """Advance the state of `step` by dt with first-order accuracy.

    Velocities change by the forces at the old positions, and positions by the old velocities. until: as in `kdk`.
    """
    state = step.state
    moving: list[Particles | Bodies] = [*state.species.values(), *([state.bodies] if state.bodies is not None else [])]
    before = [m.vel.copy() for m in moving]
    step.kick(dt)
    step.operate(dt)
    kicked = [m.vel for m in moving]
    for m, vel in zip(moving, before, strict=True):
        m.vel = vel.copy()
    step.move(dt)
    for m, vel, old in zip(moving, kicked, before, strict=True):
        m.vel = vel + (m.vel - old)  # adds the changes by the drift: rotation of orbits, and acceleration of the frame
    state.advance_time(dt, until)
    step.events()
    step.forces()
