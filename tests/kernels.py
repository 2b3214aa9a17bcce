"""A plug-in of pytest for `make test-kernels`: it fails where a kernel of the package was not compiled.

What numba refuses depends on the version of Python. A kernel counts as compiled if it was called, or if one
that was called calls it.
"""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import strandcast

PACKAGE = Path(strandcast.__file__).parent


def all_kernels() -> dict[str, Any]:
    """Return the package's kernels by module and name."""
    files = sorted(path for path in PACKAGE.rglob("*.py") if "@njit" in path.read_text(encoding="utf-8"))
    names = [".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in files]
    found = ((module, name, each) for module in names for name, each in vars(import_module(module)).items())
    return {
        f"{module}.{name}": each
        for module, name, each in found
        if isinstance(each, Dispatcher) and each.py_func.__module__ == module
    }


def called_by(kernel: Any) -> Iterator[Any]:
    """Yield the kernels that a kernel's code names."""
    code, names = kernel.py_func.__code__, kernel.py_func.__globals__
    yield from (names[name] for name in code.co_names if isinstance(names.get(name), Dispatcher))
    for cell in kernel.py_func.__closure__ or ():
        if isinstance(cell.cell_contents, Dispatcher):
            yield cell.cell_contents


def not_compiled(kernels: dict[str, Any]) -> list[str]:
    """Return the names of those that no call has reached."""
    reached: list[Any] = []
    left = [each for each in kernels.values() if each.overloads]
    while left:
        each = left.pop()
        if each not in reached:
            reached.append(each)
            left += called_by(each)
    return [name for name, each in kernels.items() if each not in reached]


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run that left kernels out."""
    kernels = all_kernels()
    left = not_compiled(kernels)
    print(f"\n{len(kernels) - len(left)} of {len(kernels)} kernels compiled")
    if left:
        print("not compiled:", *left, sep="\n  ")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
