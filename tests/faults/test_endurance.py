"""Over many steps, rows, snapshots and checkpoints a run takes no more memory and no more open files."""

import os

from runs import DISC, scene_of
from short import ALWAYS

from discsim.run.runner import Run, run_scene

OUTPUTS, STEPS = 400, 800


def test_memory_and_open_files(tmp_path, monkeypatch):
    few = ["gas.particles=300", "dust.particles=300", "space.cells=16", "run.timestep=0.001"]
    length = [f"run.until={STEPS * 0.001}", f"run.every={STEPS * 0.001 / OUTPUTS}"]
    seen, after = {}, Run._after_step

    def look(run):
        ends = after(run)
        with open("/proc/self/statm") as file:
            pages = int(file.read().split()[1])
        seen[run.sim.state.step] = pages * os.sysconf("SC_PAGE_SIZE") / 2**20, len(os.listdir("/proc/self/fd"))
        return ends

    monkeypatch.setattr(Run, "_after_step", look)
    assert run_scene(scene_of(tmp_path, DISC, *few, *length, ALWAYS), tmp_path / "out", quiet=True) == 0
    assert len(seen) >= STEPS and len([*tmp_path.glob("out/snapshots/*.h5")]) == OUTPUTS + 1
    (first, files), (last, files_at_end) = seen[STEPS // 4], seen[STEPS]
    print(f"{STEPS} steps, {OUTPUTS} snapshots, {STEPS} checkpoints: {last - first:+.2f} MiB since a quarter of them")
    assert files == files_at_end
    # A checkpoint of this run has .1 MiB: were one in a hundred kept, it would be 6 MiB more.
    assert last - first < 4.0
