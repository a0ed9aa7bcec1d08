"""Run of a validated scene, with the files of its directory: outputs, checkpoints, interrupts, messages."""

from __future__ import annotations

import signal
import time
import warnings as python_warnings
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from numba.core import event

from discsim.effects.base import kick_effect
from discsim.initial import start_time
from discsim.jit import cache
from discsim.output import hdf5
from discsim.output.checkpoint import OtherVersionWarning, Scalar, Values, other_version, write_checkpoint
from discsim.output.files import command, replace_atomically
from discsim.output.open_step import open_step_of
from discsim.output.parts import tidy
from discsim.output.snapshot import write_snapshot
from discsim.preview.derived import effect_rows
from discsim.preview.forecast import learn
from discsim.preview.warnings import warnings
from discsim.printable import UserError
from discsim.run.checkpoints import Checkpoints, later_snapshots
from discsim.run.compilation import Compilation, of_numba_cache
from discsim.run.directory import held, only_begun, refuse_directory, remove_copies, scene_there, sweep, with_own_files
from discsim.run.interrupts import Interrupts
from discsim.run.outputs import due_times
from discsim.run.progress import Progress
from discsim.run.records import Records
from discsim.run.shown import columns, with_present_pressure
from discsim.run.simulation import PhysicsError, Simulation
from discsim.scene import Scene
from discsim.scene.differences import refuse_another
from discsim.scene.fields import MOST_SNAPSHOTS
from discsim.scene.units import clock
from discsim.userfiles import NO_HANDLES, system_message
from discsim.version import __version__

DONE, NOT_WRITTEN, WRONG_INPUT, PHYSICS = 0, 1, 2, 3  # exit statuses; interrupted: 128 + the signal
SMALL = 20_000  # particles below which history.csv has a row for every step
LONG_RUN = 100  # steps from which on the cost of a run is recorded for forecasts
ROW_EVERY = 16  # steps between rows of a larger run


def run_scene(scene: Scene, directory: Path, resume: bool = False, quiet: bool = False) -> int:
    """Run `scene` with its files in `directory`, or resume the run there, and return the exit status.

    0: done, or stopped by run.walltime. 1: a file cannot be written. 2: the run cannot start, or be resumed. 3:
    stopped by the physics. 128 + signal: interrupted. An error is one message on stderr.
    """
    return ended(Run(scene, Path(directory), quiet), resume)


def ended(run: Run, resume: bool) -> int:
    """Complete a run, and return its exit status as `run_scene`."""
    directory = run.directory
    fail = run.progress.fail
    with run.interrupts, event.install_listener("numba:compile", run.compilation):
        try:
            return run.go(resume)
        except PhysicsError as fault:
            fail(f"stopped by a numerical failure {run.where()}: {fault}", run.way_back())
            return PHYSICS
        except UserError as fault:
            fail(*str(fault).split("\n"))
            return WRONG_INPUT
        except MemoryError as fault:
            fail(f"out of memory {run.where()}: {fault or 'an array does not fit'}", run.way_back())
            return PHYSICS
        except OSError as fault:
            if of_numba_cache(fault) and fault.errno not in NO_HANDLES:
                reason = fault.strerror or str(fault)
                cure = "Free disk space there, or set NUMBA_CACHE_DIR to another directory"
                fail(f"{cache.folder()}: compiled kernels cannot be written: {reason}. {cure}. {run.way_back()}")
            else:
                fail(f"{system_message(fault, 'written', directory)}. {run.way_back()}")
            return NOT_WRITTEN
        except cache.CacheError as fault:
            fail(str(fault))
            return NOT_WRITTEN
        except KeyboardInterrupt:
            fail(f"stopped immediately. {run.way_back()}")
            return 128 + run.interrupts.number
        finally:
            run.close()


class Run:
    """Run of a scene: its simulation, and the files of its directory."""

    sim: Simulation
    records: Records

    def __init__(self, scene: Scene, directory: Path, quiet: bool) -> None:
        self.scene, self.directory = scene, directory
        self.progress, self.interrupts = Progress(scene, quiet), Interrupts()
        self.compilation = Compilation(self.progress)
        self.checkpoints, self.figure = Checkpoints(directory), directory / "last_state.png"
        self.begun = self.saved = time.monotonic()
        self.saved_time: float | None = None
        self.snapshots = self.steps = 0  # snapshots written; steps made by this process
        self.put_out = start_time(scene)  # time of the last snapshot
        self.dt, self.set_by = 0.0, ""  # of the last step
        self.held = ExitStack()
        self.copied: list[Path] = []  # copies of the scene's files, made before the run begins
        count = (scene.gas.particles if scene.gas else 0) + sum(p.particles for p in scene.dust or ())
        self.rows_every = 1 if count < SMALL else ROW_EVERY

    def go(self, resume: bool) -> int:
        """Start or resume the run, step to its end, and return the exit status."""
        locked, resume, reached = self._enter(resume)
        times = due_times(self.scene.run, reached, self.put_out)
        if not times:
            return self._nothing_left(reached)
        self._announce(locked)
        self._copy_files()
        self.sim = self._simulation(resume)
        if self.sim.relaxed is not None:
            self.progress.say(str(self.sim.relaxed))
        if cache.is_temporary():
            why = "numba's usual folders are not writable; set NUMBA_CACHE_DIR to choose another"
            self.progress.say(f"compiled kernels are kept in {cache.folder()}: {why}")
        self._open(resume)
        if not resume:
            self._output()
            self._save()
        for t in times:
            if self._must_stop():
                break
            self.sim.evolve(t, self._after_step, only_looks=True)
            if self.sim.time >= t:
                self._output()
        self._save()  # the closing kick is still open: a longer run continues as if it had not stopped here
        return self._finish() if self.put_out >= times[-1] else self._stopped()

    def where(self) -> str:
        """Return the time and step, for messages."""
        if not hasattr(self, "sim"):
            return "before the first step"
        return f"at t = {self._show(self.sim.time)}, step {self.sim.state.step}"

    def way_back(self) -> str:
        """Return how to resume from the last checkpoint, for messages."""
        if self.saved_time is None:
            return "There is no checkpoint yet."
        command = f"discsim run {self.directory / 'scene.toml'} -o {self.directory} --resume"
        return f"{self.checkpoints.last} is a checkpoint at t = {self._show(self.saved_time)}; resume with: {command}"

    def close(self) -> None:
        self.progress.close()
        if hasattr(self, "records"):
            with suppress(OSError):  # a full disk was reported before
                self.records.close()
        remove_copies(self.copied)
        self.held.close()

    def _show(self, t: float) -> str:
        return self.scene.units.show_time(t)

    # Starting

    def _enter(self, resume: bool) -> tuple[bool, bool, float]:
        """Lock the directory; return whether it is locked, whether there is a run to resume, and the time of that
        run.
        """
        locked = self.held.enter_context(held(self.directory))
        refuse_directory(self.directory, resume)
        resume = resume and self._can_go_on()
        return locked, resume, self._time_to_resume() if resume else self.put_out

    def _nothing_left(self, reached: float) -> int:
        """Tidy up after a run that was at its end already, and return the exit status."""
        sweep(self.directory)
        if not self.figure.exists() and self._snapshot(self.snapshots - 1).exists():
            self._draw()  # the run was killed before it drew the figure
        self.progress.say(f"{self.directory}: already finished, at t = {self._show(reached)}")
        return DONE

    def _copy_files(self) -> None:
        self.scene = with_own_files(self.scene, self.directory, self.copied)

    def _can_go_on(self) -> bool:
        """Return whether the directory has a checkpoint.

        Without one the scene must be that of the run there, which then starts again.
        """
        if not only_begun(self.directory):
            return True
        refuse_another(self.directory / "scene.toml", scene_there(self.directory), self.scene)
        self.progress.say(f"{self.directory}: no checkpoint was written yet; the run restarts from the beginning")
        return False

    def _time_to_resume(self) -> float:
        """Return the time of the checkpoint, and read the number and the last time of its snapshots.

        Raises SceneError if the checkpoint is of another scene.
        """
        groups, values = self.checkpoints.newest()
        refuse_another(self.checkpoints.chosen, groups["scene"]["text"].tobytes(), self.scene)
        reached = values.number("time")
        self.snapshots, self.put_out = values.whole("snapshots", 1, MOST_SNAPSHOTS), values.number("put_out")
        if self.put_out > reached:
            values.refuse("put_out", f"at most the checkpoint's time, {reached:g}")
        self.checkpoints.refuse_to_lose(self.directory / "snapshots", self.snapshots, self.put_out)
        if self.checkpoints.fault:
            goes_on = f"the run resumes from {self.checkpoints.chosen}, at t = {self._show(reached)}"
            self.progress.say(f"warning: {self.checkpoints.fault}; {goes_on}")
        if remark := other_version(values):
            self.progress.say(f"warning: {remark}")
        return reached

    def _simulation(self, to_restore: bool) -> Simulation:
        return Simulation(self.scene, to_restore=to_restore)

    def _announce(self, locked: bool) -> None:
        say = self.progress.say
        say(f"discsim {__version__}: {self.scene.title or 'untitled scene'}, into {self.directory}")
        say(f"command: {command()}")
        say(f"effects: {', '.join(self.scene.effects)}")
        for name, text in effect_rows(self.scene):
            say(f"{name}: {text}")
        for line in warnings(self.scene):
            say(f"warning: {line}")
        if not locked:
            say(f"warning: {self.directory} cannot be locked: do not start a second run in it, as files would mix")
        say("loading kernels")

    def _open(self, resume: bool) -> None:
        """Open the directory's files, and restore the state if the run is resumed."""
        sim = self.sim
        self.records = self._tables()
        remarks = self._take_up() if resume else []
        self._open_files(resume)
        self.costs_before = self.costs_after_first = sim.costs.copy()
        with sim.closed():  # computes the first forces, which set the first step
            self.time, self.next_set_by = sim.time, self._limiter()
        self.set_by = self.set_by or self.next_set_by
        if resume:
            self.progress.say(f"resumed {self.where()}")
            for line in remarks:
                self.progress.say(f"warning: {line}")

    def _tables(self) -> Records:
        return Records(self.scene, self.directory)

    def _open_files(self, resume: bool) -> None:
        """Remove what the run would make again, and open the files that it appends to."""
        folder = self.directory / "snapshots"
        sweep(self.directory)
        self.checkpoints.settle()
        with replace_atomically(self.directory / "scene.toml") as temporary:
            temporary.write_text(self.scene.text, encoding="utf-8")
        self.copied.clear()  # the scene file in the directory refers to the copies now
        folder.mkdir(exist_ok=True)
        for path in later_snapshots(folder, self.snapshots):
            path.unlink()
        tidy(self.directory)
        tidy(folder)
        self.progress.open_log(self.directory / "run.log", resume)
        self.records.open()

    def _take_up(self) -> list[str]:
        """Restore the state of the checkpoint and the rows up to it, and return remarks on lost rows.

        Writes no file.
        """
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", OtherVersionWarning)  # reported before
            values = self._restore(self.checkpoints.chosen)
        self.saved_time = self.sim.time
        self.dt, self.set_by = values.number("dt", 0.0), values.text("set_by")
        return self._take_up_rows(values)

    def _take_up_rows(self, values: Values) -> list[str]:
        return self.records.take_up(self.sim.state.step, values)

    def _restore(self, path: Path) -> Values:
        return self.sim.restore(path)

    # Stepping

    def _after_step(self) -> bool:
        """Write the rows, progress and checkpoints that are due, and return whether the run must stop."""
        state = self.sim.state
        self.dt, self.time, self.set_by = state.time - self.time, state.time, self.next_set_by
        self.next_set_by = self._limiter()
        self._forget_compilation()
        self.records.add_companions(state, self.dt)
        if state.step % self.rows_every == 0:
            with self.sim.closed():
                self._add_row()
        self.progress.step(state, self.dt, self.set_by)
        if self._must_save():
            self._save()
        return self._must_stop()

    def _limiter(self) -> str:
        """Return what sets the next step, which may be shorter to land on an output."""
        return self.sim.limited_by if self.scene.run.timestep is None else "run.timestep"

    def _must_save(self) -> bool:
        return time.monotonic() - self.saved >= self.scene.run.checkpoint_every

    def _must_stop(self) -> bool:
        """Return whether a signal or run.walltime ends the run."""
        walltime = self.scene.run.walltime
        late = walltime is not None and time.monotonic() - self.begun >= walltime
        return late or self.interrupts.number > 0

    def _forget_compilation(self) -> None:
        """Remove the first step, in which kernels compiled, from the costs once the second is made."""
        self.steps += 1
        if self.steps == 1:
            self.costs_after_first, self.cpu_after_first = self.sim.costs.copy(), time.process_time()
        elif self.steps == 2:
            self.sim.costs.forget(self.costs_before, self.costs_after_first)

    # Writing

    def _output(self) -> None:
        """Write the next snapshot, with its row and the costs so far."""
        sim = self.sim
        open_step = open_step_of(sim.state, kick_effect(sim.effects) is not None)
        with sim.closed() as state:
            extra = columns(state, sim.effects.values())
            gas = with_present_pressure(state)
            path = self._snapshot(self.snapshots)
            write_snapshot(path, self.scene, state.time, gas, state.dust, extra, state.bodies, open_step)
            self._add_row()
            if state.step == 0:
                self.records.add_companions(state, 0.0)
        sim.costs.write(self.directory / "costs.csv")
        self.put_out = sim.time
        self.progress.line(sim.state, self.dt, self.set_by, f"snapshot {self.snapshots:04d}")
        self.snapshots += 1

    def _snapshot(self, number: int) -> Path:
        return self.directory / "snapshots" / f"{number:04d}.h5"

    def _add_row(self) -> None:
        self.records.add_history(self.sim.state, self.sim.effects, self.dt, self.set_by)

    def _save(self) -> None:
        self._write_checkpoint(hdf5.create)
        tidy(self.directory)
        self.saved, self.saved_time = time.monotonic(), self.sim.time

    def _write_checkpoint(self, into: Any) -> None:
        """Write a checkpoint of the present state, and keep the one before it."""
        self.records.sync()
        notes: dict[str, Scalar] = {"snapshots": self.snapshots, "put_out": self.put_out, **self.records.counts}
        sim, costs = self.sim, self.sim.costs
        if self.steps < 2:  # without the first step, in which kernels compiled
            sim.costs = self.costs_before
        try:
            groups, values = sim.contents()
        finally:
            sim.costs = costs
        values |= {**notes, "dt": self.dt, "set_by": self.set_by}
        write_checkpoint(self.checkpoints.last, groups, values, self.checkpoints.before, into)

    # Ending

    def _stopped(self) -> int:
        number = self.interrupts.number
        if number:
            name = signal.Signals(number).name
            self.progress.fail(f"interrupted by {name} {self.where()}. {self.way_back()}")
            return 128 + number
        self.progress.say(f"stopped by run.walltime {self.where()}. {self.way_back()}")
        return DONE

    def _finish(self) -> int:
        cost = self._cost()
        self._draw()
        say = self.progress.say
        say(f"done {self.where()}, after {clock(time.monotonic() - self.begun)}")
        say(f"output  {self.directory}: {self.snapshots} snapshots, {self.records.names}, costs.csv, run.log")
        say(f"figure  {self.figure}")
        say(f"cost    {cost}")
        if self.steps >= LONG_RUN:
            cpu, wall = time.process_time() - self.cpu_after_first, time.monotonic() - self.begun
            learn(self.scene, self.steps - 1, cpu, wall)
        return DONE

    def _draw(self) -> None:
        """Draw the figure of the last snapshot; the file appears only when it is complete."""
        from discsim.output.figure import last_state_figure  # slow to import, and needed only here

        with replace_atomically(self.figure, ".png") as temporary:
            last_state_figure(self._snapshot(self.snapshots - 1), temporary)

    def _cost(self) -> str:
        """Return the shares of the effects and of everything else in the CPU time since the first step; they sum to
        1.
        """
        costs, words = self.sim.costs, "of all CPU time"
        if self.steps < 2:  # kernels compile in the first step, and a run that was at its end makes no step
            shares, words = costs.shares, "of the effects' CPU time"
        else:
            before, cpu = self.costs_before.seconds, time.process_time() - self.cpu_after_first
            shares = {name: (spent - before.get(name, 0.0)) / cpu for name, spent in costs.seconds.items()}
            shares["outside the effects"] = 1.0 - sum(shares.values())
        return f"{', '.join(f'{name} {share:.0%}' for name, share in shares.items())} {words}"
