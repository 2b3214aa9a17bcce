"""Several candidates side by side in one vector register: a value type for numba kernels.

LLVM does not vectorise a loop over candidates by itself, because it cannot prove that rows of the work arrays
do not overlap.
Here the vector is a value like any number, so that a kernel keeps a chain of them in registers. A kernel is
written once; its `VectorSpec` specifies vectors or plain numbers.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import types
from numba.core import config
from numba.core.datamodel import register_default
from numba.core.datamodel.models import OpaqueModel, PrimitiveModel
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import NativeValue, lower_builtin, typeof_impl, unbox

KERNEL: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
CACHED = KERNEL | {"cache": True}
# Such a function makes no array and counts no references to arrays: counting took a fifth of a step in space.
INLINED = KERNEL | {"forceinline": True, "_nrt": False}

# Contraction to fused multiply-add only: infinities and NaN of a blow-up stay visible.
_FLAGS = ("contract",)


@dataclass(frozen=True)
class VectorSpec:
    """How the values of a kernel are held: `width` numbers of `bits` each, plain numbers if 1."""

    bits: int
    width: int

    @property
    def dtype(self) -> type[np.floating[Any]]:
        """The numpy type of one number."""
        return np.float64 if self.bits == 64 else np.float32


def register_bits() -> int:
    """Size of the vector registers of the processors that numba compiles for; this one may have more."""
    if config.CPU_FEATURES == "":  # then the name says all: a level of x86-64, or any processor
        return {"x86-64-v4": 512, "x86-64-v3": 256}.get(config.CPU_NAME, 128)
    features = get_host_cpu_features()
    return 512 if features.get("avx512f") else 256 if features.get("avx") else 128


class VectorSpecType(types.Opaque):
    """Type of a `VectorSpec`; kernels are compiled for each."""

    def __init__(self, bits: int, width: int) -> None:
        self.bits = bits
        self.width = width
        element = types.float64 if bits == 64 else types.float32
        self.value = element if width == 1 else SimdVector(bits, width)
        super().__init__(name=f"VectorSpec({bits}, {width})")


class SimdVector(types.Type):
    """Type of a vector of numbers."""

    def __init__(self, bits: int, width: int) -> None:
        self.bits = bits
        self.width = width
        super().__init__(name=f"SimdVector({bits}, {width})")


class Mask(types.Type):
    """Type of a vector of truth values."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Mask({width})")


@register_default(VectorSpecType)
class _VectorSpecModel(OpaqueModel):
    pass


@register_default(SimdVector)
class _SimdVectorModel(PrimitiveModel):
    def __init__(self, manager: Any, lanes: SimdVector) -> None:
        super().__init__(manager, lanes, vector_of(lanes))


@register_default(Mask)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: Any, mask: Mask) -> None:
        super().__init__(manager, mask, ir.VectorType(ir.IntType(1), mask.width))


@typeof_impl.register(VectorSpec)
def _typeof_vector_spec(spec: VectorSpec, context: Any) -> VectorSpecType:
    return VectorSpecType(spec.bits, spec.width)


@unbox(VectorSpecType)
def _unbox_vector_spec(typ: VectorSpecType, obj: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def vector_of(lanes: SimdVector) -> ir.VectorType:
    """Return the LLVM type of a vector."""
    element = ir.DoubleType() if lanes.bits == 64 else ir.FloatType()
    return ir.VectorType(element, lanes.width)


def broadcast(builder: Any, value: Any, lanes: SimdVector) -> Any:
    """Put one float, of whichever precision, into all lanes."""
    vector = vector_of(lanes)
    if value.type != vector.element:
        narrower = isinstance(vector.element, ir.FloatType)
        value = (builder.fptrunc if narrower else builder.fpext)(value, vector.element)
    if isinstance(value, ir.Constant):
        return ir.Constant(vector, [value.constant] * lanes.width)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes.width), None)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


def vector_type_of(args: tuple[types.Type, ...]) -> SimdVector | None:
    """Return the vector type among `args`, if the others are the same or single floats."""
    found = [arg for arg in args if isinstance(arg, SimdVector)]
    others = [arg for arg in args if not isinstance(arg, SimdVector)]
    if found and len(set(found)) == 1 and all(isinstance(arg, types.Float) for arg in others):
        return found[0]
    return None


def _binary(operation: Callable[..., Any], emit: Callable[..., Any], compares: bool = False) -> None:
    """Teach numba `operation` on two vectors, or a vector and a single float."""

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            lanes = vector_type_of(args) if len(args) == 2 else None
            if lanes is None:
                return None
            return signature(Mask(lanes.width) if compares else lanes, *args)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes: Any = vector_type_of(sig.args)
        vectors = [
            value if isinstance(typ, SimdVector) else broadcast(builder, value, lanes)
            for value, typ in zip(args, sig.args, strict=True)
        ]
        return emit(builder, *vectors)

    for pair in ((SimdVector, SimdVector), (SimdVector, types.Float), (types.Float, SimdVector)):
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
        return signature(args[0], args[0]) if isinstance(args[0], SimdVector) else None


@lower_builtin(operator.neg, SimdVector)
def _negate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=_FLAGS)
