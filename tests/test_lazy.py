"""Only what a scene names is imported: looked at in the modules of a process that has imported what runs scenes."""

import json
import subprocess
import sys

import fresh
import pytest
from runs import DISC, SHOCK, WAVE

RUN = """
import json, sys
from pathlib import Path
from types import SimpleNamespace
if sys.argv[2] == "undrawn":
    sys.modules["discsim.output.figure"] = SimpleNamespace(last_state_figure=lambda snapshot, figure: figure.touch())
from discsim.run.runner import run_scene
from discsim.scene import load_scene
scene = load_scene(sys.argv[1], ["run.until=0.01"], sys.argv[3:])
assert run_scene(scene, Path("out"), quiet=True) == 0
print(json.dumps(list(sys.modules)))
"""

START = """
import json, sys
from discsim import Simulation, load_scene
Simulation(load_scene(sys.argv[1], [], sys.argv[2:]))
print(json.dumps(list(sys.modules)))
"""

COMMAND = """
import json, sys
from discsim.cli import app
app(sys.argv[1:], standalone_mode=False)
print(json.dumps(list(sys.modules)))
"""

GRAVITY = {"pyfftw", "discsim.numerics.poisson", "discsim.kernels.gravity.poisson", "discsim.effects.self_gravity"}
DUST = {"discsim.effects.dust"}
DRAG = {
    "discsim.effects.drag",
    "discsim.drag",
    "discsim.drag.cells",
    "discsim.drag.nodes",
    "discsim.drag.tsc",
    "discsim.kernels.drag.cells",
    "discsim.kernels.drag.laws",
    "discsim.kernels.drag.tsc.levels",
    "discsim.kernels.drag.tsc.nodes",
    "discsim.kernels.drag.nonlinear",
    "discsim.kernels.drag.relax",
    "discsim.kernels.drag.blocks",
}
COOLING = {
    "discsim.effects.cooling",
    "discsim.kernels.sph.cooling",
    "discsim.physics.cooling",
    "discsim.formulas.opacity",
}
STIRRED = {
    "discsim.effects.dust_diffusion",
    "discsim.physics.diffusion",
    "discsim.kernels.dust.diffusion",
    "discsim.kernels.common.philox",
}
GROWN = {
    "discsim.effects.growth",
    "discsim.physics.growth",
    "discsim.kernels.dust.growth",
    "discsim.kernels.dust.growth_sums",
    "discsim.kernels.dust.growth_exchange",
    "discsim.kernels.dust.packs",
}
LIGHT = {"discsim.effects.radiation_pressure", "discsim.kernels.dust.radiation"}
OTHER_SCHEME = {
    "discsim.drag.idic",
    "discsim.drag.idic_linear",
    "discsim.drag.published.pairs",
    "discsim.kernels.drag.pairs",
}
STAR = {"discsim.effects.star", "discsim.kernels.gravity.point_masses"}
GAS = {
    "discsim.effects.gas",
    "discsim.numerics.sph",
    "discsim.kernels.sph.forces",
    "discsim.kernels.sph.density",
    "discsim.kernels.sph.packs",
    "discsim.numerics.neighbours",
    "discsim.kernels.common.neighbours",
    "discsim.kernels.common.candidates",
}
GRID = {
    "discsim.numerics.ppm",
    "discsim.kernels.fluid1d.ppm",
    "discsim.kernels.fluid1d.drag",
    "discsim.effects.cells",
    "discsim.drag.published.emsi_ppm",
}
# The files of effects have the keys of their tables, which a scene on a fixed grid has too.
OF_PARTICLES = (
    GAS - {"discsim.effects.gas"}
    | {
        "discsim.drag.cells",
        "discsim.drag.nodes",
        "discsim.drag.tsc",
        "discsim.kernels.drag.tsc.levels",
        "discsim.kernels.drag.tsc.nodes",
    }
    | {"discsim.numerics.grid", "discsim.kernels.common.grid"}
)
RANKS = {"mpi4py", "discsim.ranks", "discsim.kernels.mpi.halo", "discsim.kernels.mpi.tiles"}
SLOW = {"numba", "scipy", "h5py", "matplotlib", "pyfftw"}

TUBE = """\
units.system = "code"
run = {until = 0.01, snapshots = 1}
space = {dimensions = 1, size = 1, boundary = "open"}
initial.kind = "shock"
gas = {particles = 40, eos = {kind = "adiabatic", gamma = 1.4}}
dust = {particles = 40, ratio = 1}
drag = {law = "constant", K = 10, scheme = "emsi-ppm"}
"""

DUST_ONLY = """\
units.system = "code"
run = {until = 1, snapshots = 1}
space.size = 6
initial = {kind = "disc", mass = 0.01, inner = 0.5, outer = 2}
dust = {particles = 50, ratio = 0.01}
star.mass = 1
"""


@pytest.fixture(scope="module")
def running():
    """A process that can run scenes and has not: what all of them import is there once."""
    with fresh.after("import discsim.run.runner, astropy.units") as run:
        yield run


@pytest.fixture(scope="module")
def commanded():
    with fresh.after("import discsim.cli") as run:
        yield run


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.toml"


def modules(printed):
    return set(json.loads(printed.splitlines()[-1]))


# The figure takes half of such a run: one of a map and one of lines are enough, of scenes with the least.
@pytest.mark.parametrize(
    "text, without, figure, there, absent",
    [
        (DISC, (), "undrawn", GAS | DUST | DRAG | STAR | GRAVITY, OTHER_SCHEME | COOLING | LIGHT | STIRRED | GROWN),
        (DISC, ("dust", "drag", "self_gravity"), "drawn", GAS | STAR, DUST | DRAG | GRAVITY),
        (DISC, ("drag",), "undrawn", GAS | DUST | STAR | GRAVITY, DRAG),
        (SHOCK, (), "drawn", GAS, DUST | DRAG | STAR | GRAVITY),
        (WAVE, (), "undrawn", GAS | DUST | DRAG, STAR | GRAVITY | OTHER_SCHEME),
        (DUST_ONLY, (), "undrawn", DUST | STAR, GAS | DRAG | GRAVITY | GRID),
        (TUBE, (), "undrawn", GRID, OF_PARTICLES | OTHER_SCHEME | {"discsim.drag.published.sios_ppm"}),
    ],
)
def test_a_whole_run_imports_only_the_effects_named(running, tmp_path, path, text, without, figure, there, absent):
    path.write_text(text)
    found = modules(running(tmp_path, RUN, path, figure, *without))
    assert there <= found
    assert not (absent | RANKS | {"rich"}) & found  # rich draws on terminals
    assert ("matplotlib" in found) == (figure == "drawn")


def test_a_start_waits_for_nothing_that_it_does_not_need(running, tmp_path, path):
    path.write_text(DISC)
    found = modules(running(tmp_path, START, path, "self_gravity"))
    assert "numba" in found
    unneeded = {"matplotlib", "discsim.output.figure", "scipy.interpolate", "scipy.ndimage", "scipy.spatial"}
    assert not (unneeded | GRAVITY) & found


@pytest.mark.parametrize("arguments", [["check"], ["effects"], ["--help"], ["analyse", "--help"]])
def test_checking_imports_nothing_slow(commanded, tmp_path, path, arguments):
    path.write_text(DISC)
    if arguments == ["check"]:
        arguments = ["check", path]
    assert not SLOW & modules(commanded(tmp_path, COMMAND, *arguments))


def test_what_a_command_leaves_is_not_looked_through_when_it_ends():
    """Python's search for garbage at its end, of all that compiling has left, takes a thirtieth of a cold start."""
    lines = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count(), file=sys.stderr))"
    lines += "; from discsim.cli import main; main()"
    ended = subprocess.run([sys.executable, "-c", lines, "--help"], capture_output=True, text=True, check=True)
    assert int(ended.stderr) > 1000
