"""Note which kernels the stages call, and the types of their arguments, from experiments that were run.

python -m strandcast_studies.kernel_signatures demo weighted > src/strandcast/kernels_ahead.json

One experiment should have weights on its string, and one none: other kernels find them.
"""

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from numba import types
from numba.core import dispatcher

from strandcast.stages.run import run_stage

STAGES = ("track", "reconstruct", "align", "estimate", "plan", "lab_throw", "calibrate")  # by compile time


def describe(kind: Any) -> Any:
    """Return a numba type as plain data, which `strandcast.kernels_ahead.type_of` reads.

    Raises
    ------
    ValueError
        It is none of numbers, arrays and tuples of these.
    """
    if isinstance(kind, types.Array):
        return ["array", str(kind.dtype), kind.ndim, kind.layout, kind.mutable]
    if isinstance(kind, (types.NamedTuple, types.NamedUniTuple)):
        fields = kind.instance_class
        return ["tuple", f"{fields.__module__}:{fields.__qualname__}", *map(describe, kind.types)]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", None, *map(describe, kind.types)]
    if isinstance(kind, (types.Number, types.Boolean)) and not isinstance(kind, types.Literal):
        return str(kind)
    raise ValueError(kind)


def note_calls(experiments: list[str], root: Path = Path()) -> dict[str, list[Any]]:
    """Run the stages of first trials again and return the signatures of the kernels they call, by kernel."""
    found: dict[str, list[Any]] = {}
    kernels = cast(Any, dispatcher.Dispatcher)
    compile_for = kernels._compile_for_args

    def note(kernel: Any, *arguments: Any, **keywords: Any) -> Any:
        name = f"{kernel.py_func.__module__}:{kernel.py_func.__qualname__}"
        with suppress(ValueError):
            kinds = [describe(kernel.typeof_pyval(argument)) for argument in arguments]
            if name.startswith("strandcast.") and kinds not in found.setdefault(name, []):
                found[name].append(kinds)
        return compile_for(kernel, *arguments, **keywords)

    kernels._compile_for_args = note
    try:
        for experiment in experiments:
            for stage in STAGES:
                run_stage(stage, root, experiment, 0 if stage == "calibrate" else 1)
    finally:
        kernels._compile_for_args = compile_for
    return {name: signatures for name, signatures in found.items() if signatures}


if __name__ == "__main__":
    noted = note_calls(sys.argv[1:])
    lines = (f"{json.dumps(name)}: {json.dumps(kinds)}" for name, kinds in noted.items())
    print("{\n" + ",\n".join(lines) + "\n}")
