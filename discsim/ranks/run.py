"""Run on several MPI ranks, each with its own particles. Only rank 0 writes the common files and messages.

If rank 0 fails to write them, its exception is raised on all ranks, and all end in the same way. If a rank fails
elsewhere, the other ranks would wait without end, so the job is then aborted after ABORT_DELAY seconds.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from discsim.effects.base import Effect
from discsim.numerics.state import State
from discsim.output.checkpoint import Values
from discsim.output.history import history_row
from discsim.output.layout import GROUPS
from discsim.output.open_step import GUESSES, KICKED
from discsim.output.parts import remove_unused_parts
from discsim.output.snapshot_writer import Extent, extent_of, write_snapshot
from discsim.printable import printable
from discsim.ranks import output
from discsim.ranks.comm import Comm
from discsim.ranks.start import begin_on_root, divide
from discsim.ranks.world import ParallelComm
from discsim.run.outputs import effect_columns, open_step_between, with_present_pressure
from discsim.run.progress import Progress
from discsim.run.records import Records
from discsim.run.runner import Run, execute_and_report
from discsim.run.simulation import Simulation
from discsim.scene import Scene

SNAPSHOT_ARRAYS = {"mass", "ids", *(name for _, fields in GROUPS.values() for name in fields)}  # arrays in snapshots
OPEN_STEP_ARRAYS = {"mass", "ids", *KICKED, *GUESSES}  # arrays from which a snapshot's open step is made
ABORT_DELAY = 3.0  # seconds that ranks wait for all others to end, before the job is aborted
FAILED = 1  # exit status of unforeseen errors


def run_on_ranks(scene: Scene, directory: Path, resume: bool, quiet: bool) -> int:
    """Run a scene on all ranks, as `run_scene`; return the exit status, which is the same on each rank.

    The job is aborted unless all ranks return within some seconds of each other.
    """
    comm = Comm()
    ended = comm.mpi.Dup()  # a communicator of its own, as operations of `comm` may still be pending
    run = DividedRun(scene, directory, quiet, comm)
    try:
        status = execute_and_report(run, resume)
    except BaseException:
        status, run.progress.failed = FAILED, traceback.format_exc()
    request, late = ended.Ibarrier(), time.monotonic() + ABORT_DELAY + (0.0 if comm.rank == 0 else 1.0)
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
    """Progress messages of rank 0; failed: message of an error, which is printed when all ranks have ended."""

    failed = ""

    def fail(self, *lines: str) -> None:
        self.screen.clear()
        self.failed = "\n".join(map(printable, lines))
        self.note(self.failed)


class NullReporter(RootReporter):
    """`RootReporter` of the other ranks, which writes no messages; an error is stored in `failed`."""

    def open_log(self, path: Path, resume: bool) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    def warn(self, text: str) -> None:
        pass

    def compiling(self, count: int, name: str) -> None:
        pass

    def step(self, state: State, dt: float, set_by: str) -> None:
        pass

    def line(self, state: State, dt: float, set_by: str, end: str = "") -> None:
        pass


class NullRecords(Records):
    """`Records` of the other ranks, which write no tables."""

    def restore_rows(self, step: int, values: Values) -> list[str]:
        return []

    def open(self) -> None:
        pass

    def add_history(self, state: State, effects: Mapping[str, Effect], dt: float, set_by: str) -> None:
        history_row(state, effects, dt, set_by)  # totals are collective

    def add_companions(self, state: State, dt: float) -> None:
        pass


class DividedRun(Run):
    """Run on one rank of several."""

    ranks: ParallelComm

    def __init__(self, scene: Scene, directory: Path, quiet: bool, comm: Comm) -> None:
        super().__init__(scene, directory, quiet)
        self.comm = comm
        self.progress: RootReporter = (RootReporter if comm.rank == 0 else NullReporter)(scene, quiet)
        self.compilation.progress = self.progress

    def _enter_directory(self, resume: bool) -> tuple[bool, bool, float]:
        entered = super()._enter_directory
        found, self.snapshots, self.last_output, self.checkpoints = self.comm.on_root(
            lambda: (entered(resume), self.snapshots, self.last_output, self.checkpoints)
        )
        return found

    def _finish_ended_run(self, reached: float) -> int:
        return int(self.comm.on_root(lambda: super(DividedRun, self)._finish_ended_run(reached)))

    def _copy_files(self) -> None:
        self.comm.on_root(super()._copy_files)

    def _make_records(self) -> Records:
        return super()._make_records() if self.comm.rank == 0 else NullRecords(self.scene, self.directory)

    def _make_simulation(self, to_restore: bool) -> Simulation:
        return Simulation(self.scene, begun=begin_on_root(self.comm, self.scene, to_restore))

    def _restore(self, path: Path) -> Values:
        return self.comm.raise_on_all(lambda: self.sim.restore(path, (self.comm.rank, self.comm.size)))

    def _restore_rows(self, values: Values) -> list[str]:
        return list(self.comm.on_root(lambda: super(DividedRun, self)._restore_rows(values)))

    def _open_files(self, resume: bool) -> None:
        # Rank 0 removes files only now, after all ranks have read the checkpoint.
        self.comm.on_root(lambda: super(DividedRun, self)._open_files(resume))
        self.ranks = divide(self.sim, self.comm)

    def _add_row(self) -> None:
        self.comm.raise_on_all(super()._add_row)  # rank 0 may fail to write the row, after the collective part

    def _checkpoint_is_due(self) -> bool:
        return bool(self.ranks.max(super()._checkpoint_is_due()))

    def _must_stop(self) -> bool:
        self.interrupts.number = self.ranks.max(self.interrupts.number)
        return bool(self.ranks.max(super()._must_stop()))

    def _write_output(self) -> None:
        sim, comm, in_parts = self.sim, self.comm, output.needs_parts(self.comm, self.sim.state)
        unfinished = output.gather_state(comm, sim.state, "ids", in_parts, OPEN_STEP_ARRAYS)
        open_step = open_step_between(unfinished, sim.effects)
        del unfinished  # to free memory
        with sim.closed() as state:
            extra = output.gather_columns(comm, state, effect_columns(state, sim.effects.values()), "ids", in_parts)
            present = replace(state, gas=with_present_pressure(state))
            shown = output.gather_state(comm, present, "ids", in_parts, SNAPSHOT_ARRAYS)
            path = self._snapshot_path(self.snapshots)
            given = state.time, shown.gas, shown.dust, extra, state.bodies, open_step, self._extent(state)
            output.write(comm, path, in_parts, lambda create: write_snapshot(path, self.scene, *given, create))
            self._add_row()
            if state.step == 0:
                self.records.add_companions(state, 0.0)
        sim.costs.gather()
        self.comm.on_root(lambda: sim.costs.write(self.directory / "costs.csv"))
        self.last_output = sim.time
        self.progress.line(sim.state, self.dt, self.set_by, f"snapshot {self.snapshots:04d}")
        self.snapshots += 1

    def _extent(self, state: State) -> Extent:
        """Return the extent in space and the numbers of the particles of all ranks."""
        lower, upper, counts = extent_of(self.scene, state.gas, state.dust, state.bodies)
        counts |= {name: p.global_count for name, p in state.species.items()}
        return Extent(self.ranks.min(lower), self.ranks.max(upper), counts)

    def _save_checkpoint(self) -> None:
        local, write_checkpoint = self.sim.state, super()._write_checkpoint
        in_parts = output.needs_parts(self.comm, local)
        written = output.gather_state(self.comm, local, in_parts=in_parts)

        def fill(create: Any) -> None:
            self.sim.state = written
            try:
                write_checkpoint(create)
            finally:
                self.sim.state = local

        output.write(self.comm, self.checkpoints.last, in_parts, fill, self.checkpoints.before)
        self.comm.on_root(lambda: remove_unused_parts(self.directory))
        self.saved_at, self.saved_time = time.monotonic(), self.sim.time

    def _finish(self) -> int:
        return int(self.comm.on_root(super()._finish))
