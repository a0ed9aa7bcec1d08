"""Run on several MPI ranks, each with its own particles. Only rank 0 writes the common files and messages.

If rank 0 fails in such an operation, its exception is raised on all ranks, and all end in the same way. If a rank fails
elsewhere, the others would wait for it without end: the job is aborted after ABORT_DELAY seconds.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from discsim.effects.base import Effect, kick_effect_name
from discsim.numerics.state import State
from discsim.output.checkpoint import Values
from discsim.output.contents import Extent, extent_of
from discsim.output.history import history_row
from discsim.output.layout import GROUPS
from discsim.output.open_step import KICKED, open_step_of
from discsim.output.parts import remove_unused_parts
from discsim.output.snapshot import write_snapshot
from discsim.printable import printable
from discsim.ranks import files
from discsim.ranks.agreed import on_root, raise_together
from discsim.ranks.begin import divide
from discsim.ranks.comm import Comm
from discsim.ranks.gathering import gathered, gathered_columns
from discsim.ranks.start import begun
from discsim.ranks.world import Ranks
from discsim.run.outputs import effect_columns, with_present_pressure
from discsim.run.progress import Progress
from discsim.run.records import Records
from discsim.run.runner import Run, execute_and_report
from discsim.run.simulation import Simulation
from discsim.scene import Scene

SNAPSHOT_ARRAYS = {"mass", "ids", *(name for _, fields in GROUPS.values() for name in fields)}  # arrays in snapshots
OPEN_STEP_ARRAYS = {"mass", "ids", *KICKED, "h_before"}  # arrays for an open step in snapshots
ABORT_DELAY = 3.0  # seconds that ranks wait for all others to end, before the job is aborted
FAILED = 1  # exit status of unforeseen errors


def run_on_ranks(scene: Scene, directory: Path, resume: bool, quiet: bool) -> int:
    """Run a scene on all ranks, as `run_scene`; return the exit status, which is the same on each rank.

    The job is aborted if not all ranks come to their end.
    """
    comm = Comm()
    alarm = comm.mpi.Dup()  # apart from operations that may still be pending
    run = DividedRun(scene, directory, quiet, comm)
    try:
        status = execute_and_report(run, resume)
    except BaseException:
        status, run.progress.failed = FAILED, traceback.format_exc()
    request, late = alarm.Ibarrier(), time.monotonic() + ABORT_DELAY + (0.0 if comm.rank == 0 else 1.0)
    while not request.Test():
        if time.monotonic() > late:
            if run.progress.failed:
                print(run.progress.failed, file=sys.stderr, flush=True)
            comm.mpi.Abort(status or FAILED)
        time.sleep(0.01)
    if comm.rank == 0 and run.progress.failed:
        print(run.progress.failed, file=sys.stderr, flush=True)
    return int(comm.mpi.bcast(status))


class RootReporter(Progress):
    """Progress messages of rank 0. An error is stored in `failed`, and printed when all ranks have ended."""

    failed = ""

    def fail(self, *lines: str) -> None:
        self.screen.clear()
        self.failed = "\n".join(map(printable, lines))
        self.note(self.failed)


class NullReporter(RootReporter):
    """Progress messages of the other ranks: none, except that an error is stored in `failed`."""

    def open_log(self, path: Path, resume: bool) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    def compiling(self, count: int, name: str) -> None:
        pass

    def step(self, state: State, dt: float, set_by: str) -> None:
        pass

    def line(self, state: State, dt: float, set_by: str, end: str = "") -> None:
        pass


class NullRecords(Records):
    """Tables on the other ranks, which do not write them."""

    def restore_rows(self, step: int, values: Values) -> list[str]:
        return []

    def open(self) -> None:
        pass

    def add_history(self, state: State, effects: Mapping[str, Effect], dt: float, set_by: str) -> None:
        history_row(state, effects, dt, set_by)  # totals are collective

    def add_companions(self, state: State, dt: float) -> None:
        pass


class DividedRun(Run):
    """Part of a run on one rank; leads: whether this is rank 0."""

    ranks: Ranks

    def __init__(self, scene: Scene, directory: Path, quiet: bool, comm: Comm) -> None:
        super().__init__(scene, directory, quiet)
        self.comm, self.leads = comm, comm.rank == 0
        self.progress: RootReporter = (RootReporter if self.leads else NullReporter)(scene, quiet)
        self.compilation.progress = self.progress

    def on_root(self, do: Callable[[], Any]) -> Any:
        return on_root(self.comm, do)

    def _enter_directory(self, resume: bool) -> tuple[bool, bool, float]:
        entered = super()._enter_directory
        found, self.snapshots, self.last_output, self.checkpoints = self.on_root(
            lambda: (entered(resume), self.snapshots, self.last_output, self.checkpoints)
        )
        return found

    def _finish_ended_run(self, reached: float) -> int:
        return int(self.on_root(lambda: super(DividedRun, self)._finish_ended_run(reached)))

    def _copy_files(self) -> None:
        self.on_root(super()._copy_files)

    def _make_records(self) -> Records:
        return super()._make_records() if self.leads else NullRecords(self.scene, self.directory)

    def _make_simulation(self, to_restore: bool) -> Simulation:
        return Simulation(self.scene, begun=begun(self.comm, self.scene, to_restore))

    def _restore(self, path: Path) -> Values:
        return raise_together(self.comm, lambda: self.sim.restore(path, (self.comm.rank, self.comm.size)))

    def _restore_rows(self, values: Values) -> list[str]:
        return list(self.on_root(lambda: super(DividedRun, self)._restore_rows(values)))

    def _open_files(self, resume: bool) -> None:
        self.on_root(lambda: super(DividedRun, self)._open_files(resume))  # after all ranks have read the checkpoint
        self.ranks = divide(self.sim, self.comm, alike=False)

    def _add_row(self) -> None:
        raise_together(self.comm, super()._add_row)  # for errors after the collective part

    def _checkpoint_is_due(self) -> bool:
        return bool(self.ranks.most(super()._checkpoint_is_due()))

    def _must_stop(self) -> bool:
        self.interrupts.number = self.ranks.most(self.interrupts.number)
        return bool(self.ranks.most(super()._must_stop()))

    def _write_output(self) -> None:
        sim, comm, divided = self.sim, self.comm, files.write_in_parts(self.comm, self.sim.state)
        unfinished = gathered(comm, sim.state, "ids", divided, OPEN_STEP_ARRAYS)
        open_step = open_step_of(unfinished, kick_effect_name(sim.effects) is not None)
        del unfinished  # to free memory
        with sim.closed() as state:
            extra = gathered_columns(comm, state, effect_columns(state, sim.effects.values()), "ids", divided)
            extent = self._extent(state)
            shown = gathered(comm, replace(state, gas=with_present_pressure(state)), "ids", divided, SNAPSHOT_ARRAYS)
            path = self._snapshot_path(self.snapshots)
            files.write(
                comm,
                path,
                divided,
                lambda into: write_snapshot(
                    path, self.scene, state.time, shown.gas, shown.dust, extra, state.bodies, open_step, extent, into
                ),
            )
            self._add_row()
            if state.step == 0:
                self.records.add_companions(state, 0.0)
        sim.costs.gather()
        self.on_root(lambda: sim.costs.write(self.directory / "costs.csv"))
        self.last_output = sim.time
        self.progress.line(sim.state, self.dt, self.set_by, f"snapshot {self.snapshots:04d}")
        self.snapshots += 1

    def _extent(self, state: State) -> Extent:
        """Return the extent in space and the numbers of the particles of all ranks."""
        lower, upper, counts = extent_of(self.scene, state.gas, state.dust, state.bodies)
        counts |= {name: p.global_count for name, p in state.species.items()}
        return Extent(self.ranks.least(lower), self.ranks.most(upper), counts)

    def _save_checkpoint(self) -> None:
        own, write_checkpoint = self.sim.state, super()._write_checkpoint
        divided = files.write_in_parts(self.comm, own)
        share = gathered(self.comm, own, divided=divided)

        def fill(into: Any) -> None:
            self.sim.state = share
            try:
                write_checkpoint(into)
            finally:
                self.sim.state = own

        files.write(self.comm, self.checkpoints.last, divided, fill, self.checkpoints.before)
        self.on_root(lambda: remove_unused_parts(self.directory))
        self.saved_at, self.saved_time = time.monotonic(), self.sim.time

    def _finish(self) -> int:
        return int(self.on_root(super()._finish))
