"""The peak rate of multiply-adds of this processor's cores, in registers and with hidden latency."""

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import llvmlite.binding as llvm

from strandcast.dynamics.vectors import register_bits

CHAINS = 14  # vectors in flight: two units of five clock cycles need ten; there are sixteen registers
_ELEMENT = {64: "double", 32: "float"}


def _source(bits: int) -> str:
    """Return LLVM code: `CHAINS` vectors with `turns` multiply-adds each, summed at the end."""
    width, element = register_bits() // bits, _ELEMENT[bits]
    vector, fma = f"<{width} x {element}>", f"llvm.fma.v{width}f{bits}"
    chains = range(CHAINS)
    start = "\n".join(f"  %a{c} = phi {vector} [ %x, %entry ], [ %b{c}, %loop ]" for c in chains)
    body = "\n".join(
        f"  %b{c} = call {vector} @{fma}({vector} %a{c}, {vector} %x, {vector} %y)" for c in chains
    )
    total = "\n".join(f"  %s{c + 1} = fadd {vector} {f'%s{c}' if c else '%x'}, %b{c}" for c in chains)
    return f"""
declare {vector} @{fma}({vector}, {vector}, {vector})
define {element} @peak(i64 %turns, {element} %factor, {element} %add) {{
entry:
  %x0 = insertelement {vector} poison, {element} %factor, i32 0
  %x = shufflevector {vector} %x0, {vector} poison, <{width} x i32> zeroinitializer
  %y0 = insertelement {vector} poison, {element} %add, i32 0
  %y = shufflevector {vector} %y0, {vector} poison, <{width} x i32> zeroinitializer
  br label %loop
loop:
  %k = phi i64 [ 0, %entry ], [ %next, %loop ]
{start}
{body}
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %turns
  br i1 %more, label %loop, label %done
done:
{total.replace("%s0", "%x")}
  %first = extractelement {vector} %s{CHAINS}, i32 0
  ret {element} %first
}}
"""


@dataclass(frozen=True, eq=False)
class Peak:
    """A compiled loop of multiply-adds.

    `call` runs it, from turns, factor and addend to the first lane's sum. Other threads can run meanwhile.
    """

    bits: int  # of a number: 64 or 32
    assembly: str  # the machine code
    call: Callable[[int, float, float], float]
    engine: object

    def operations(self, turns: int) -> float:
        """Return the additions and multiplications of one thread in `turns`."""
        return 2.0 * CHAINS * (register_bits() // self.bits) * turns

    def run(self, turns: int, threads: int) -> list[float]:
        """Run the loop on all threads at once; return their sums, so that none can be optimised away."""
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(partial(self.call, turns, 0.5), [1.0] * threads))


def compiled(bits: int) -> Peak:
    """Compile the loop for numbers of `bits` and this processor."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(_source(bits))
    module.verify()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3
    )
    assembly = machine.emit_assembly(module)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    number = ctypes.c_double if bits == 64 else ctypes.c_float
    call = ctypes.CFUNCTYPE(number, ctypes.c_int64, number, number)(engine.get_function_address("peak"))
    return Peak(bits, assembly, call, engine)
