"""numba's decorators for mypy: a compiled function keeps the signature that it was written with."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

F = TypeVar("F", bound=Callable[..., Any])

@overload
def njit(function: F, /) -> F: ...
@overload
def njit(**options: Any) -> Callable[[F], F]: ...

prange = range

def __getattr__(name: str) -> Any: ...
