"""How a test that injects a fault fails: silently, with a traceback, or with an outcome not listed."""

import traceback
from typing import Literal

import pytest

from strandcast.errors import StrandcastError

Kind = Literal["silent", "traceback", "wrong"]


class SilentFault(AssertionError):
    """A fault was injected, and neither an error nor a warning came of it."""


def kind_of(failure: BaseException) -> Kind:
    """Return the kind of a test's failure."""
    if isinstance(failure, SilentFault) or _did_not_raise(failure):
        return "silent"
    if "Traceback (most recent call last)" in str(failure) or _within_product(failure):
        return "traceback"
    return "wrong"


def _did_not_raise(failure: BaseException) -> bool:
    return isinstance(failure, pytest.fail.Exception) and "DID NOT RAISE" in str(failure)


def _within_product(failure: BaseException) -> bool:
    """Return whether an exception that is no `StrandcastError` came out of strandcast's own functions."""
    if isinstance(failure, StrandcastError):
        return False
    frames = traceback.extract_tb(failure.__traceback__)
    return any("/src/strandcast/" in frame.filename for frame in frames)
