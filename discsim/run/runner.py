"""Run of a validated scene in a directory: outputs, checkpoints, interrupts and messages."""

from __future__ import annotations

import signal
import time
import traceback
import warnings as python_warnings
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from numba.core import caching, event

from discsim.initial import start_time
from discsim.jit import cache
from discsim.output import hdf5
from discsim.output.checkpoint import OtherVersionWarning, Scalar, Values, other_version_warning, write_checkpoint
from discsim.output.files import command_line, replace_atomically
from discsim.output.parts import remove_unused_parts
from discsim.preview.derived import effect_rows
from discsim.preview.forecast import store_slowness
from discsim.preview.warnings import warnings
from discsim.printable import UserError
from discsim.run.checkpoint_contents import refuse_other_forces
from discsim.run.checkpoints import Checkpoints, later_snapshots
from discsim.run.directory import (
    copy_input_files,
    ended_before_checkpoint,
    locked_directory,
    read_scene_file,
    remove_copies,
    remove_partial_files,
    require_usable_directory,
)
from discsim.run.interrupts import Interrupts, run_signals
from discsim.run.outputs import due_times, open_step_between, write_state
from discsim.run.progress import CompilationListener, Progress
from discsim.run.records import Records
from discsim.run.simulation import PhysicsError, Simulation
from discsim.scene import Scene
from discsim.scene.differences import refuse_changed_scene
from discsim.scene.fields import MAX_SNAPSHOTS
from discsim.scene.units import clock
from discsim.userfiles import TOO_MANY_OPEN, system_message
from discsim.version import __version__

DONE, NOT_WRITTEN, WRONG_INPUT, PHYSICS = 0, 1, 2, 3  # exit statuses; 128 + the number of the signal if interrupted
FEW_PARTICLES = 20_000  # number of particles below which history.csv has a row for every step
STEPS_PER_ROW = 16  # number of steps between rows of history.csv in larger runs
MIN_STEPS_FOR_FORECAST = 100  # smallest number of steps after which the cost of a run is stored for forecasts


def run_scene(scene: Scene, directory: Path, resume: bool = False, quiet: bool = False) -> int:
    """Run `scene` with its files in `directory`, or resume the run in this directory, and return the exit status.

    0: done, or stopped by run.walltime. 1: a file cannot be written. 2: the run cannot start, or cannot be resumed. 3:
    stopped by a numerical failure or lack of memory. 128 + signal: interrupted. For an error there is one message on
    stderr.
    """
    return execute_and_report(Run(scene, Path(directory), quiet), resume)


def execute_and_report(run: Run, resume: bool) -> int:
    """Execute a run, report its errors, close its files, and return the exit status, as in `run_scene`."""
    directory = run.directory
    fail = run.progress.fail
    with run.interrupts, event.install_listener("numba:compile", run.compilation):
        try:
            return run.execute(resume)
        except PhysicsError as fault:
            fail(f"stopped by a numerical failure {run.time_and_step()}: {fault}", run.resume_advice())
            return PHYSICS
        except UserError as fault:
            fail(*str(fault).split("\n"))
            return WRONG_INPUT
        except MemoryError as fault:
            fail(f"out of memory {run.time_and_step()}: {fault or 'an array does not fit'}", run.resume_advice())
            return PHYSICS
        except OSError as fault:
            if raised_in_numba_cache(fault) and fault.errno not in TOO_MANY_OPEN:
                reason = fault.strerror or str(fault)
                cure = "Free disk space there, or set NUMBA_CACHE_DIR to another directory"
                folder, cure = cache.kernel_folder(), f"{cure}. {run.resume_advice()}"
                fail(f"{folder}: compiled kernels cannot be written: {reason}. {cure}")
            else:
                fail(f"{system_message(fault, 'written', directory)}. {run.resume_advice()}")
            return NOT_WRITTEN
        except cache.CacheError as fault:
            fail(str(fault))
            return NOT_WRITTEN
        except KeyboardInterrupt:
            fail(f"stopped immediately. {run.resume_advice()}")
            return 128 + run.interrupts.number
        finally:
            run.close()


def raised_in_numba_cache(fault: BaseException) -> bool:
    """Return whether an exception was raised while numba wrote its cache."""
    frames = traceback.walk_tb(fault.__traceback__)
    return any(frame.f_globals.get("__name__") == caching.__name__ for frame, _ in frames)


class Run:
    """Simulation of a scene, and the files of its directory.

    snapshots: number of snapshots written. steps: number of steps that this process has made. last_output: time of
    the last snapshot. dt, set_by: length of the last step, and name of the limit that set it. time: time after the
    last step. next_set_by: name of the limit that sets the next step. copied: copies of input files, made before the
    run begins.
    """

    sim: Simulation
    records: Records

    def __init__(self, scene: Scene, directory: Path, quiet: bool) -> None:
        self.scene, self.directory = scene, directory
        self.progress, self.interrupts = Progress(scene, quiet), Interrupts(run_signals())
        self.compilation = CompilationListener(self.progress)
        self.checkpoints, self.figure = Checkpoints(directory), directory / "last_state.png"
        self.started_at = self.saved_at = time.monotonic()
        self.saved_time: float | None = None
        self.snapshots = self.steps = 0
        self.last_output = start_time(scene)
        self.dt, self.set_by = 0.0, ""
        self.lock = ExitStack()
        self.copied: list[Path] = []
        count = (scene.gas.particles if scene.gas else 0) + sum(p.particles for p in scene.dust or ())
        self.steps_per_row = 1 if count < FEW_PARTICLES else STEPS_PER_ROW

    def execute(self, resume: bool) -> int:
        """Start or resume the run, step to its end, and return the exit status."""
        locked, resume, reached = self._enter_directory(resume)
        times = due_times(self.scene.run, reached, self.last_output)
        if not times:
            return self._finish_ended_run(reached)
        self._announce(locked)
        self._copy_files()
        self.sim = self._make_simulation(resume)
        if self.sim.relaxed is not None:
            self.progress.say(str(self.sim.relaxed))
        if cache.is_temporary():
            why = "numba's usual folders are not writable; set NUMBA_CACHE_DIR to choose another"
            self.progress.say(f"compiled kernels are kept in {cache.kernel_folder()}: {why}")
        self._begin_or_resume(resume)
        if not resume:
            self._write_output()
            self._save_checkpoint()
        for t in times:
            if self._must_stop():
                break
            self.sim.evolve(t, self._after_step, read_only=True)
            if self.sim.time >= t:
                self._write_output()
        # The checkpoint is without the closing kick, so that a longer run continues as if it had not stopped here.
        self._save_checkpoint()
        return self._finish() if self.last_output >= times[-1] else self._report_stop()

    def time_and_step(self) -> str:
        """Return the present time and step as text for messages."""
        if not hasattr(self, "sim"):
            return "before the first step"
        return f"at t = {self._time_text(self.sim.time)}, step {self.sim.state.step}"

    def resume_advice(self) -> str:
        """Return a text for messages on how to resume the run from its last checkpoint."""
        if self.saved_time is None:
            return "There is no checkpoint yet."
        command = f"discsim run {self.directory / 'scene.toml'} -o {self.directory} --resume"
        saved = f"{self.checkpoints.last} is a checkpoint at t = {self._time_text(self.saved_time)}"
        return f"{saved}; resume with: {command}"

    def close(self) -> None:
        """Close the files, remove copies of input files if the run did not begin, and release the lock."""
        self.progress.close()
        if hasattr(self, "records"):
            with suppress(OSError):  # a full disk was reported before
                self.records.close()
        remove_copies(self.copied)
        self.lock.close()

    def _time_text(self, t: float) -> str:
        return self.scene.show_time(t)

    # Starting

    def _enter_directory(self, resume: bool) -> tuple[bool, bool, float]:
        """Lock the directory, and read the checkpoint if the run is to be resumed.

        Return whether the directory is locked, whether there is a checkpoint to resume from, and the time at which the
        steps begin, which is the time of the checkpoint or the start of the scene.
        """
        locked = self.lock.enter_context(locked_directory(self.directory))
        require_usable_directory(self.directory, resume)
        resume = resume and self._has_checkpoint()
        return locked, resume, self._time_to_resume() if resume else self.last_output

    def _finish_ended_run(self, reached: float) -> int:
        """Clean the directory of a run that has already ended, draw a missing figure, and return the exit status."""
        remove_partial_files(self.directory)
        if not self.figure.exists() and self._snapshot_path(self.snapshots - 1).exists():
            self._draw_figure()  # the run was killed before it drew the figure
        self.progress.say(f"{self.directory}: already finished, at t = {self._time_text(reached)}")
        return DONE

    def _copy_files(self) -> None:
        """Copy the input files of the scene into the directory, and set `scene` to a scene that names the copies."""
        self.scene = copy_input_files(self.scene, self.directory, self.copied)

    def _has_checkpoint(self) -> bool:
        """Return whether the directory has a checkpoint to resume from.

        Without a checkpoint the run restarts from the beginning. Its scene must then agree with scene.toml in the
        directory; otherwise raises SceneError.
        """
        if not ended_before_checkpoint(self.directory):
            return True
        refuse_changed_scene(self.directory / "scene.toml", read_scene_file(self.directory), self.scene)
        self.progress.say(f"{self.directory}: no checkpoint was written yet; the run restarts from the beginning")
        return False

    def _time_to_resume(self) -> float:
        """Return the time of the newest readable checkpoint, and set `snapshots` and `last_output` from it.

        Raises SceneError if the checkpoint is of another scene, and CheckpointError if its run had added forces.
        """
        groups, values = self.checkpoints.newest()
        refuse_changed_scene(self.checkpoints.chosen, groups["scene"]["text"].tobytes(), self.scene)
        refuse_other_forces(values, {})
        reached = values.number("time")
        self.snapshots, self.last_output = values.whole("snapshots", 1, MAX_SNAPSHOTS), values.number("put_out")
        if self.last_output > reached:
            values.refuse("put_out", f"at most the checkpoint's time, {reached:g}")
        self.checkpoints.refuse_lost_snapshots(self.directory / "snapshots", self.snapshots, self.last_output)
        if self.checkpoints.fault:
            goes_on = f"the run resumes from {self.checkpoints.chosen}, at t = {self._time_text(reached)}"
            self.progress.warn(f"{self.checkpoints.fault}; {goes_on}")
        if remark := other_version_warning(values):
            self.progress.warn(remark)
        return reached

    def _make_simulation(self, to_restore: bool) -> Simulation:
        """Return the simulation of the scene; to_restore: as in `Simulation`."""
        return Simulation(self.scene, to_restore=to_restore)

    def _announce(self, locked: bool) -> None:
        """Report the scene, the command, derived numbers and warnings. locked: whether the directory is locked."""
        say = self.progress.say
        say(f"discsim {__version__}: {self.scene.title or 'untitled scene'}, into {self.directory}")
        say(f"command: {command_line()}")
        say(f"effects: {', '.join(self.scene.effects)}")
        for name, text in effect_rows(self.scene):
            say(f"{name}: {text}")
        for line in warnings(self.scene):
            self.progress.warn(line)
        if not locked:
            self.progress.warn(
                f"{self.directory} cannot be locked: do not start a second run in the directory, as files would mix"
            )
        say("loading kernels")

    def _begin_or_resume(self, resume: bool) -> None:
        """Restore the state if the run is resumed, open the files of the directory, and compute the first forces."""
        sim = self.sim
        self.records = self._make_records()
        remarks = self._restore_checkpoint() if resume else []
        self._open_files(resume)
        self.costs_before = self.costs_after_first = sim.costs.copy()
        with sim.closed():  # computes the first forces, which set the first step
            self.time, self.next_set_by = sim.time, self._name_of_limiter()
        self.set_by = self.set_by or self.next_set_by
        if resume:
            self.progress.say(f"resumed {self.time_and_step()}")
            for line in remarks:
                self.progress.warn(line)

    def _make_records(self) -> Records:
        return Records(self.scene, self.directory)

    def _open_files(self, resume: bool) -> None:
        """Remove files that the run will write again, such as later snapshots, and open the log and the tables."""
        folder = self.directory / "snapshots"
        remove_partial_files(self.directory)
        self.checkpoints.keep_chosen()
        with replace_atomically(self.directory / "scene.toml") as temporary:
            temporary.write_text(self.scene.text, encoding="utf-8")
        self.copied.clear()  # the scene file in the directory refers to the copies now
        folder.mkdir(exist_ok=True)
        for path in later_snapshots(folder, self.snapshots):
            path.unlink()
        remove_unused_parts(self.directory)
        remove_unused_parts(folder)
        self.progress.open_log(self.directory / "run.log", resume)
        self.records.open()

    def _restore_checkpoint(self) -> list[str]:
        """Restore the state from the checkpoint, and the rows of the tables that were written before the checkpoint.

        Return warnings about lost rows. No file is written.
        """
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", OtherVersionWarning)  # reported before
            values = self._restore(self.checkpoints.chosen)
        self.saved_time = self.sim.time
        self.dt, self.set_by = values.number("dt", 0.0), values.text("set_by")
        return self._restore_rows(values)

    def _restore_rows(self, values: Values) -> list[str]:
        """Read the rows of the tables up to the present step, and return warnings about lost rows."""
        return self.records.restore_rows(self.sim.state.step, values)

    def _restore(self, path: Path) -> Values:
        """Restore the simulation from the checkpoint at `path`, and return its single values."""
        return self.sim.restore(path)

    # Stepping

    def _after_step(self) -> bool:
        """Write the rows, progress and checkpoints that are due, and return whether the run must stop."""
        state = self.sim.state
        self.dt, self.time, self.set_by = state.time - self.time, state.time, self.next_set_by
        self.next_set_by = self._name_of_limiter()
        self._exclude_compilation_cost()
        self.records.add_companions(state, self.dt)
        if state.step % self.steps_per_row == 0:
            with self.sim.closed():
                self._add_row()
        self.progress.step(state, self.dt, self.set_by)
        if self._checkpoint_is_due():
            self._save_checkpoint()
        return self._must_stop()

    def _name_of_limiter(self) -> str:
        """Return the name of the effect or key that sets the next step, if no output time shortens the step."""
        return self.sim.limited_by if self.scene.run.timestep is None else "run.timestep"

    def _checkpoint_is_due(self) -> bool:
        return time.monotonic() - self.saved_at >= self.scene.run.checkpoint_every

    def _must_stop(self) -> bool:
        """Return whether the run must stop because of a signal or because of run.walltime."""
        walltime = self.scene.run.walltime
        late = walltime is not None and time.monotonic() - self.started_at >= walltime
        return late or self.interrupts.number > 0

    def _exclude_compilation_cost(self) -> None:
        """Count the step, and after the second step subtract the cost of the first, in which kernels compile."""
        self.steps += 1
        if self.steps == 1:
            self.costs_after_first, self.cpu_after_first = self.sim.costs.copy(), time.process_time()
        elif self.steps == 2:
            self.sim.costs.forget(self.costs_before, self.costs_after_first)

    # Writing

    def _write_output(self) -> None:
        """Write the next snapshot, a row of history.csv and costs.csv."""
        sim = self.sim
        open_step = open_step_between(sim.state, sim.effects)
        with sim.closed() as state:
            write_state(self._snapshot_path(self.snapshots), self.scene, state, sim.effects, open_step)
            self._add_row()
            if state.step == 0:
                self.records.add_companions(state, 0.0)
        sim.costs.write(self.directory / "costs.csv")
        self.last_output = sim.time
        self.progress.line(sim.state, self.dt, self.set_by, f"snapshot {self.snapshots:04d}")
        self.snapshots += 1

    def _snapshot_path(self, number: int) -> Path:
        return self.directory / "snapshots" / f"{number:04d}.h5"

    def _add_row(self) -> None:
        """Add the row of history.csv for the present state, which must include the closing kick."""
        self.records.add_history(self.sim.state, self.sim.effects, self.dt, self.set_by)

    def _save_checkpoint(self) -> None:
        """Write a checkpoint, remove parts of earlier ones, and set the time of the last checkpoint."""
        self._write_checkpoint(hdf5.create)
        remove_unused_parts(self.directory)
        self.saved_at, self.saved_time = time.monotonic(), self.sim.time

    def _write_checkpoint(self, into: Any) -> None:
        """Write a checkpoint of the present state, and keep the previous checkpoint under its other name.

        into: function that creates the file, as `hdf5.create`.
        """
        self.records.sync()
        notes: dict[str, Scalar] = {"snapshots": self.snapshots, "put_out": self.last_output, **self.records.counts}
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

    def _report_stop(self) -> int:
        """Report that a signal or run.walltime has stopped the run, and return the exit status."""
        number = self.interrupts.number
        if number:
            name = signal.Signals(number).name
            self.progress.fail(f"interrupted by {name} {self.time_and_step()}. {self.resume_advice()}")
            return 128 + number
        self.progress.say(f"stopped by run.walltime {self.time_and_step()}. {self.resume_advice()}")
        return DONE

    def _finish(self) -> int:
        """Draw the figure of the final state, report the end of the run, and return the exit status."""
        cost = self._cost_text()
        self._draw_figure()
        say = self.progress.say
        say(f"done {self.time_and_step()}, after {clock(time.monotonic() - self.started_at)}")
        say(f"output  {self.directory}: {self.snapshots} snapshots, {self.records.names}, costs.csv, run.log")
        say(f"figure  {self.figure}")
        say(f"cost    {cost}")
        if self.steps >= MIN_STEPS_FOR_FORECAST:
            cpu, wall = time.process_time() - self.cpu_after_first, time.monotonic() - self.started_at
            store_slowness(self.scene, self.steps - 1, cpu, wall)
        return DONE

    def _draw_figure(self) -> None:
        """Draw the figure of the last snapshot; the file appears only when it is complete."""
        from discsim.output.figure import last_state_figure  # slow to import, and needed only here

        with replace_atomically(self.figure, ".png") as temporary:
            last_state_figure(self._snapshot_path(self.snapshots - 1), temporary)

    def _cost_text(self) -> str:
        """Return a text with the fraction of the CPU time of each effect, and of all work outside the effects.

        The first step is excluded, as kernels compile in it. For fewer than two steps, the fractions are of the CPU
        time of all effects.
        """
        costs, whole = self.sim.costs, "of all CPU time"
        if self.steps < 2:  # kernels compile in the first step, and a run that was at its end makes no step
            shares, whole = costs.shares, "of the effects' CPU time"
        else:
            before, cpu = self.costs_before.seconds, time.process_time() - self.cpu_after_first
            shares = {name: (spent - before.get(name, 0.0)) / cpu for name, spent in costs.seconds.items()}
            shares["outside the effects"] = 1.0 - sum(shares.values())
        return f"{', '.join(f'{name} {share:.0%}' for name, share in shares.items())} {whole}"
