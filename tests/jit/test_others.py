"""What discsim leaves alone: numba's configuration and classes, and compiled functions of users."""

import os
import subprocess
import sys

# Values of all settings, and what all classes of numba's modules hold.
BEFORE_AND_AFTER = """
import inspect, sys
import numba
from numba.core import caching, codegen, compiler, ir, postproc, targetconfig, typing, untyped_passes

def settings():
    found = {name: repr(value) for name, value in vars(numba.config).items() if name.isupper()}
    for module in [module for name, module in sys.modules.items() if name.partition(".")[0] in ("numba", "llvmlite")]:
        if module.__name__ not in modules:
            continue
        for name, value in vars(module).items():
            if inspect.isclass(value):
                held = {key: id(one) for key, one in vars(value).items() if inspect.isroutine(one)}
                found[module.__name__, name] = held, repr(vars(value).get("_locator_classes"))
            elif inspect.isroutine(value):
                found[module.__name__, name] = id(value)
    return found

modules = set(sys.modules)
before = settings(), sys.getswitchinterval(), __import__("gc").get_threshold()
import discsim
sim = discsim.Simulation({
    "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"dimensions": 1, "size": 2.0, "boundary": "periodic"},
    "initial": {"kind": "box"}, "gas": {"particles": 40, "eos": {"kind": "isothermal", "sound_speed": 1.3}},
    "dust": {"particles": 40, "ratio": 0.3},
    "drag": {"law": "stopping-time", "t_stop": 0.25, "scheme": "idic"},
})
sim.step()
after = settings(), sys.getswitchinterval(), __import__("gc").get_threshold()
print([key for key in before[0] if after[0][key] != before[0][key]], before[1:] == after[1:], len(before[0]) > 500)
"""
MODULE = """
from numba import njit

@njit(cache=True)
def thrice(x):
    return 3 * x
"""
USE = """
import discsim
from of_a_user import thrice
print(thrice(1.5), sum(thrice.stats.cache_hits.values()))
"""


def output_of(script, **environment):
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_an_import_and_a_run_change_nothing_of_numba_and_python():
    assert output_of(BEFORE_AND_AFTER) == "[] True True\n"


def test_a_function_of_a_user_finds_its_own_cache(tmp_path):
    (tmp_path / "of_a_user.py").write_text(MODULE)
    with_kernels = "import discsim.kernels.common.grid\n" + USE
    environment = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": ""}
    assert output_of(with_kernels, **environment) == "4.5 0\n"
    assert output_of(with_kernels, **environment) == "4.5 1\n"
    assert output_of(USE.replace("import discsim\n", ""), **environment) == "4.5 1\n"
    assert {path.suffix for path in (tmp_path / "__pycache__").iterdir()} <= {".pyc", ".nbi", ".nbc"}
