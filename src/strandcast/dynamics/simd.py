"""Functions of vectors of candidates, or of plain numbers, for numba kernels.

`load` and `store` move values between registers and rows of an array whose last axis is the candidate.
"""

import math
import platform
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from strandcast.dynamics.vectors import (
    CACHED,
    INLINED,
    SimdVector,
    VectorSpecType,
    broadcast,
    register_bits,
    vector_of,
    vector_type_of,
)

__all__ = ["CACHED", "INLINED"]

_X86 = platform.machine().lower() in ("x86_64", "amd64", "i386", "i686")


def _row(context: Any, builder: Any, spec: VectorSpecType, array_type: Any, array: Any, row: Any) -> Any:
    """Pointer to row `row` of a contiguous array whose last axis is the candidate."""
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.gep(data, [builder.mul(row, ir.Constant(ir.IntType(64), spec.width))], inbounds=True)
    return builder.bitcast(first, context.get_value_type(spec.value).as_pointer())


@intrinsic
def load(typing: Any, spec: Any, array: Any, row: Any) -> Any:
    """Value of `array` (rows, width) at `row`."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _row(context, builder, spec, array, args[1], args[2])
        return builder.load(place, align=spec.bits // 8)

    return spec.value(spec, array, types.intp), lower


@intrinsic
def store(typing: Any, spec: Any, array: Any, row: Any, value: Any) -> Any:
    """Write `value` to `array` (rows, width) at `row`."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _row(context, builder, spec, array, args[1], args[2])
        builder.store(args[3], place, align=spec.bits // 8)
        return context.get_dummy_value()

    return types.void(spec, array, types.intp, spec.value), lower


@intrinsic
def splat(typing: Any, spec: Any, number: Any) -> Any:
    """Put one number into all lanes."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(spec.value, SimdVector):
            return broadcast(builder, args[1], spec.value)
        return context.cast(builder, args[1], types.float64, spec.value)

    return spec.value(spec, types.float64), lower


@intrinsic
def select(typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """Choose `a` where `mask` is true, else `b`."""
    lanes = vector_type_of((a, b))
    result: Any = a if lanes is None else lanes

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        chosen = args[1:]
        if lanes is not None:
            chosen = [
                value if isinstance(typ, SimdVector) else broadcast(builder, value, lanes)
                for value, typ in zip(chosen, (a, b), strict=True)
            ]
        return builder.select(args[0], *chosen)

    return result(mask, a, b if lanes is not None else a), lower


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Square root."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        suffix = f"v{a.width}f{a.bits}" if isinstance(a, SimdVector) else f"f{a.bitwidth}"
        typ = args[0].type
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(typ, [typ]), f"llvm.sqrt.{suffix}"
        )
        return builder.call(function, args)

    return a(a), lower


@intrinsic
def is_double(typing: Any, spec: Any) -> Any:
    """Whether the numbers of `spec` have 64 bits: a constant, so that LLVM keeps one branch only."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.get_constant(types.boolean, spec.bits == 64)

    return types.boolean(spec), lower


def _estimated(name: str) -> Callable[..., Any]:
    """Lowering of the processor's own estimate, to 14 bits; the plain quotient where it has none."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes = sig.args[0]
        vector = vector_of(lanes)
        whole = ir.IntType(lanes.width)
        suffix = f"{name}.{'ps' if lanes.bits == 32 else 'pd'}.512"
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector, vector, whole]), f"llvm.x86.avx512.{suffix}"
        )
        return builder.call(function, [args[0], ir.Constant(vector, ir.Undefined), ir.Constant(whole, -1)])

    return lower


@intrinsic
def _rough_inverse_root(typing: Any, a: Any) -> Any:
    return a(a), _estimated("rsqrt14")


@intrinsic
def _rough_inverse(typing: Any, a: Any) -> Any:
    return a(a), _estimated("rcp14")


def _divides(a: Any) -> bool:
    """Whether there is no estimate for such a type: only AVX-512 has one."""
    return not (isinstance(a, SimdVector) and a.width * a.bits == 512 == register_bits())


def inverse_root(spec: Any, a: Any) -> Any:
    """1 / square root, to the last bits: dividers are slow, an estimate and Newton's steps are not."""
    return 1.0 / math.sqrt(a)


@overload(inverse_root, jit_options=INLINED)
def _inverse_root(spec, a):  # type: ignore[no-untyped-def]
    if _divides(a):
        return lambda spec, a: 1.0 / root(a)

    def refined(spec, a):  # type: ignore[no-untyped-def]
        y = _rough_inverse_root(a)
        half = 0.5 * a
        y = y * (1.5 - half * (y * y))
        if is_double(spec):
            y = y * (1.5 - half * (y * y))
        return y

    return refined


def inverse(spec: Any, a: Any) -> Any:
    """1 / a, to the last bits."""
    return 1.0 / a


@overload(inverse, jit_options=INLINED)
def _inverse(spec, a):  # type: ignore[no-untyped-def]
    if _divides(a) or spec.bits == 64:
        return lambda spec, a: 1.0 / a

    def refined(spec, a):  # type: ignore[no-untyped-def]
        y = _rough_inverse(a)
        return y * (2.0 - a * y)

    return refined


@intrinsic
def flush_denormals(typing: Any, control: Any) -> Any:
    """Set the processor's float control to `control`, or to flushing denormals if negative; the old one.

    f32 powers of a small angle are denormal and cost a hundred cycles each. x86 only, else nothing.
    """

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not _X86:
            return args[0]
        place = cgutils.alloca_once(builder, ir.IntType(32))
        # The kernel's whole stack is then aligned: vectors that it holds there do not straddle cache lines.
        place.align = 64
        pointer = builder.bitcast(place, ir.IntType(8).as_pointer())
        takes_pointer = ir.FunctionType(ir.VoidType(), [pointer.type])
        builder.call(
            cgutils.get_or_insert_function(builder.module, takes_pointer, "llvm.x86.sse.stmxcsr"), [pointer]
        )
        old = builder.zext(builder.load(place), ir.IntType(64))
        flushing = builder.or_(old, ir.Constant(ir.IntType(64), 0x8040))
        wanted = builder.select(
            builder.icmp_signed("<", args[0], ir.Constant(ir.IntType(64), 0)), flushing, args[0]
        )
        builder.store(builder.trunc(wanted, ir.IntType(32)), place)
        builder.call(
            cgutils.get_or_insert_function(builder.module, takes_pointer, "llvm.x86.sse.ldmxcsr"), [pointer]
        )
        return old

    return types.int64(types.int64), lower


@njit(**INLINED)
def minimum(a: Any, b: Any) -> Any:
    """Return the smaller of two values; `b` where one is NaN."""
    return select(a < b, a, b)


@njit(**INLINED)
def maximum(a: Any, b: Any) -> Any:
    """Return the larger of two values; `b` where one is NaN."""
    return select(a > b, a, b)
