"""Simulation of a scene, for users of discsim from Python and for `run/runner.py`.

`run/integrators.py` composes a step of the stages in `run/operators.py`. While a caller reads the state
(`synchronised`), velocities have the closing kick; afterwards the kick is undone exactly, so that reading does not
change the run.
"""

from __future__ import annotations

import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from discsim.effects.added_force import AddedForce, Function, descriptions
from discsim.effects.base import Effect
from discsim.initial import user_arrays
from discsim.numerics.bodies import Bodies
from discsim.numerics.state import Dust, Gas, State
from discsim.numerics.threads import set_threads
from discsim.output import checkpoint
from discsim.output.checkpoint import Scalar, Values
from discsim.parts import INTEGRATORS, import_object
from discsim.preview.forecast import memory_warnings
from discsim.printable import printable
from discsim.run import checkpoint_contents, guards
from discsim.run.costs import Costs
from discsim.run.forces import PhysicsError, acceleration_of
from discsim.run.interrupts import Interrupts
from discsim.run.operators import Operators
from discsim.run.outputs import open_step_between, write_state
from discsim.run.start import InitialState, begin
from discsim.run.timestep import next_step
from discsim.run.watch import Watch
from discsim.scene import Scene, SceneError, load_scene
from discsim.scene.differences import refuse_changed_scene
from discsim.scene.orbits import time_in_code_units
from discsim.scene.summary import Rows, Summarised
from discsim.scene.units import Units

__all__ = ["PhysicsError", "Simulation"]

KICKED_ARRAYS = ("vel", "across", "u", "kick_acc", "kick_rate", "radiated")  # arrays that a kick changes


class Simulation(Summarised):
    """Simulation of a scene, one step or many at a time, with access to all arrays.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        Validated scene, path of a TOML file, or dict with the same tables, whose values may be Quantities.
    particles : dict of dict, optional
        Own particles by species ("gas", "dust"), in place of [initial]: `pos` (n, d), `vel` (n, d) and `mass` (n,); for
        adiabatic gas `u` (n,), for several populations of dust `species` (n,), for grains of many sizes `size` (n,).
        Values are Quantities or in code units, and are copied.
    to_restore : bool, optional
        Whether `restore` will replace the state, so that the gas need not be relaxed before t = 0.
    begun : InitialState, optional
        Initial state and effects of the scene. The default is to make them.

    Raises
    ------
    SceneError
        The scene or the particles are wrong; its `problems` has a message for each fault.

    Notes
    -----
    Arrays are in code units, in which G = 1, with one row per particle. They may be changed between steps, and are
    checked before the next step uses them.
    """

    def __init__(
        self,
        scene: Scene | str | Path | dict[str, Any],
        particles: dict[str, dict[str, Any]] | None = None,
        *,
        to_restore: bool = False,
        begun: InitialState | None = None,
    ):
        if not isinstance(scene, Scene):
            scene = load_scene(scene, own_particles=particles is not None)
        given = None if particles is None else user_arrays.read_arrays(scene, particles)
        if given is not None:
            scene = user_arrays.with_particle_counts(scene, given)
        self.scene = scene
        if faults := list(memory_warnings(scene)):
            raise SceneError(faults)
        set_threads(scene.run.threads)
        self.state, effects, self.relaxed = begun or begin(scene, given, to_restore)
        self.operators = Operators(self.state, effects)
        self._integrate = import_object(INTEGRATORS[scene.run.integrator])
        self._has_forces = self._step_is_half_made = False
        # State of the run before its closing kick, while a caller reads the state after this kick; otherwise None.
        self._unclosed: State | None = None

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        remedy = "use save(path), then restore(path) of another Simulation"
        raise TypeError(f"a Simulation cannot be pickled or copied; {remedy}")

    @property
    def time(self) -> float:
        """Time of the present positions, in code units."""
        return self.state.time

    @property
    def effects(self) -> dict[str, Effect]:
        """Active effects, by the names of their tables."""
        return self.operators.effects

    @property
    def limit(self) -> float:
        """Longest step that the effects allow, before the Courant factor, in code units; inf before the first step."""
        return self.operators.limits.step

    @property
    def limited_by(self) -> str:
        """Name of the effect that sets `limit`."""
        return self.operators.limits.by

    @property
    def costs(self) -> Costs:
        """Cost of each effect, by the name of its table: `seconds` (CPU), `calls` and `shares`."""
        return self.operators.costs

    @costs.setter
    def costs(self, costs: Costs) -> None:
        self.operators.costs = costs

    @property
    def units(self) -> Units:
        """Units of the scene, which convert code units."""
        return self.scene.units

    @property
    def gas(self) -> Gas | None:
        """Gas particles with their arrays; None if the scene has none."""
        return self.state.gas

    @property
    def dust(self) -> Dust | None:
        """Dust particles with their arrays; None if the scene has none."""
        return self.state.dust

    @property
    def bodies(self) -> Bodies | None:
        """Star and companions; None without a star, or with a single star of constant mass at the origin."""
        return self.state.bodies

    def step(self, most: float = math.inf) -> float:
        """Make one whole step, after which velocities and positions are at the same time. Ctrl-C waits for its end.

        Parameters
        ----------
        most : float, optional
            Longest length of the step, in code units.

        Returns
        -------
        float
            Length of the step, in code units.

        Raises
        ------
        ValueError
            `most` is not positive, nothing limits the step, or an array that was set is wrong.
        PhysicsError
            A number is not finite, or the step has collapsed.
        RuntimeError
            The state is being read, in a callback or `synchronised`, or an interrupt has left a step half-made.
        """
        if not most > 0.0:
            raise ValueError(f"most = {most} is not a time step; expected a positive time in code units")
        self._prepare()
        dt = min(next_step(self.state, self.operators.limits, math.inf), most)
        if dt == math.inf:
            raise ValueError("no effect limits the step after run.until; call step(most=...) with a time in code units")
        guards.check_dust_step(self.state, self.effects, self.operators.limits, dt)
        with self._uninterrupted():
            self._advance(dt)
            self.operators.close()
        return dt

    def run(
        self, until: Any = None, *, progress: bool = False, every: Any = None,
        callback: Callable[[Simulation], object] | None = None,
    ) -> None:  # fmt: skip
        """Step to the time `until` and land on it.

        Parameters
        ----------
        until : str, float or Quantity, optional
            Time of the end, like "500 yr" or "40 orbits at 5.2 au"; a number is in code units. The default is
            `run.until` of the scene.
        progress : bool, optional
            Whether to show the progress, as the command does.
        every : str, float or Quantity, optional
            Time between calls of `callback`. Steps end exactly at multiples of `every`.
        callback : callable, optional
            `callback(sim)` is called after each step or, with `every`, at multiples of `every` and at the end. It
            sees read-only views with velocities at the time of positions, as in `synchronised`, and has no effect on
            the run. If it returns True, the run ends early.

        Raises
        ------
        ValueError
            `until` is not finite; `every` is not positive, has no callback or gives too many calls; or an array that
            was set is wrong.
        PhysicsError
            A number is not finite, or the step has collapsed.
        RuntimeError
            The state is being read, in a callback or `synchronised`, or an interrupt has left a step half-made.

        Notes
        -----
        Ctrl-C ends the run after the present step. Another `run` then continues bit for bit as if there had been no
        interruption. Until then the velocities lack the closing kick of the last step; in `synchronised` they have it.
        """
        end = self.scene.run.until if until is None else self._time_in_code_units(until)
        with Watch(self, end, progress, None if every is None else self._time_in_code_units(every), callback) as watch:
            for time in watch.times:
                try:
                    if not self.evolve(time, watch.after_step, read_only=True):  # callbacks get read-only views
                        break
                except KeyboardInterrupt:
                    if not self._step_is_half_made:
                        watch.after_step()  # for the step whose end the interrupt has waited for
                    raise
        with self._uninterrupted():
            self.operators.close()

    def _time_in_code_units(self, time: Any) -> float:
        return time_in_code_units(time, self.units, self.scene.text)

    def summary(self) -> tuple[str, Rows]:
        """Return the title of the scene, and rows (name, value): the time, the step and facts of the scene."""
        now, forces = self.scene.show_time(self.time), descriptions(self.effects)
        added = [("forces", ", ".join(forces))] if forces else []
        rows = [("time", now), ("step", self.state.step), *self.scene.facts, *added]
        return self.scene.title or "A simulation", rows

    def evolve(self, until: float, after_step: Callable[[], bool] | None = None, read_only: bool = False) -> bool:
        """Step to the time `until`, and leave the closing kick of the last step to the next step.

        Parameters
        ----------
        until : float
            Time of the end, in code units.
        after_step : callable, optional
            `after_step()` is called after each step. If it returns True, the run ends early.
        read_only : bool, optional
            Whether `after_step` only reads the state, so that arrays need no check before the next step.

        Returns
        -------
        bool
            False if `after_step` ended the run early.

        Raises
        ------
        ValueError
            An array that was set is wrong.
        PhysicsError
            A number is not finite, or the step has collapsed.
        RuntimeError
            The state is being read, in a callback or `synchronised`, or an interrupt has left a step half-made.
        """
        self._prepare()
        while self.state.time < until:
            dt = next_step(self.state, self.operators.limits, until)
            guards.check_dust_step(self.state, self.effects, self.operators.limits, dt)
            with self._uninterrupted():
                self._advance(dt, until)
            if after_step is not None and after_step():
                return False
            if after_step is not None and not read_only:
                self.operators.check_exposed_arrays()
        return True

    @contextmanager
    def synchronised(self) -> Iterator[State]:
        """Yield read-only views of the state, with velocities at the time of the positions; the run is unaffected.

        Yields
        ------
        State
            State after the closing kick of the last step.

        Notes
        -----
        Within the context `sim.gas`, `sim.dust` and `sim.state` are these views. Attributes set on the views are lost
        at the end. `step`, `run`, `evolve` and `restore` raise RuntimeError; `save` writes the state of the run.
        """
        if self._unclosed is not None:
            yield self.state
            return
        with self.closed() as state:
            self.state = state.read_only()
            try:
                yield self.state
            finally:
                self.state = state

    @contextmanager
    def closed(self) -> Iterator[State]:
        """Yield the state after its closing kick, for outputs that only read it; undo the kick at the end."""
        self._prepare()
        state = self._unclosed = self.state
        try:
            if state.velocity_lag == 0.0:
                yield state
                return
            saved = {
                name: {k: v.copy() for k, v in p.arrays().items() if k in KICKED_ARRAYS}
                for name, p in state.species.items()
            }
            species: dict[str, Any] = {name: replace(p, **saved[name]) for name, p in state.species.items()}
            self._unclosed = replace(state, bodies=state.bodies and state.bodies.copy(), **species)
            costs, self.costs = self.costs, Costs(self.effects)
            try:
                self.operators.close()
            finally:
                self.costs = costs
            yield state
        finally:
            if self._unclosed is not state:
                self.operators.arrays_exposed = True
                state.velocity_lag, state.bodies = self._unclosed.velocity_lag, self._unclosed.bodies
                state.set_arrays(saved)
            self._unclosed = None

    def add_force(
        self, function: Function, on: str | Iterable[str], *, name: str = "force", potential: Function | None = None,
        limit: Any = None,
    ) -> None:  # fmt: skip
        """Add a force, which acts from now on as an effect `sim.effects[name]`; after an exception there is none.

        Parameters
        ----------
        function : callable
            `function(particles, time)` returns the accelerations (n, d) in code units; `particles` has read-only arrays
            `pos`, `mass`, `ids` and, of dust, `species` and `size` (if grains have individual sizes).
        on : str or sequence of str
            Species that feel the force: "gas", "dust" or both. The function is called for each of them.
        name : str, optional
            Name of the force, for `sim.effects` and `remove_force`.
        potential : callable, optional
            `potential(particles, time)` returns the potential energies per mass (n,), for `potential_energy`.
        limit : float or Quantity, optional
            Longest time step before the Courant factor: 1 / the highest frequency. None: the force sets no limit.

        Raises
        ------
        ValueError
            An argument is wrong, or the function returns something else than accelerations (n, d).
        PhysicsError
            An acceleration is not finite.
        RuntimeError
            The state is being read, in a callback or `synchronised`, or an interrupt has left a step half-made.

        Notes
        -----
        A checkpoint records the name and species of the force, not the function: add the force again before `restore`.
        """
        self._refuse_during_read()
        self._refuse_half_made()
        set_threads(self.scene.run.threads)
        step = None if limit is None else self._time_in_code_units(limit)
        effect = AddedForce(name, function, on, potential, step, self.state, self.effects)
        self.operators.check_exposed_arrays()
        guards.check_new_effect(self.state, name, effect)
        effect.potential_energy(self.state)  # checks its shape
        self._change_effects({**self.effects, name: effect})

    def remove_force(self, name: str) -> None:
        """Remove a force of `add_force`, which acts up to now.

        Parameters
        ----------
        name : str
            Name of the force.

        Raises
        ------
        KeyError
            There is no added force with this name.
        PhysicsError, RuntimeError, ValueError
            As for `step`.
        """
        known = [key for key, effect in self.effects.items() if isinstance(effect, AddedForce)]
        if name not in known:
            raise KeyError(f"{printable(name)} is no added force; expected one of {', '.join(known) or 'none'}")
        self._change_effects({key: effect for key, effect in self.effects.items() if key != name})

    def _change_effects(self, effects: dict[str, Effect]) -> None:
        """Replace the effects, and compute the forces again if they are known."""
        has_begun = self._has_forces or self.state.velocity_lag > 0.0
        if has_begun:
            self._prepare()
        self.operators.change_effects(effects)
        if has_begun:
            with self._uninterrupted():
                self.operators.close()  # by the accelerations so far
                self.operators.forces()

    def acceleration(self, effect: str) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return the accelerations that one effect causes at present.

        Parameters
        ----------
        effect : str
            Name of the effect's table.

        Returns
        -------
        gas, dust : array (n, d) or None
            Accelerations of the gas and of the dust in code units; None if the scene has none.

        Raises
        ------
        KeyError
            The scene has no such effect.
        ValueError
            An array that was set is wrong.
        """
        if effect not in self.effects:
            raise KeyError(f"no effect {effect!r} in this scene; expected one of {', '.join(self.effects)}")
        set_threads(self.scene.run.threads)
        if self._unclosed is None:
            guards.check_entries(self.state, self.effects)
        found = acceleration_of(self.effects[effect], self.state)
        return found.get("gas"), found.get("dust")

    def save(
        self, path: str | Path, notes: Mapping[str, Scalar] | None = None, before: str | Path | None = None
    ) -> None:
        """Write a checkpoint from which `restore` continues, bit for bit.

        Parameters
        ----------
        path : str or Path
            File of the checkpoint.
        notes : mapping of str to scalar, optional
            Further values for the checkpoint.
        before : str or Path, optional
            New name of an earlier checkpoint at `path`. None: that checkpoint is overwritten.

        Raises
        ------
        OSError
            The file cannot be written.
        PhysicsError
            The state is not finite; such a checkpoint must not replace a good one.
        RuntimeError
            An interrupt has left a step half-made.
        """
        groups, values = self.contents()
        checkpoint.write_checkpoint(path, groups, {**values, **(notes or {})}, None if before is None else Path(before))

    def write_snapshot(self, path: str | Path) -> None:
        """Write a snapshot of the present state for `discsim.read_snapshot`, figures and images; the run is unaffected.

        Parameters
        ----------
        path : str or Path
            File of the snapshot, replaced if it is there.

        Raises
        ------
        OSError
            The file cannot be written.
        PhysicsError, ValueError
            An array that was set is wrong.
        RuntimeError
            An interrupt has left a step half-made.
        """
        if self._unclosed is None:
            self._prepare()
        step = open_step_between(self._unclosed or self.state, self.effects)
        with nullcontext(self.state) if self._unclosed else self.closed() as state:
            write_state(path, self.scene, state, self.effects, step)

    def contents(self) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, Scalar]]:
        """Return the contents of a checkpoint of the present state: arrays by group and name, and single values.

        Raises PhysicsError if the state is not finite, and RuntimeError after an interrupted step.
        """
        if self._unclosed is None and not self._has_forces:
            self._prepare()
        self._refuse_half_made()
        state = self._unclosed or self.state
        guards.check_entries(state, self.effects)
        return checkpoint_contents.contents_of(self.scene, state, self.operators)

    def restore(self, path: str | Path, share: tuple[int, int] = (0, 1)) -> Values:
        """Continue from a checkpoint of this scene. After an exception the simulation is unchanged.

        Parameters
        ----------
        path : str or Path
            File of the checkpoint. Its scene may differ from this one as far as --resume allows.
        share : tuple of int, optional
            Number of a process and number of processes, to read only this process's part of the particles.

        Returns
        -------
        Values
            Single values of the checkpoint, such as `notes` of `save`.

        Raises
        ------
        CheckpointError
            The checkpoint cannot be read, is damaged, or its run has other forces of `add_force`.
        SceneError
            The checkpoint is of another scene.
        RuntimeError
            The state is being read, in a callback or `synchronised`.

        Warns
        -----
        OtherVersionWarning
            The checkpoint is of another version of discsim.
        """
        self._refuse_during_read()
        groups, values = checkpoint.read_checkpoint(path, share)
        refuse_changed_scene(path, groups["scene"]["text"].tobytes(), self.scene)
        checkpoint_contents.refuse_other_forces(values, self.effects)
        found = checkpoint_contents.checked_contents(path, self.state, self.effects, groups, values)
        remark = checkpoint.other_version_warning(values)
        if remark:  # before anything is set, as a filter may raise it as an exception
            warnings.warn(remark, checkpoint.OtherVersionWarning, stacklevel=2)
        self.state.set_arrays(found.particles)
        for name, value in found.of_state.items():
            setattr(self.state, name, value)
        self.costs, self.operators.limits = found.costs, found.limits
        self.state.results.clear()
        self.operators.reversals.forget()
        self._has_forces, self._step_is_half_made = True, False  # the arrays contain the forces
        return values

    # The step

    @contextmanager
    def _uninterrupted(self) -> Iterator[None]:
        """Run the block of the context to its end before a first Ctrl-C raises KeyboardInterrupt.

        A second Ctrl-C raises KeyboardInterrupt at once or, if other threads run loops, after these loops. The step is
        then half made, and the state cannot be used. Another handler of SIGINT that the caller has set stays in force.
        """
        set_threads(self.scene.run.threads)
        is_main = threading.current_thread() is threading.main_thread()
        is_default = is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        with Interrupts([signal.SIGINT] if is_default else []) as interrupts:
            self._step_is_half_made = True
            yield
            self._step_is_half_made = False
        if interrupts.number:
            raise KeyboardInterrupt

    def _prepare(self) -> None:
        """Check the state before a step, and compute the forces unless they are known.

        Raises RuntimeError if the state is being read or a step is half made, and ValueError or PhysicsError if an
        array is wrong.
        """
        set_threads(self.scene.run.threads)
        self._refuse_during_read()
        self._refuse_half_made()
        self.operators.check_exposed_arrays()
        if not self._has_forces:
            with self._uninterrupted():
                self.operators.forces()
                self._has_forces = True

    def _refuse_during_read(self) -> None:
        """Raise RuntimeError if a callback, or the context of `synchronised` or `closed`, reads the state."""
        if self._unclosed is not None:
            wrong = "the state is being read, in a callback or in synchronised()"
            raise RuntimeError(f"{wrong}; call this method afterwards, or use another Simulation")

    def _refuse_half_made(self) -> None:
        """Raise RuntimeError if an interrupt has left a step half made."""
        if self._step_is_half_made:
            remedy = "make a new Simulation, or call restore() with a checkpoint"
            raise RuntimeError(f"the last step was interrupted; {remedy}")

    def _advance(self, dt: float, until: float = math.inf) -> None:
        """Advance by dt: make the closing kick of the last step, and this step without its closing kick.

        until: if the step ends within rounding of this time, the time is set to `until`.
        """
        self._integrate(self.operators, dt, until)
