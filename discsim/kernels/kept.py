"""What the cache keeps of a compiled function, and what of that is read when it is loaded.

Beside machine code it has LLVM's intermediate code, for functions that are compiled later and call this one. numba
reads that too whenever it loads a kernel, to learn which names are defined in it: a thirtieth of a start that compiles
nothing. Here these names are kept as well, and the intermediate code is read when it is asked for. What has no machine
code (see `copied`) is kept as intermediate code alone.
"""

from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import CodeLibrary, CPUCodeLibrary, JITCodeLibrary, JitEngine

from discsim.kernels import copied

KIND = "kernel"  # of what is kept with its names; numba itself has "object" and "bitcode"
OURS = "_ZN7discsim", "_ZN7cpython7discsim", "NRT_"  # how names in it begin; the last of numba's own, in any

# What numba does not promise to keep: one that has none of that keeps and reads what it is used to.
INSIDES = (
    (CPUCodeLibrary, "_unserialize"),
    (CPUCodeLibrary, "_get_module_for_linking"),
    (CodeLibrary, "_set_compiled_object"),
    (JitEngine, "_load_defined_symbols"),
)
known_inside = copied.known_inside and all(name in vars(where) for where, name in INSIDES)
if known_inside:
    serialize, unserialize = JITCodeLibrary.serialize_using_object_code, vars(CPUCodeLibrary)["_unserialize"].__func__
    module_to_link = CPUCodeLibrary._get_module_for_linking


def kept_as(library: Any) -> tuple[Any, ...]:
    """What the cache keeps of a library."""
    if copied.is_copied(library._final_module):
        return library.serialize_using_bitcode()
    name, kind, data = serialize(library)
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
