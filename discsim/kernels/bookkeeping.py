"""Five functions of numba's compiler with the same results in less time: they save more than a quarter of compiling.

numba tries all that an operator can mean, an addition of texts as well, each time that one is met. Here what it found
for arguments of the same types, under the same options, is looked up. It keeps what a call compiles to by all options
of its caller, and reads these thirty one after the other each time that it compares two sets of them: here two
dictionaries are compared. And it looks for the variables of statements, many times each, by asking every value whether
it is of one of five classes: here those are looked up by its type. For each function it finds out ten times
which variables are alive where, though only two of its passes ask for that: here it does when asked. And with each
kernel that it compiles or loads, it imports all of its own that a kernel may call: here it does so once. It also times
each call of LLVM, for whoever asks how long that took: nobody does, and there are so many that it takes a thirtieth of
the time of compiling.
"""

from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

from llvmlite.binding import ffi
from numba.core import ir, postproc, transforms, types
from numba.core.cpu import CPUContext
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction

HOLDERS = ir.Var, ir.Inst, dict, list, tuple  # in the order in which numba asks
# Of arguments with these types alone calls are looked up: what others mean may become known while a function is read.
PLAIN = types.Number, types.Boolean, types.NoneType, types.NumberClass, types.DType, types.SliceType, types.Array
TUPLES: Any = types.BaseTuple
COMPILED = "discsim", "numba"  # packages whose functions are never left to Python, which asks what is alive in a block
as_numba_resolves = BaseFunction.get_call_type
as_numba_finishes = postproc.PostProcessor.run
as_numba_imports: Any = getattr(CPUContext, "load_additional_registries", None)
# What numba does not promise to keep: one that lacks any of these is left as it is.
INSIDES = (
    (TargetConfig, "options"),
    (ir.Inst, "_rec_list_vars"),
    (transforms, "canonicalize_cfg"),
    (postproc, "VariableLifetime"),
    (postproc.PostProcessor, "_insert_var_dels"),
    (CPUContext, "load_additional_registries"),
)
known_inside = all(name in vars(where) for where, name in INSIDES) and TargetConfig.__slots__ == ["_values"]
known_inside = known_inside and "_impl_keys" in as_numba_resolves.__code__.co_names
known_inside = known_inside and "_registries" in CPUContext.install_registry.__code__.co_names


class Kinds(dict[type, type | None]):
    """Which of HOLDERS a type is, if any."""

    def __missing__(self, cls: type) -> type | None:
        self[cls] = kind = next((one for one in HOLDERS if issubclass(cls, one)), None)
        return kind


class Defaults(dict[type, tuple[dict[str, Any], int]]):
    """Of a class of options their defaults, and the hash that numba gives all of them."""

    def __missing__(self, cls: Any) -> tuple[dict[str, Any], int]:
        values = {name: option.default for name, option in cls.options.items()}
        self[cls] = found = values, hash(tuple(sorted(values)))
        return found


kinds, defaults = Kinds(), Defaults()
resolved: WeakKeyDictionary[BaseFunction, dict] = WeakKeyDictionary()
imported: WeakSet[CPUContext] = WeakSet()


def variables_in(values: Iterable[Any]) -> list[Any]:
    """The variables (ir.Var) that values hold, in their order."""
    found: list[Any] = []
    for value in values:
        kind = kinds[type(value)]
        if kind is ir.Var:
            found.append(value)
        elif kind is ir.Inst:
            found += value.list_vars()
        elif kind is dict:
            found += variables_in(value.values())
        elif kind is not None:
            found += variables_in(value)
    return found


def are_equal(one: Any, other: Any) -> Any:
    """Whether two sets of options have the same values."""
    if one is other:
        return True
    if not isinstance(other, TargetConfig):
        return NotImplemented
    return {**defaults[type(one)][0], **one._values} == {**defaults[type(other)][0], **other._values}


def is_plain(one: Any) -> bool:
    return isinstance(one, PLAIN) or (isinstance(one, TUPLES) and all(is_plain(part) for part in one))


def signature_of(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """The signature that a call has with arguments of these types; `function` then knows what it compiles to."""
    if kws or not all(is_plain(one) for one in args):
        return as_numba_resolves(function, context, args, kws)
    options = ConfigStack.top_or_none()
    known = resolved.setdefault(function, {})
    found = known.get((context, tuple(args), options))
    if found is None:
        kept = options.copy() if options is not None else None  # which may change
        signature = as_numba_resolves(function, context, args, kws)
        known[context, tuple(args), kept] = found = signature, function._impl_keys[signature.args]
    function._impl_keys[found[0].args] = found[1]
    return found[0]


def finish(this: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Bring the blocks of a function in order, and end the lives of its variables after their last uses if asked to."""
    code = this.func_ir
    if code.is_generator or code.func_id.modname.partition(".")[0] not in COMPILED:
        as_numba_finishes(this, emit_dels, extend_lifetimes)
        return
    code.blocks = transforms.canonicalize_cfg(code.blocks)
    code.variable_lifetime, code.generator_info = postproc.VariableLifetime(code.blocks), None
    if emit_dels:
        this._insert_var_dels(extend_lifetimes=extend_lifetimes)


def load_registries(context: Any) -> None:
    """What kernels may call becomes known: all that numba brings, which it imports, and what was registered since."""
    if context not in imported:
        as_numba_imports(context)
        imported.add(context)
    for registry in context._registries:
        context.install_registry(registry)


def take_over() -> None:
    """From now on numba calls these."""
    if known_inside:
        TargetConfig.__eq__ = are_equal  # type: ignore[method-assign]
        TargetConfig.__hash__ = lambda options: defaults[type(options)][1]  # type: ignore[method-assign]
        ir.Inst._rec_list_vars = lambda statement, value: variables_in((value,))  # type: ignore[method-assign]
        postproc.PostProcessor.run = finish  # type: ignore[method-assign, assignment]
        CPUContext.load_additional_registries = load_registries  # type: ignore[method-assign]
        BaseFunction.get_call_type = signature_of  # type: ignore[method-assign, assignment]
        lock = getattr(ffi.lib, "_lock", None)
        for begin, end in list(getattr(lock, "_cblist", ())):
            ffi.unregister_lock_callback(begin, end)
