"""Compile kernels in fewer passes than Numba, and into fewer instructions.

Numba's pipeline searches each function for features that kernels do not use, such as closures,
`with` blocks and expressions of arrays, and orders the release of each variable, although kernels
count no references. It also generates about 40 instructions for each item of an array, 50 for each
loop and 40 for each of its steps, and most of the compiler's time is proportional to the number of
instructions. Here an item takes about 10 instructions, a loop 15 and its step 10. The machine code
does the same arithmetic in the same order.
"""
# Numba and llvmlite have no types.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportIncompatibleMethodOverride=false, reportAttributeAccessIssue=false
# pyright: reportArgumentType=false, reportCallIssue=false

from typing import Any

from llvmlite import ir
from numba.core import cgutils, compiler, ir_utils, lowering, typed_passes, types, untyped_passes
from numba.core.compiler_machinery import PassManager, register_pass

_ITEMS, _ITEM_BYTES, _DATA, _SHAPE, _STRIDES = range(2, 7)  # fields of an array
_AT, _STOP, _STEP, _LEFT = range(4)  # fields of the iterator of a range; a range has three of them


class _Lower(lowering.Lower):
    """Generates the instructions of a kernel."""

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Read an item of an array, or make a view of a part of it."""
        kind, builder = signature.args[0], self.builder
        if (depth := _indexed_axes(kind, self.typeof(index.name))) == 0:
            return super().lower_getitem(resty, expr, value, index, signature)
        array = self.loadvar(value.name)
        place = self._place(kind, array, index)
        if depth == kind.ndim:
            return self.context.unpack_value(builder, kind.dtype, place)
        view, count = ir.Constant(self.context.get_value_type(resty), None), ir.IntType(64)(1)
        for axis in range(depth, kind.ndim):
            size = builder.extract_value(array, [_SHAPE, axis])
            step = builder.extract_value(array, [_STRIDES, axis])
            count = builder.mul(count, size)
            view = builder.insert_value(view, size, [_SHAPE, axis - depth])
            view = builder.insert_value(view, step, [_STRIDES, axis - depth])
        size = builder.extract_value(array, _ITEM_BYTES)
        for field, one in ((_ITEMS, count), (_ITEM_BYTES, size), (_DATA, place)):
            view = builder.insert_value(view, one, field)
        return view

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write an item of an array."""
        kind = signature.args[0]
        depth = _indexed_axes(kind, self.typeof(index_var.name))
        if depth == 0 or depth < kind.ndim:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        place = self._place(kind, self.loadvar(target_var.name), index_var)
        value, of = self.loadvar(value_var.name), self.typeof(value_var.name)
        value = self.context.cast(self.builder, value, of, kind.dtype)
        self.context.pack_value(self.builder, kind.dtype, value, place)

    def _place(self, kind: Any, array: Any, index: Any) -> Any:
        """Return the address of an item, or of the first item of a part of an array."""
        builder, by, given = self.builder, self.typeof(index.name), self.loadvar(index.name)
        is_tuple, offset = isinstance(by, types.BaseTuple), ir.IntType(64)(0)
        for axis, one in enumerate(by if is_tuple else (by,)):
            size = builder.extract_value(array, [_SHAPE, axis])
            at = builder.extract_value(given, axis) if is_tuple else given
            at = self.context.cast(builder, at, one, types.intp)
            if not isinstance(one, types.IntegerLiteral) or one.literal_value < 0:
                from_end = builder.icmp_signed("<", at, at.type(0))
                at = builder.select(from_end, builder.add(at, size), at)
            if kind.layout == "C":
                offset = builder.add(builder.mul(offset, size, flags=["nsw"]), at, flags=["nsw"])
            else:
                step = builder.extract_value(array, [_STRIDES, axis])
                offset = builder.add(offset, builder.mul(at, step))
        data = builder.extract_value(array, _DATA)
        if kind.layout != "C":
            return cgutils.pointer_add(builder, data, offset)
        for axis in range(_indexed_axes(kind, by), kind.ndim):
            offset = builder.mul(offset, builder.extract_value(array, [_SHAPE, axis]))
        return builder.gep(data, [offset], inbounds=True)

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        """Begin a loop over a range, or take its next step."""
        builder, of = self.builder, expr.value.name if expr.op in _LOOPS else None
        if expr.op in ("pair_first", "pair_second"):
            return builder.extract_value(self.loadvar(of), int(expr.op == "pair_second"))
        if expr.op == "iternext" and isinstance(self.typeof(of), types.RangeIteratorType):
            at, step, left = (
                builder.extract_value(self.loadvar(of), k) for k in (_AT, _STEP, _LEFT)
            )
            value, count = builder.load(at), builder.load(left)
            builder.store(builder.add(value, step, flags=["nsw"]), at)
            builder.store(builder.sub(count, count.type(1), flags=["nsw"]), left)
            return self._structure(resty, value, builder.icmp_signed(">", count, count.type(0)))
        if expr.op == "getiter" and isinstance(resty, types.RangeIteratorType):
            made = ir_utils.guard(ir_utils.get_definition, self.func_ir, expr.value)
            if made is not None and len(made.args) < 3:  # steps of 1
                limits = self.loadvar(of)
                first, stop, step = (builder.extract_value(limits, k) for k in range(3))
                at, left = (cgutils.alloca_once(builder, first.type) for _ in range(2))
                builder.store(first, at)
                builder.store(builder.sub(stop, first, flags=["nsw"]), left)
                return self._structure(resty, at, stop, step, left)
        return super().lower_expr(resty, expr)

    def _structure(self, kind: Any, *fields: Any) -> Any:
        made = ir.Constant(self.context.get_value_type(kind), ir.Undefined)
        for k, field in enumerate(fields):
            made = self.builder.insert_value(made, field, k)
        return made


_LOOPS = ("pair_first", "pair_second", "getiter", "iternext")


def _indexed_axes(kind: Any, by: Any) -> int:
    """Return the number of axes that an index of whole numbers fixes; 0 for any other index."""
    each = tuple(by) if isinstance(by, types.BaseTuple) else (by,)
    simple = isinstance(kind, types.Array) and all(isinstance(one, types.Integer) for one in each)
    return len(each) if simple else 0


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(typed_passes.NativeLowering):
    _name = "kernel_lowering"

    @property
    def lowering_class(self) -> type[_Lower]:
        """The class that generates the instructions."""
        return _Lower


_PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,  # constant indices
    untyped_passes.InlineInlinables,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.AnnotateTypes,
    _Lowering,
    typed_passes.NoPythonBackend,
)


class KernelCompiler(compiler.CompilerBase):
    """Compiles kernels: functions of numbers and arrays that neither allocate nor raise."""

    def define_pipelines(self) -> Any:
        """Return the passes."""
        manager = PassManager("kernel")
        for one in _PASSES:
            manager.add_pass(one, one.__name__)
        manager.finalize()
        return [manager]
