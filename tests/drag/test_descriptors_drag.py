"""A drag scheme, a law of the stopping time and an equation of state of another package, which entry points name; and
where those of this one are named."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from installed import install

import discsim
from discsim.parts import DEFAULT_SCHEME, EOS, LAWS, SCHEMES

HOME = Path(discsim.__file__).parent

SCHEME = '''
"""everyone: all dust relaxes exactly towards the mean velocity of all gas.

du/dt = (V - u) / t_stop
"""

import numpy as np

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, KickResult, Scheme


def kick(gas, dust, law, frame, dt, cells, context):
    gas.vel[:] += dt * gas.acc
    dust.vel[:] += dt * dust.acc
    time = float(law.stopping_time(0, gas.density[:1], gas.thermal_speed[:1], np.zeros(1), 1.0)[0])
    mean, grains = np.average(gas.vel, 0, gas.mass), np.average(dust.vel, 0, dust.mass)
    loaded = dust.mass.sum() / gas.mass.sum()
    lost = (grains - mean) * -np.expm1(-(1.0 + loaded) * dt / time) / (1.0 + loaded)
    dust.vel[:] -= lost
    gas.vel[:] += loaded * lost
    return KickResult(np.arange(0), np.full(len(dust.mass), time))


def no_star(draft):
    if draft.has("star"):
        yield ("star",), "everyone is no crowd to orbit; expected no star"


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
SCHEME = Scheme(kick, limit=lambda *given: 0.3, conserves=False, damps=True, unused=UNUSED, nanoseconds=1e6,
                rules=(no_star,))
'''
LAW = """
from discsim.formulas import laws
from discsim.physics.laws import StoppingTimeLaw


def short(draft):
    if draft.drag.t_stop is not None and draft.drag.t_stop > 5:
        yield ("drag", "t_stop"), "too lazy; expected 5 at most"


LAW = StoppingTimeLaw(laws.STOPPING_TIME, lambda scene, population: 2.0 * scene.drag.t_stop, "t_stop", rules=(short,),
          uniform_time=lambda drag: 2.0 * drag.t_stop)
"""
GAS = '''
from typing import Literal

import numpy as np
from pydantic import Field

from discsim.physics.eos import Eos
from discsim.scene.fields import Number, Table


class Linear(Table):
    """P = constant (rho - rho_0)."""

    kind: Literal["linear"] = "linear"
    stiffness: Number = Field(gt=0, description="dP/drho")
    zero: Number = Field(0.0, description="rho_0")


class LinearGas(Eos):
    keys = Linear

    def start_speed(self, scene, r, density):
        return np.full_like(density, np.sqrt(scene.gas.eos.stiffness))

    def pressure_and_sound_speed(self, scene, pos, density, u):
        eos = scene.gas.eos
        return eos.stiffness * (density - eos.zero), np.full_like(density, np.sqrt(eos.stiffness))

    @staticmethod
    def positive(draft):
        if draft.gas.eos.zero < 0:
            yield ("gas", "eos", "zero"), "pulls; expected 0 at least"

    rules = (positive,)


EOS = LinearGas()
'''
POINTS = {
    "discsim.schemes": {"everyone": "toy_scheme:SCHEME"},
    "discsim.laws": {"lazy": "toy_law:LAW"},
    "discsim.eos": {"linear": "toy_gas:EOS"},
}
USE = """
import copy, json, sys
import numpy as np
from discsim import SceneError, Simulation
from discsim.preview.check import report
from discsim.preview.forecast import forecast
from discsim.scene import load_scene
tables = json.loads(sys.argv[1])
def problems(**changes):
    tables_now = copy.deepcopy(tables)
    for path, value in changes.items():
        *outer, key = path.split("__")
        place = tables_now
        for name in outer:
            place = place.setdefault(name, {})
        place[key] = value
    try:
        load_scene(tables_now)
    except SceneError as error:
        return error.problems
sim = Simulation(tables)
while sim.time < sim.scene.run.until:
    sim.step(sim.scene.run.until - sim.time)
speeds = sorted(set(sim.gas.sound_speed.tolist()))
slip = float((sim.dust.vel[:, 0] - sim.gas.vel[:, 0]).mean())
plane = copy.deepcopy(tables)
plane["space"]["dimensions"] = 2
plane["gas"]["particles"] = plane["dust"]["particles"] = 400
usual = copy.deepcopy(plane)
del usual["drag"]["scheme"]
print(json.dumps({
    "slip": slip, "steps": sim.state.step, "speeds": speeds, "report": report(load_scene(tables)),
    "seconds": forecast(load_scene(plane)).step_seconds - forecast(load_scene(usual)).step_seconds,
    "rules": problems(drag__t_stop=9.0, star__mass=1.0, gas__eos__zero=-1.0, drag__cell=2, drag__K=1.0),
    "heat": problems(drag__heating=True),
}))
"""
TABLES = {
    "units": {"system": "code"},
    "run": {"until": 0.1, "timestep": 0.025},
    "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "box", "dust_velocity": 1.0},
    "gas": {"particles": 40, "eos": {"kind": "linear", "stiffness": 4.0}},
    "dust": {"particles": 40, "ratio": 1.0},
    "drag": {"law": "lazy", "t_stop": 0.05, "scheme": "everyone"},
}


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """The environment of a process that has the package of the toys installed."""
    home = tmp_path_factory.mktemp("toys")
    install(home, {"toy_scheme": SCHEME, "toy_law": LAW, "toy_gas": GAS}, POINTS)
    path = os.pathsep.join(filter(None, (str(home), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path}


def output(environment, *arguments):
    done = subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def found(other):
    return json.loads(output(other, "-c", USE, json.dumps(TABLES)))


def test_a_run_with_parts_of_another_package(found):
    # exp(-(1 + eps) t / t_stop) with the law's t_stop, twice that of the scene, to rounding.
    assert found["slip"] == pytest.approx(math.exp(-2.0 * 0.1 / (2.0 * 0.05)), rel=1e-12)
    assert found["speeds"] == [2.0] and found["steps"] == 4


def test_previews_ask_parts_of_another_package(found):
    text = found["report"]
    assert re.search(r"^  sound speed +2$", text, re.M) and re.search(r"^  stopping time +0.1$", text, re.M)
    drag = next(line for line in text.splitlines() if line.startswith("  drag "))
    assert "scheme everyone" in drag and "cell" not in drag and "integration" not in drag
    # 800 particles at a millisecond in place of what the usual scheme takes.
    assert found["seconds"] == pytest.approx(800 * (1e6 - SCHEMES[DEFAULT_SCHEME].nanoseconds) * 1e-9, rel=1e-6)


def test_warnings_of_another_scheme(other):
    coarse = json.loads(json.dumps(TABLES)) | {"drag": TABLES["drag"] | {"t_stop": 1e-4}}
    text = json.loads(output(other, "-c", USE.replace("sim.time < sim.scene", "0 > sim.scene"), json.dumps(coarse)))
    assert 'drag.scheme "everyone" is explicit' in text["report"] and '"everyone" damps too much' in text["report"]


def test_rules_of_another_package(found):
    assert sorted(line.rpartition("scene: ")[2] for line in found["rules"]) == sorted(
        [
            'drag.K: used only with drag.law = "constant", but drag.law is "lazy"; choose another law, or '
            "remove this key",
            'drag.cell: scheme "everyone" has no drag cells; remove this key',
            "drag.t_stop: too lazy; expected 5 at most",
            "gas.eos.zero: pulls; expected 0 at least",
            "star: everyone is no crowd to orbit; expected no star",
            "star: a star is possible only in two dimensions; set space.dimensions = 2",
        ]
    )
    assert 'gas with gas.eos.kind = "linear" has no energy equation; set drag.heating = false' in found["heat"][0]


def test_the_reference_of_another_package(other):
    text = output(other, "-m", "discsim", "effects")
    assert '  scheme = "everyone": does not conserve momentum\n    all dust relaxes exactly' in text
    assert 'gas.eos.kind = "linear": P = constant (rho - rho_0).' in text
    assert '"lazy"' in text


# Where parts are named

OWN = {
    # Artificial viscosity is "reconstructed" too, by gas.viscosity.pairs.
    "schemes": {f"{SCHEMES.module(name).removeprefix('discsim.').replace('.', '/')}.py" for name in SCHEMES}
    | {"effects/gas.py", "scene/keys.py", "numerics/sph.py"},
    # The descriptions of the keys K, t_stop and stokes say which laws they are for. Populations may have
    # their Stokes number as a name.
    "laws": {"physics/laws.py", "effects/drag.py", "scene/keys.py", "scene/populations.py"},
    # The keys of cooling say which equation of state they need.
    "eos": {"physics/eos.py", "scene/keys.py"},
}
SHARED = ("warnings", "forecast", "derived", "reference", "check")


@pytest.mark.parametrize(("parts", "names"), [("schemes", SCHEMES), ("laws", LAWS), ("eos", EOS)])
def test_previews_and_physics_name_no_part(parts, names):
    """By its word in quotes. Names stand in the file of the thing itself and in the registry."""
    files = [*(HOME / "drag").glob("*.py"), *(HOME / "effects").glob("*drag.py"), *(HOME / "physics").glob("*.py")]
    files += [*(HOME / "kernels").glob("*.py"), *(HOME / "scene").glob("[!r]*.py"), *(HOME / "numerics").glob("*.py")]
    files += [HOME / "preview" / f"{name}.py" for name in SHARED]
    if parts == "schemes":
        files = [path for path in HOME.rglob("*.py") if path.name != "parts.py"]
    quoted = re.compile("|".join(rf"""["']{re.escape(name)}["']""" for name in names))
    named = {str(path.relative_to(HOME)) for path in files if quoted.search(path.read_text())}
    assert named <= OWN[parts]
