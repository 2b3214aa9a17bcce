"""Errors of the system and of exhausted memory are one message, whatever library they come from."""

import errno
import io
import subprocess
import sys

import pytest

from strandcast.cli.common import show
from strandcast.cli.host_problems import problem_of
from strandcast.cli.main import guarded


def test_an_8_bit_output_loses_letters_of_lines_and_none_of_json(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.TextIOWrapper(io.BytesIO(), encoding="latin-1")
    monkeypatch.setattr(sys, "stdout", out)
    for as_json in (False, True):
        guarded(lambda as_json=as_json: show(as_json, {"file": "Łódź"}, ["ä…"]))
    out.seek(0)
    assert out.buffer.read() == b'\xe4?\n{"file": "\\u0141\\u00f3d\\u017a"}\n'


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MemoryError("Unable to allocate 3.2 GiB for an array"), "SC-W004", "Unable to allocate 3.2 GiB"),
        (MemoryError(), "SC-W004", "MemoryError"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "SC-W004", "Cannot allocate memory"),
        (ImportError("cv2.abi3.so: failed to map segment from shared object"), "SC-W004", "cv2.abi3.so"),
        (RuntimeError("can't start new thread"), "SC-W004", "new thread"),
        (
            BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
            "SC-W004",
            "temporarily unavailable",
        ),
        (RuntimeError("cannot cache function 'f': no locator available"), "SC-W002", "compiled code"),
        (OSError(errno.ENOSPC, "No space left on device"), "SC-W002", "No space left on device; free: "),
        (
            PermissionError(errno.EACCES, "Permission denied", "a.json"),
            "SC-W002",
            "a.json: Permission denied",
        ),
    ],
)
def test_an_error_of_the_host_is_one_of_ours(error: Exception, code: str, words: str) -> None:
    problem = problem_of(error)
    assert problem is not None
    assert problem.code == code
    assert words in problem.message()
    assert problem.fix


@pytest.mark.parametrize("error", [ValueError("no"), ImportError("no module"), RuntimeError("other")])
def test_a_programming_error_stays_one(error: Exception) -> None:
    assert problem_of(error) is None


def test_memory_that_is_not_there_is_reported_with_the_limit() -> None:
    code = (
        "import resource, numpy as np\n"
        "from strandcast.cli.host_problems import problem_of\n"
        "resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000, 2_000_000_000))\n"
        "try:\n    np.ones(1 << 30)\nexcept MemoryError as error:\n    print(problem_of(error))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "SC-W004 ERROR  there is too little memory (Unable to allocate 8.00 GiB" in done.stdout
    assert "`ulimit -v` allows 2 GB" in done.stdout


def test_a_library_that_does_not_load_under_a_small_limit_means_memory() -> None:
    code = (
        "import resource\nfrom strandcast.cli.host_problems import problem_of\n"
        "resource.setrlimit(resource.RLIMIT_AS, (200_000_000, 200_000_000))\n"
        "try:\n    import cv2\nexcept Exception as error:\n    print(problem_of(error))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "SC-W004" in done.stdout
