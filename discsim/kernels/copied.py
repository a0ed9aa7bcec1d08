"""Functions that only compiled code calls get no machine code of their own: whatever calls one holds a copy of it.

numba makes it nonetheless, and for what it brings itself (np.empty, min, ...) also what lets Python and C call that: a
tenth of the time that compiling takes. A process that does may also call it where one that loads what it calls has the
caller's copy, whose last bits may differ. Nor are they optimised as a whole on their own, only each of their functions:
the copies are, in every caller and its callers in turn. That took another fourteenth.
"""

from typing import Any

from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, JITCPUCodegen
from numba.core.typing import templates

# What names begin with of functions here and of numba's own. Others' are left as they are: two functions that call each
# other need machine code of their own, and here there are none.
OURS = "_ZN7discsim", "_ZN5numba"
UNCALLED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # as CALLED and KERNEL in `inner`

Template: Any = getattr(templates, "_OverloadFunctionTemplate", object)
# What numba does not promise to keep: one that lacks any of these makes machine code of all.
INSIDES = (
    (JITCPUCodegen, "_add_module"),
    (JITCPUCodegen, "set_env"),
    (CPUCodeLibrary, "_optimize_final_module"),
    (Template, "_build_impl"),
)
known_inside = all(name in vars(where) for where, name in INSIDES)
if known_inside:
    add_module, set_env = JITCPUCodegen._add_module, JITCPUCodegen.set_env
    serialize, build = JITCodeLibrary.serialize_using_object_code, Template._build_impl
    optimize = CPUCodeLibrary._optimize_final_module


def is_copied(module: Any) -> bool:
    """Whether a module has nothing but such functions: no wrapper for Python or C, whose names begin with that. One
    whose machine code comes from the cache is empty.
    """
    names = [one.name for one in module.functions if not one.is_declaration]
    return bool(names) and all(name.startswith(OURS) for name in names)


def optimize_uncopied(library: Any) -> None:
    if not is_copied(library._final_module):
        optimize(library)


def add(codegen: Any, module: Any) -> None:
    if not is_copied(module):
        add_module(codegen, module)


def set_where_defined(codegen: Any, name: str, env: Any) -> None:
    if codegen._engine.is_symbol_defined(name):
        set_env(codegen, name, env)


def kept_as(library: Any) -> tuple[Any, ...]:
    """What the cache keeps of a library: its name, the kind of what follows, and that."""
    return library.serialize_using_bitcode() if is_copied(library._final_module) else serialize(library)


def built(template: Any, key: Any, args: Any, kws: Any) -> Any:
    template._jit_options = template._jit_options | UNCALLED
    return build(template, key, args, kws)


def take_over() -> None:
    """From now on numba calls these."""
    if known_inside:
        CPUCodeLibrary._optimize_final_module = optimize_uncopied  # type: ignore[method-assign]
        JITCPUCodegen._add_module = add  # type: ignore[method-assign]
        JITCPUCodegen.set_env = set_where_defined  # type: ignore[method-assign]
        JITCodeLibrary.serialize_using_object_code = kept_as  # type: ignore[method-assign]
        Template._build_impl = built
