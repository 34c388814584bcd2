"""Named tuples of arrays that kernels receive by reference.

Numba passes a named tuple by value, so each call of a kernel would pass hundreds of numbers, and
the compiler would need most of its time for them. A `record` is stored in memory once per call from
Python, without copying the data of its arrays, and the kernels share its address. They can read its
fields by name, but cannot create, unpack or return it.
"""
# Numba has no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from functools import cache
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
_WORD = 8  # bytes; each field begins at a multiple


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
    begins, _ = _layout(context, record)
    k = record.cls._fields.index(name)
    return builder.load(_field(context, builder, record.fields[k], place, begins[k]))


@unbox(RecordType)
def _store(record: RecordType, instance: Any, c: Any) -> NativeValue:
    begins, size = _layout(c.context, record)
    words = ir.ArrayType(ir.IntType(8 * _WORD), size // _WORD)
    place = c.builder.bitcast(cgutils.alloca_once(c.builder, words), cgutils.voidptr_t)
    failed = cgutils.false_bit
    for k, (kind, begin) in enumerate(zip(record.fields, begins, strict=True)):
        item = c.pyapi.tuple_getitem(instance, k)
        if isinstance(kind, types.Array):
            at = cgutils.pointer_add(c.builder, place, begin)
            wrong = cgutils.is_not_null(c.builder, c.pyapi.numba_array_adaptor(item, at))
        else:
            native = c.unbox(kind, item)
            wrong = native.is_error
            c.builder.store(native.value, _field(c.context, c.builder, kind, place, begin))
        failed = c.builder.or_(failed, wrong)
    return NativeValue(place, is_error=failed)


def _field(context: Any, builder: Any, kind: types.Type, place: Any, begin: int) -> Any:
    """Return the address of a field."""
    pointer = context.get_value_type(kind).as_pointer()
    return builder.bitcast(cgutils.pointer_add(builder, place, begin), pointer)


@cache  # because Numba computes a size by parsing a module
def _layout(context: Any, record: RecordType) -> tuple[list[int], int]:
    """Return where the fields begin, and the size of the record, in bytes."""
    begins, size = [], 0
    for kind in record.fields:
        begins.append(size)
        size += -(-context.get_abi_sizeof(context.get_value_type(kind)) // _WORD) * _WORD
    return begins, size
