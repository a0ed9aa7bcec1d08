"""What the cache keeps of a compiled function, and what of that is read when it is loaded.

Beside machine code it has LLVM's intermediate code, for functions that are compiled later and call this one. numba
reads that too whenever it loads a kernel, to learn which names are defined in it: a thirtieth of a start that compiles
nothing. Here these names are kept as well, and the intermediate code is read when it is asked for.
"""

from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import CodeLibrary, CPUCodeLibrary, JITCodeLibrary, JitEngine

from discsim.kernels import copied

KIND = "kernel"  # of what is kept together with its names; numba's own kinds are "object" and "bitcode"
# How the names of all functions in a kernel begin; those of numba's own that count references may be in any. Kernels
# are kept in a place of their own (`cache`): a process without discsim, which knows no such KIND, finds none.
OURS = "_ZN7discsim", "_ZN7cpython7discsim", "NRT_"

# What numba does not promise to keep: one that lacks any of these keeps and reads what it is used to.
INSIDES = (
    (CPUCodeLibrary, "_unserialize"),
    (CPUCodeLibrary, "_get_module_for_linking"),
    (CPUCodeLibrary, "_finalize_final_module"),
    (CodeLibrary, "_set_compiled_object"),
)
known_inside = copied.known_inside and all(name in vars(where) for where, name in INSIDES)
known_inside = known_inside and "_shared_module" in CPUCodeLibrary._get_module_for_linking.__code__.co_names
known_inside = known_inside and "_defined_symbols" in JitEngine.is_symbol_defined.__code__.co_names
if known_inside:
    unserialize = vars(CPUCodeLibrary)["_unserialize"].__func__
    module_to_link = CPUCodeLibrary._get_module_for_linking


def kept_as(library: Any) -> tuple[Any, ...]:
    """What the cache keeps of a library: its name, the kind of what follows, and that."""
    name, kind, data = copied.kept_as(library)
    if kind != "object" or len(data) != 2:
        return name, kind, data
    module = library._get_module_for_linking()
    functions = [one.name for one in module.functions if not one.is_declaration]
    if not all(one.startswith(OURS) for one in functions):  # another's, which a process without discsim may load
        return name, kind, data
    return name, KIND, (*data, functions + [one.name for one in module.global_variables if not one.is_declaration])


def load(cls: Any, codegen: Any, kept: tuple[Any, ...]) -> Any:
    """The library of which the cache has kept that."""
    name, kind, data = kept
    if kind != KIND:
        return unserialize(cls, codegen, kept)
    library = codegen.create_library(name)
    machine_code, library.unread, names = data
    library.enable_object_caching()
    library._set_compiled_object(machine_code)
    library._finalize_final_module()
    codegen._engine._defined_symbols.update(names)
    return library


def read(library: Any) -> Any:
    """The intermediate code of a library, for a function that is compiled and calls it."""
    if hasattr(library, "unread"):
        library._shared_module = llvm.parse_bitcode(library.unread)
        del library.unread
    return module_to_link(library)


def take_over() -> None:
    """From now on numba calls these."""
    if known_inside:
        JITCodeLibrary.serialize_using_object_code = kept_as  # type: ignore[method-assign]
        CPUCodeLibrary._unserialize = classmethod(load)  # type: ignore[method-assign, assignment]
        CPUCodeLibrary._get_module_for_linking = read  # type: ignore[method-assign]
