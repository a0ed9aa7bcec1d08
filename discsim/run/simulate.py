"""Run of a scene in a directory from Python, with the files of `discsim run`."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any

from numba.core import event

from discsim.output.run import Run, open_run
from discsim.printable import UserError
from discsim.run.directory import RUN_FILES
from discsim.run.interrupts import Interrupts
from discsim.run.runner import Run as Runner
from discsim.scene import Scene, load_scene


def simulate(
    scene: Scene | str | Path | dict[str, Any],
    directory: str | os.PathLike[str],
    *,
    resume: bool = False,
    progress: bool = False,
) -> Run:
    """Run a scene with its files in a directory, as `discsim run` does, and open the run.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        Scene, or the argument of `discsim.load_scene`.
    directory : str or path-like
        Directory of the run.
    resume : bool, optional
        Whether to continue a run that is already in the directory. If it is finished, it is opened. If there is none,
        a new run begins.
    progress : bool, optional
        Whether to show the lines of the command; run.log has them in any case. Warnings are shown without it too, on
        standard error.

    Returns
    -------
    Run
        The finished run, or the part up to `run.walltime`.

    Raises
    ------
    SceneError
        If the scene has faults, or differs from that of the run to be continued.
    UserError
        If the run cannot start or continue, as in a directory that is in use; or its subclass PhysicsError, if a
        number is not finite or the step has collapsed.
    OSError
        If a file cannot be written.
    KeyboardInterrupt
        After Ctrl-C, at the end of a step and with a checkpoint.
    """
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    run = Runner(loaded, Path(directory), quiet=not progress)
    resume = resume and any((run.directory / name).exists() for name in RUN_FILES)
    if threading.current_thread() is not threading.main_thread():  # others cannot handle signals
        run.interrupts = Interrupts(())
    try:
        with run.interrupts, event.install_listener("numba:compile", run.compilation):
            run.execute(resume)
    except (UserError, OSError) as fault:
        run.progress.note(str(fault))
        raise
    finally:
        run.close()
    if run.interrupts.number:
        signal.raise_signal(run.interrupts.number)
    return open_run(directory)
