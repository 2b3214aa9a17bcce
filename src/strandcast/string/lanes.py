"""Several candidates side by side in one vector register: a value type for numba kernels.

LLVM does not vectorise a loop over candidates by itself, it cannot tell the rows of the work arrays apart.
Here the vector is a value like any number, so that a kernel keeps a chain of them in registers. A kernel is
written once, and takes a `Kind` that says whether its values are vectors or plain numbers; `load` and `store`
move them between registers and rows of an array whose last axis is the candidate.
"""

from __future__ import annotations

import math
import operator
import platform
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import njit, types
from numba.core import cgutils
from numba.core.datamodel import register_default
from numba.core.datamodel.models import OpaqueModel, PrimitiveModel
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    NativeValue,
    intrinsic,
    lower_builtin,
    overload,
    typeof_impl,
    unbox,
)

KERNEL: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
CACHED = KERNEL | {"cache": True}
INLINED = KERNEL | {"forceinline": True}

# Contraction to fused multiply-add only: infinities and NaN of a blow-up stay visible.
_FLAGS = ("contract",)


_X86 = platform.machine().lower() in ("x86_64", "amd64", "i386", "i686")


class Kind:
    """How the values of a kernel are held: `width` numbers of `bits` each, plain numbers if 1."""

    def __init__(self, bits: int, width: int) -> None:
        self.bits = bits
        self.width = width

    @property
    def dtype(self) -> type[np.floating[Any]]:
        """The numpy type of one number."""
        return np.float64 if self.bits == 64 else np.float32


def register_bits() -> int:
    """Size of this processor's vector registers."""
    features = get_host_cpu_features()
    for name, bits in (("avx512f", 512), ("avx", 256)):
        if features.get(name):
            return bits
    return 128


class KindType(types.Opaque):
    """Type of a `Kind`; kernels are compiled for each."""

    def __init__(self, bits: int, width: int) -> None:
        self.bits = bits
        self.width = width
        element = types.float64 if bits == 64 else types.float32
        self.value = element if width == 1 else Lanes(bits, width)
        super().__init__(name=f"Kind({bits}, {width})")


class Lanes(types.Type):
    """Type of a vector of numbers."""

    def __init__(self, bits: int, width: int) -> None:
        self.bits = bits
        self.width = width
        super().__init__(name=f"Lanes({bits}, {width})")


class Mask(types.Type):
    """Type of a vector of truth values."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Mask({width})")


@register_default(KindType)
class _KindModel(OpaqueModel):
    pass


@register_default(Lanes)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager: Any, lanes: Lanes) -> None:
        super().__init__(manager, lanes, _vector(lanes))


@register_default(Mask)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: Any, mask: Mask) -> None:
        super().__init__(manager, mask, ir.VectorType(ir.IntType(1), mask.width))


@typeof_impl.register(Kind)
def _typeof_kind(kind: Kind, context: Any) -> KindType:
    return KindType(kind.bits, kind.width)


@unbox(KindType)
def _unbox_kind(typ: KindType, obj: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def _vector(lanes: Lanes) -> ir.VectorType:
    element = ir.DoubleType() if lanes.bits == 64 else ir.FloatType()
    return ir.VectorType(element, lanes.width)


def _splat(builder: Any, value: Any, lanes: Lanes) -> Any:
    """Put one float, of whichever precision, into all lanes."""
    vector = _vector(lanes)
    if value.type != vector.element:
        narrower = isinstance(vector.element, ir.FloatType)
        value = (builder.fptrunc if narrower else builder.fpext)(value, vector.element)
    if isinstance(value, ir.Constant):
        return ir.Constant(vector, [value.constant] * lanes.width)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes.width), None)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


def _lanes_of(args: tuple[types.Type, ...]) -> Lanes | None:
    """Return the vector type among `args`, if the others are the same or single floats."""
    found = [arg for arg in args if isinstance(arg, Lanes)]
    others = [arg for arg in args if not isinstance(arg, Lanes)]
    if found and len(set(found)) == 1 and all(isinstance(arg, types.Float) for arg in others):
        return found[0]
    return None


def _binary(operation: Callable[..., Any], emit: Callable[..., Any], compares: bool = False) -> None:
    """Teach numba `operation` on two vectors, or a vector and a single float."""

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            lanes = _lanes_of(args) if len(args) == 2 else None
            if lanes is None:
                return None
            return signature(Mask(lanes.width) if compares else lanes, *args)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes: Any = _lanes_of(sig.args)
        vectors = [
            value if isinstance(typ, Lanes) else _splat(builder, value, lanes)
            for value, typ in zip(args, sig.args, strict=True)
        ]
        return emit(builder, *vectors)

    for pair in ((Lanes, Lanes), (Lanes, types.Float), (types.Float, Lanes)):
        lower_builtin(operation, *pair)(lower)


for _plus, _minus in ((operator.add, operator.sub), (operator.iadd, operator.isub)):
    _binary(_plus, lambda builder, a, b: builder.fadd(a, b, flags=_FLAGS))
    _binary(_minus, lambda builder, a, b: builder.fsub(a, b, flags=_FLAGS))
_binary(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_FLAGS))
_binary(operator.truediv, lambda builder, a, b: builder.fdiv(a, b, flags=_FLAGS))
_binary(operator.lt, lambda builder, a, b: builder.fcmp_ordered("<", a, b), compares=True)
_binary(operator.gt, lambda builder, a, b: builder.fcmp_ordered(">", a, b), compares=True)


@infer_global(operator.neg)
class _Negation(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0], args[0]) if isinstance(args[0], Lanes) else None


@lower_builtin(operator.neg, Lanes)
def _negate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=_FLAGS)


def _row(context: Any, builder: Any, kind: KindType, array_type: Any, array: Any, row: Any) -> Any:
    """Pointer to row `row` of a contiguous array whose last axis is the candidate."""
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.gep(data, [builder.mul(row, ir.Constant(ir.IntType(64), kind.width))], inbounds=True)
    return builder.bitcast(first, context.get_value_type(kind.value).as_pointer())


@intrinsic
def load(typing: Any, kind: Any, array: Any, row: Any) -> Any:
    """Value of `array` (rows, width) at `row`."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _row(context, builder, kind, array, args[1], args[2])
        return builder.load(place, align=kind.bits // 8)

    return kind.value(kind, array, types.intp), lower


@intrinsic
def store(typing: Any, kind: Any, array: Any, row: Any, value: Any) -> Any:
    """Write `value` to `array` (rows, width) at `row`."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _row(context, builder, kind, array, args[1], args[2])
        builder.store(args[3], place, align=kind.bits // 8)
        return context.get_dummy_value()

    return types.void(kind, array, types.intp, kind.value), lower


@intrinsic
def splat(typing: Any, kind: Any, number: Any) -> Any:
    """Put one number into all lanes."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(kind.value, Lanes):
            return _splat(builder, args[1], kind.value)
        return context.cast(builder, args[1], types.float64, kind.value)

    return kind.value(kind, types.float64), lower


@intrinsic
def select(typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """Choose `a` where `mask` is true, else `b`."""
    lanes = _lanes_of((a, b))
    result = a if lanes is None else lanes

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        chosen = args[1:]
        if lanes is not None:
            chosen = [
                value if isinstance(typ, Lanes) else _splat(builder, value, lanes)
                for value, typ in zip(chosen, (a, b), strict=True)
            ]
        return builder.select(args[0], *chosen)

    return result(mask, a, b if lanes is not None else a), lower


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Square root."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = f"v{a.width}f{a.bits}" if isinstance(a, Lanes) else f"f{a.bitwidth}"
        typ = args[0].type
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(typ, [typ]), f"llvm.sqrt.{kind}"
        )
        return builder.call(function, args)

    return a(a), lower


@intrinsic
def all_of(typing: Any, mask: Any) -> Any:
    """Whether `mask` is true in every lane."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(mask, Mask):
            return args[0]
        whole = ir.IntType(mask.width)
        return builder.icmp_unsigned("==", builder.bitcast(args[0], whole), ir.Constant(whole, -1))

    return types.boolean(mask), lower


@intrinsic
def is_double(typing: Any, kind: Any) -> Any:
    """Whether the numbers of `kind` have 64 bits: a constant, of which LLVM keeps one branch."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.get_constant(types.boolean, kind.bits == 64)

    return types.boolean(kind), lower


def _estimated(name: str) -> Callable[..., Any]:
    """Lowering of the processor's own estimate, to 14 bits; the plain quotient where it has none."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes = sig.args[0]
        vector = _vector(lanes)
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
    """Whether there is no estimate for such a type."""
    return not (isinstance(a, Lanes) and a.width * a.bits == 512)


def inverse_root(kind: Any, a: Any) -> Any:
    """1 / square root, to the last bits: dividers are slow, an estimate and Newton's steps are not."""
    return 1.0 / math.sqrt(a)


@overload(inverse_root, jit_options=KERNEL | {"forceinline": True})
def _inverse_root(kind, a):  # type: ignore[no-untyped-def]
    if _divides(a):
        return lambda kind, a: 1.0 / root(a)

    def refined(kind, a):  # type: ignore[no-untyped-def]
        y = _rough_inverse_root(a)
        half = 0.5 * a
        y = y * (1.5 - half * (y * y))
        if is_double(kind):
            y = y * (1.5 - half * (y * y))
        return y

    return refined


def inverse(kind: Any, a: Any) -> Any:
    """1 / a, to the last bits."""
    return 1.0 / a


@overload(inverse, jit_options=KERNEL | {"forceinline": True})
def _inverse(kind, a):  # type: ignore[no-untyped-def]
    if _divides(a) or kind.bits == 64:
        return lambda kind, a: 1.0 / a

    def refined(kind, a):  # type: ignore[no-untyped-def]
        y = _rough_inverse(a)
        return y * (2.0 - a * y)

    return refined


@intrinsic
def flush_denormals(typing: Any, control: Any) -> Any:
    """Set the processor's float control to `control`, or to flushing denormals if negative; the old one.

    f32 powers of a small angle are denormal, each of which costs a hundred cycles. x86 only, else nothing.
    """

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not _X86:
            return args[0]
        place = cgutils.alloca_once(builder, ir.IntType(32))
        pointer = builder.bitcast(place, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.sse.stmxcsr"), [pointer])
        old = builder.zext(builder.load(place), ir.IntType(64))
        flushing = builder.or_(old, ir.Constant(ir.IntType(64), 0x8040))
        wanted = builder.select(
            builder.icmp_signed("<", args[0], ir.Constant(ir.IntType(64), 0)), flushing, args[0]
        )
        builder.store(builder.trunc(wanted, ir.IntType(32)), place)
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.sse.ldmxcsr"), [pointer])
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
