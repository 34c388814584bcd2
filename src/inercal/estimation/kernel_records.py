"""Pass named tuples of arrays to kernels by reference.

Numba passes a named tuple by value, so each call of a kernel would pass hundreds of numbers, and
the compiler would need most of its time for them. A `record` is stored in memory once per call from
Python, without copying the data of its arrays, and the kernels share its address. They can read its
fields by name, but cannot create, unpack or return it.
"""
# Numba and llvmlite have no types.
# pyright: reportMissingTypeStubs=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from typing import Any, TypeVar
from zlib import crc32

from llvmlite import ir
from numba import types
from numba.core import cgutils
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
