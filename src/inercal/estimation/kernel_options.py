"""Decorators for kernels that compile fast, and records that kernels receive by reference.

The kernels allocate nothing and count no references to arrays. Their caller allocates the arrays
that they use. Only this module and `kernel_compiler` use options and parts of Numba that are not
public, and the allowed versions of Numba are limited because of them. All kernels use the `njit`
defined here, which also accepts kernels cached by another version of inercal.

Numba passes a named tuple by value, so each call of a kernel would pass hundreds of numbers, and
the compiler would need most of its time for them. A `record` is stored in memory once per call from
Python, without copying the data of its arrays, and the kernels share its address. They can read its
fields by name, but cannot create, unpack or return it.
"""
# Numba has no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportPrivateUsage=false
# pyright: reportIncompatibleMethodOverride=false
# Numba and llvmlite have no types.
# pyright: reportMissingTypeStubs=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext, suppress
from math import inf
from time import process_time
from types import FunctionType
from typing import Any, TypeVar
from zlib import crc32

from llvmlite import ir
from numba import njit, types
from numba.core import caching, cgutils, codegen, compiler, event
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

from inercal.basics.parallel import available_cores
from inercal.estimation.kernel_compiler import KernelCompiler

C = TypeVar("C", bound=type)


class RecordType(types.Type):
    """The type of a record: its class, and the types of its fields."""

    def __init__(self, cls: type, fields: tuple[types.Type, ...]):
        self.cls, self.fields = cls, fields
        # The name is part of the names of all functions that receive the record.
        super().__init__(f"{cls.__name__}{crc32(repr(fields).encode()):x}")

    @property
    def key(self) -> tuple[type, tuple[types.Type, ...]]:
        """What distinguishes two types."""
        return self.cls, self.fields


register_model(RecordType)(models.OpaqueModel)


def record(cls: C) -> C:
    """Let kernels receive instances of a class of named tuples by reference."""

    def type_of(value: Any, context: Any) -> RecordType:
        return RecordType(cls, tuple(typeof_impl(one, context) for one in value))

    typeof_impl.register(cls)(type_of)
    return cls


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, record: RecordType, name: str) -> types.Type | None:
        names = record.cls._fields
        return record.fields[names.index(name)] if name in names else None


@lower_getattr_generic(RecordType)
def _read_field(context: Any, builder: Any, record: RecordType, place: Any, name: str) -> Any:
    k = record.cls._fields.index(name)
    kind = context.get_value_type(record.fields[k]).as_pointer()
    return builder.load(builder.bitcast(_field(builder, record, place, k), kind))


@unbox(RecordType)
def _store(record: RecordType, instance: Any, c: Any) -> NativeValue:
    # This function counts no references, and neither do kernels for an array that has no owner.
    called = ir.FunctionType(ir.IntType(32), [c.pyapi.pyobj, c.pyapi.voidptr])
    adapt = cgutils.get_or_insert_function(c.builder.module, called, "numba_adapt_ndarray")
    words = ir.ArrayType(ir.IntType(64), sum(map(_size, record.fields)))
    place = cgutils.alloca_once(c.builder, words, zfill=True)
    place, failed = c.builder.bitcast(place, cgutils.voidptr_t), cgutils.false_bit
    for k, kind in enumerate(record.fields):
        item, at = c.pyapi.tuple_getitem(instance, k), _field(c.builder, record, place, k)
        if isinstance(kind, types.Array):
            wrong = cgutils.is_not_null(c.builder, c.builder.call(adapt, (item, at)))
        else:
            native = c.unbox(kind, item)
            wrong = native.is_error
            c.builder.store(native.value, c.builder.bitcast(at, native.value.type.as_pointer()))
        failed = c.builder.or_(failed, wrong)
    return NativeValue(place, is_error=failed)


def _field(builder: Any, record: RecordType, place: Any, k: int) -> Any:
    """Return the address of a field."""
    return cgutils.pointer_add(builder, place, 8 * sum(map(_size, record.fields[:k])))


def _size(kind: types.Type) -> int:
    """Return the number of words of 8 bytes that a field needs.

    An array has two references, its numbers of elements and of bytes, its address, and two words
    for each dimension.
    """
    return 5 + 2 * kind.ndim if isinstance(kind, types.Array) else 1


class _IndexOfKernels(caching.IndexDataCacheFile):
    """A cache index that counts as empty if it refers to types that have since moved elsewhere."""

    def _load_index(self) -> dict[Any, str]:
        try:
            return super()._load_index()
        except (ImportError, AttributeError):  # while unpickling, before the comparison
            return {}


caching.IndexDataCacheFile = _IndexOfKernels


# Numba compares its flags at each operator, and would read 30 properties of each.
_DEFAULT_FLAGS = {name: option.default for name, option in compiler.Flags.options.items()}
compiler.Flags.values = lambda self: {**_DEFAULT_FLAGS, **self._values}
compiler.Flags.__hash__ = lambda self: hash(compiler.Flags)

_resolve = types.Function.get_call_type
_resolved: dict[Any, tuple[Any, Any]] = {}


def _resolve_once(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Resolve an operator on numbers; Numba would try dozens of templates each time."""
    operator = self.typing_key
    if getattr(operator, "__module__", "") != "_operator" or not all(
        isinstance(one, types.Number | types.IntegerLiteral) for one in args
    ):
        return _resolve(self, context, args, kws)
    if (operator, args) not in _resolved:
        signature: Any = _resolve(self, context, args, kws)
        _resolved[operator, args] = signature, self._impl_keys[signature.args]
    signature, implementation = _resolved[operator, args]
    self._impl_keys[signature.args] = implementation
    return signature


types.Function.get_call_type = _resolve_once


class _NoEnvironments:
    def set_env(self, env_name: str, env: object) -> None:
        """Ignore the environment of a function that cannot be called from Python."""


class _StepLibrary(codegen.JITCodeLibrary):
    """The code of a function that only kernels call, which is optimised as a part of each kernel.

    Numba would optimise it and generate machine code for it, although only the kernel's is used.
    """

    codegen: Any = _NoEnvironments()

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration and b"alwaysinline" not in b"".join(function.attributes):
                function.add_function_attribute("noinline")

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        return self.serialize_using_bitcode()


class _AsStep:
    """Makes a compiler keep its code for the kernels that call it."""

    def define_pipelines(self: Any) -> Any:
        name = self.state.func_id.func_qualname
        self.state["library"] = _StepLibrary(self.state.targetctx.codegen(), name)
        return super().define_pipelines()  # pyright: ignore[reportAttributeAccessIssue]


class _StepCompiler(_AsStep, KernelCompiler):
    pass


class _VectorStepCompiler(_AsStep, compiler.Compiler):
    pass


KERNEL_OPTIONS: dict[str, Any] = {
    "cache": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True,
    "pipeline_class": KernelCompiler,
}  # fmt: skip
INNER_OPTIONS: dict[str, Any] = {
    **KERNEL_OPTIONS, "no_cpython_wrapper": True, "pipeline_class": _StepCompiler,
}  # fmt: skip
"""Options for a function that only kernels call: a call from Python would crash the process."""
# LLVM turns fewer loops into vector instructions if `KernelCompiler` generates them.
VECTOR_OPTIONS: dict[str, Any] = {**KERNEL_OPTIONS, "pipeline_class": compiler.Compiler}
INNER_VECTOR_OPTIONS: dict[str, Any] = {**INNER_OPTIONS, "pipeline_class": _VectorStepCompiler}
"""The same options for kernels whose inner loops go over many rows."""
# Numba has no types for these options.
_compile: Any = njit
F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a function that can be called from Python; for other kernels it is a step."""
    made = _compile(**KERNEL_OPTIONS, nogil=True)(function)
    copy: Any = FunctionType(function.__code__, function.__globals__, function.__name__)
    copy.__qualname__ = f"{function.__qualname__}_step"  # a name of its own in Numba's cache
    step: Any = kernel_step(copy)
    made.get_call_template, made.get_overload = step.get_call_template, step.get_overload
    return made


def kernel_step(function: F) -> F:
    """Compile a function that only kernels call; a call from Python would crash the process.

    The compiled function has no Python wrapper, because for many array arguments the wrapper takes
    longer to compile than the function.
    """
    return _compile(**INNER_OPTIONS)(function)


def kernel_value(function: F) -> F:
    """Compile a small function of scalars inline in the kernels that call it.

    The compiler can then keep its result, such as a tuple of nine numbers, in registers.
    """
    return _compile(**INNER_OPTIONS, forceinline=True)(function)


class _CollectionListener(event.Listener):
    """Pauses the search for unreachable objects, because the compiler keeps millions of objects."""

    def __init__(self) -> None:
        self._was_enabled: list[bool] = []  # a kernel is compiled while its caller is

    def on_start(self, event: object) -> None:
        self._was_enabled.append(gc.isenabled())
        gc.disable()

    def on_end(self, event: object) -> None:
        if self._was_enabled.pop():
            gc.enable()


event.register("numba:compile", _CollectionListener())


class _CompilationListener(event.Listener):
    def __init__(self, begun: Callable[[], None], after: float):
        self._begun: Callable[[], None] | None = begun
        self._after, self._first = after, inf

    def on_start(self, event: object) -> None:
        self._first = min(self._first, process_time())
        if process_time() < self._first + self._after:
            return
        begun, self._begun = self._begun, None
        if begun is not None:
            begun()

    def on_end(self, event: object) -> None:
        pass


@contextmanager
def on_compilation(begun: Callable[[], None], after: float = 0.0) -> Generator[None]:
    """Call a function as soon as a kernel in the `with` block must be compiled, not loaded.

    With `after`, s, call it when another kernel must be compiled after this processor time.
    """
    listener = _CompilationListener(begun, after)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)


_SHARED_SECONDS = 1.5  # of the compilation of the steps that both filters use
_MOST_SECONDS = 120  # after which the other process of `compile_beside` is ended


@contextmanager
def compile_beside(work: Callable[[], object], after: float = _SHARED_SECONDS) -> Generator[None]:
    """Let another process do some work too if the kernels in the `with` block are compiled.

    Its results are ignored, but when the block ends, its kernels are in the cache. It starts
    `after` some processor time, s, because both processes would compile the first steps, which the
    kernels share. Without a second core, or on a system that cannot fork, this process compiles all
    kernels.
    """
    others: list[int] = []

    def begin() -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of threads: the other process only computes
            other = os.fork()
        if other:
            others.append(other)
            return
        try:
            signal.alarm(_MOST_SECONDS)
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            os.closerange(3, 2**16)  # this process alone ends its connections
            work()
        finally:
            os._exit(0)

    both = sys.platform == "linux" and available_cores() > 1
    with on_compilation(begin, after) if both else nullcontext():
        try:
            yield
        finally:
            for other in others:
                with suppress(ChildProcessError):
                    os.waitpid(other, 0)
