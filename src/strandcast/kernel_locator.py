"""Where numba keeps the machine code of this package's kernels: by content, wherever the package lies."""

import gc
from pathlib import Path
from typing import Any

from numba.core import event
from numba.core.caching import UserProvidedCacheLocator

from strandcast.kernel_cache import PACKAGE, kernels_sha256
from strandcast.progress import Progress


class KernelLocator(UserProvidedCacheLocator):
    """A locator that a second clone, or the same one in another folder, shares.

    The machine code is current if the code of all kernels is (`strandcast.kernel_cache`): neither a kernel's
    path nor its line nor the comments around it matter.
    """

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Return a locator for a function of this package; None for others."""
        return super().from_function(py_func, py_file) if PACKAGE in Path(py_file).parents else None

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the file's folder within the package."""
        return str(Path(py_file).parent.relative_to(PACKAGE))

    def get_source_stamp(self) -> str:
        """Return the hash of all that machine code depends on."""
        return kernels_sha256()

    def get_disambiguator(self) -> str:
        """Return the same for all functions: within a file, their names differ."""
        return ""


class _Compiling(event.Listener):
    """Says that kernels are compiled, and how many were."""

    def __init__(self) -> None:
        self.count, self.progress = 0, Progress("compiling kernels, once")
        self.depth, self.threshold = 0, gc.get_threshold()

    def on_start(self, event: Any) -> None:
        self.count += 1
        self.progress(self.count)
        self.depth += 1
        if self.depth == 1:
            # Compiling keeps millions of objects: by default, a tenth of its time is a search for cycles.
            self.threshold = gc.get_threshold()
            gc.set_threshold(max(self.threshold[0], 50_000) if self.threshold[0] else 0, 20, 50)

    def on_end(self, event: Any) -> None:
        self.depth -= 1
        if self.depth == 0:
            gc.set_threshold(*self.threshold)


event.register("numba:compile", _Compiling())
