"""Compile kernels before the stages need them: on a core that is idle while the first motion is planned.

`kernels_ahead.json` holds the kernels that stages call and the types of their arguments, as
`python -m strandcast_studies.kernel_signatures` notes them. Kernels for the vectors of one kind of processor
are left to the stages. A kernel that is missing there is compiled when it is first called.
"""

import json
import os
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import types

from strandcast.kernel_cache import COMPILED_AHEAD

SIGNATURES = Path(__file__).with_suffix(".json")
NICENESS = 5


def type_of(description: Any) -> Any:
    """Return the numba type that `strandcast_studies.kernel_signatures` describes."""
    if isinstance(description, str):
        return getattr(types, description if description != "bool" else "boolean")
    if description[0] == "array":
        _, dtype, dimensions, layout, mutable = description
        return types.Array(type_of(dtype), dimensions, layout, readonly=not mutable)
    _, fields, *kinds = description
    return types.BaseTuple.from_types(list(map(type_of, kinds)), fields and _named(fields))


def compile_all() -> None:
    """Compile each kernel for the types of its arguments, unless that is done."""
    for name, signatures in json.loads(SIGNATURES.read_text(encoding="utf-8")).items():
        for signature in signatures:
            _named(name).compile(tuple(map(type_of, signature)))


def _named(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


if __name__ == "__main__":
    os.nice(NICENESS)
    compile_all()
    Path(os.environ["NUMBA_CACHE_DIR"], COMPILED_AHEAD).touch()
