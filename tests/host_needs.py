"""What some systems do not have: a test that needs it is skipped there, with the reason."""

import multiprocessing
import os

import pytest


def needs_terminals() -> None:
    """Skip a test where no pseudo-terminal can be opened, as in a chroot without /dev/pts."""
    try:
        descriptors = os.openpty()
    except OSError as error:
        pytest.skip(f"this system has no pseudo-terminals: {error}")
    for descriptor in descriptors:
        os.close(descriptor)


def needs_shared_locks() -> None:
    """Skip a test where processes can share no locks, as with a closed /dev/shm."""
    try:
        multiprocessing.get_context("fork").Lock()
    except OSError as error:
        pytest.skip(f"processes can share no locks here (/dev/shm): {error}")
