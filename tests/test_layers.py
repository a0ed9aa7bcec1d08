"""The floors of the house: what a package may import, and no circle of modules."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components

import discsim

HOME = Path(discsim.__file__).parent
# From the ground up: each imports itself and what stands before it.
FLOORS = (
    "version", "printable", "userfiles", "parts", "formulas", "jit", "kernels", "exact", "scene", "numerics", "physics",
    "drag", "initial", "effects", "output", "plot", "sky", "export", "preview", "run", "study", "report", "shipped",
    "launch", "ranks", "cli",
)  # fmt: skip
# Modules in the largest circle of imports, with those for type checkers: a `Draft` has the type of its start and a
# `Scene` that of its gas model, and starts, physics and numerics take a `Scene`.
LARGEST_CIRCLE = 21


def modules():
    """Dotted name of each module -> its file."""
    names = {}
    for file in sorted(HOME.rglob("*.py")):
        parts = file.relative_to(HOME.parent).with_suffix("").parts
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return names


@cache
def imported(types=False):
    """By module the modules of discsim that it imports anywhere, but for type checkers unless `types`."""
    known = modules()
    return {name: {*imports(ast.parse(file.read_text()), known, types)} for name, file in known.items()}


def imports(tree, known, types):
    skipped = {
        id(inner)
        for node in ast.walk(tree)
        if not types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for statement in node.body
        for inner in ast.walk(statement)
    }
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in known else node.module for name in names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "discsim")


def test_every_package_has_a_floor():
    packages = {path.stem for path in HOME.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert packages - {"__init__", "__main__"} == set(FLOORS)


def test_no_package_imports_one_above_it():
    upwards = [
        f"{name} imports {other}"
        for name, others in imported().items()
        for other in others
        if name.count(".") and other.count(".") and name.split(".")[1] in FLOORS
        if FLOORS.index(other.split(".")[1]) > FLOORS.index(name.split(".")[1])
    ]
    assert upwards == []


def test_no_circle_of_imports():
    graph = {name: others - {name} for name, others in imported().items()}
    graph.pop("discsim.__main__")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def test_drag_schemes_get_arrays_alone():
    """No module of drag names effects or the state, types included, except the engine."""
    files = [file for file in (HOME / "drag").rglob("*.py") if file.stem != "engine"]
    assert [f.name for f in files if re.search(r"discsim\.(effects|numerics\.state)", f.read_text())] == []


def test_the_largest_circle_with_types_does_not_grow():
    graph = imported(types=True)
    names = list(graph)
    joined = np.array([[other in graph[name] and other != name for other in names] for name in names])
    circle = connected_components(joined, connection="strong")[1]
    largest = [name for name, number in zip(names, circle, strict=True) if number == np.bincount(circle).argmax()]
    assert len(largest) <= LARGEST_CIRCLE, "\n".join(largest)


def test_nothing_is_long():
    """No module above 600 lines, no function above 80, no list of arguments above 15."""
    long = []
    for name, file in modules().items():
        text = file.read_text()
        if (lines := len(text.splitlines())) > 600:
            long.append(f"{name}: {lines} lines")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                is_command = any(".command" in ast.unparse(each) for each in node.decorator_list)
                begin = node.body[0].lineno if is_command else node.lineno  # the arguments of a command are its options
                length, given = node.end_lineno - begin + 1, node.args
                taken = len([*given.posonlyargs, *given.args, *given.kwonlyargs])
                if length > 80 or (taken > 15 and not is_command):
                    long.append(f"{name}.{node.name}: {length} lines, {taken} arguments")
    assert long == [], "\n".join(long)


def test_no_kernel_assigns_an_array_to_a_slice():
    """numba compiles the text of an error with that, which takes as long as the largest kernels (discsim.kernels)."""
    found = []
    for file in sorted((HOME / "kernels").rglob("*.py")):
        for kernel in ast.walk(ast.parse(file.read_text())):
            if isinstance(kernel, ast.FunctionDef) and kernel.decorator_list:
                found += [f"{file.stem}.{kernel.name}: {ast.unparse(node)}" for node in sliced(kernel)]
    assert found == [], "\n".join(found)


def sliced(kernel):
    """Assignments of anything but a number to slices."""
    for node in ast.walk(kernel):
        if isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            to = [one for target in targets if isinstance(target, ast.Subscript) for one in ast.walk(target.slice)]
            if any(isinstance(one, ast.Slice) for one in to) and ast.unparse(node.value) not in ("0.0", "np.nan"):
                yield node
