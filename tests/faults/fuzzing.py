"""Damage of a file's bytes by a seeded generator, and the outcomes of reading what it leaves.

A damaged file may be refused, with a code and its name, or read. It must not end in another exception, take
minutes or gigabytes, or give another value where the file carries a hash of its own.
"""

import random
import re
import resource
import signal
import struct
import sys
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError

CPU_S = 30.0  # of one case; the slowest seed takes 0.2 s
LONGEST_MESSAGE = 1200  # characters, the file's path included
MOST_PROBLEMS = 50  # of one file
TOKEN = re.compile(rb"[\w.+-]+|\s+|.", re.DOTALL)
ODD = [
    *("", '"', "'", '"1"2', "1_0", "nan", "inf", "-1e300", "1e300", "1e999", "1e-320", "0", "-0", "-1", "7"),
    *(
        "1e9",
        "0x1",
        "0.1",
        "+.1e0",
        '"0.1"',
        " 0.12 ",
        "1,5",
        "1;5",
        "1.5",
        "2147483648",
        "-9223372036854775809",
    ),
    *(
        "١",
        "é",
        "\x0b",
        "\x1c",
        "\u2028",
        "\r",
        "\t",
        " ",
        "\n",
        "#",
        "\0",
        "\ufeff",
        "null",
        "true",
        "x",
        '"x"',
    ),
    *(
        "[]",
        "{}",
        "[",
        "}",
        "[0.1]",
        "[0.1, 0.2, 0.3]",
        '{"a": 1}',
        "!!int",
        "&a",
        "*a",
        "---",
        "<a/>",
        "&#0;",
    ),
    *("../x", "/etc/passwd", "%s", "2001-99-99", "\\ud800", "9" * 400, "9" * 5000, "x" * 140000, "[" * 300),
]
NUMBERS = [0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]


@dataclass(frozen=True)
class Reader:
    """A reader of bytes from outside.

    Attributes
    ----------
    name
        Unique.
    write
        Writes a valid file, and what belongs to it, into an empty folder; returns the one to damage.
    read
        Returns what is read, in a form that can be compared.
    sealed
        The file carries a hash: whatever is read must be the value of the valid file.
    text
        Tokens are damaged as well as bytes.
    change
        Called instead of all that, with a generator and the valid file's bytes.
    memory_mb
        By how much the process may grow.
    """

    name: str
    write: Callable[[Path], Path]
    read: Callable[[Path], Any]
    sealed: bool = False
    text: bool = False
    change: Callable[[random.Random, bytes], bytes] | None = None
    memory_mb: int = 400


@dataclass
class Tally:
    """The outcomes of the cases of one reader."""

    tried: int = 0
    same: int = 0
    other: int = 0  # read with another value, where that is allowed
    refused: Counter[str] = field(default_factory=Counter)
    tracebacks: list[str] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)
    grown_mb: int = 0

    def add(self, reader: Reader, path: Path, data: bytes, expected: Any) -> None:
        """Read a damaged file and count the outcome."""
        self.tried += 1
        path.write_bytes(data)
        try:
            found = within_cpu_time(lambda: reader.read(path))
        except StrandcastError as refusal:
            self.refused[refusal.code] += 1
            if problem := unclear(refusal):
                self.tracebacks.append(f"case {self.tried}: {problem}: {refusal.message()[:300]}")
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            said = f"{type(error).__name__}: {str(error)[:200]} ({Path(place.filename).name}:{place.lineno})"
            self.tracebacks.append(f"case {self.tried}: {said}")
        else:
            same = found == expected
            self.same += same
            self.other += not same
            if reader.sealed and not same:
                self.silent.append(f"case {self.tried}: read with another value")

    def line(self, name: str) -> str:
        """Return the counts as one line of a table."""
        refused = sum(self.refused.values())
        counts = (
            self.tried,
            refused,
            self.same,
            self.other,
            len(self.tracebacks),
            len(self.silent),
            self.grown_mb,
        )
        return f"{name:<30}" + "".join(f"{count:>10}" for count in counts)

    def faults(self, reader: Reader) -> list[str]:
        """Return what must not happen, each kind of traceback once."""
        memory = [f"took {self.grown_mb} MB"] if self.grown_mb > reader.memory_mb else []
        once = {said.split(": ", 1)[1]: said for said in self.tracebacks}
        return [*once.values(), *self.silent, *memory]


HEADS = f"{'reader':<30}" + "".join(
    f"{head:>10}" for head in ("tried", "refused", "same", "other", "traceback", "silent", "MB grown")
)


def fuzz(reader: Reader, cases: int, folder: Path) -> Tally:
    """Damage a reader's file so often, and return the outcomes; the same cases in every run."""
    path = reader.write(folder)
    valid, expected = path.read_bytes(), reader.read(path)
    tally, before_mb = Tally(), peak_mb()
    for case in range(cases):
        tally.add(reader, path, changed(reader, case, valid), expected)
    tally.grown_mb = peak_mb() - before_mb
    return tally


def unclear(refusal: StrandcastError) -> str:
    """Return what a refusal lacks; empty if it is one clear message."""
    problems = getattr(refusal, "problems", [refusal])
    if not all(re.fullmatch(r"SC-[A-Z]\d{3}", problem.code) and problem.what for problem in problems):
        return "a refusal without code or words"
    longest = max(len(problem.message()) for problem in problems)
    return "a message that is too long" if longest > LONGEST_MESSAGE or len(problems) > MOST_PROBLEMS else ""


def within_cpu_time(call: Callable[[], Any]) -> Any:
    """Return what a call returns, or raise a `TimeoutError` after CPU_S of this process's CPU time."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"no end after {CPU_S:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, CPU_S)
    try:
        return call()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def peak_mb() -> int:
    """Return the largest memory that this process has held [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // (1 << 20 if sys.platform == "darwin" else 1 << 10)


def changed(reader: Reader, case: int, valid: bytes) -> bytes:
    """Return the bytes of a case."""
    rng = random.Random(f"{reader.name} {case}")
    if reader.change is not None:
        return reader.change(rng, valid)
    data = valid
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change = changed_token if reader.text and rng.random() < 0.6 else changed_bytes
        data = change(rng, data)
    return data


def changed_bytes(rng: random.Random, data: bytes) -> bytes:
    """Return bytes after one change that disks, networks and careless programs make."""
    if not data:
        return rng.randbytes(8)
    at = rng.randrange(len(data))
    size = min(rng.choice((1, 2, 4, 8, 64, 512)), len(data) - at)
    own = data[at : at + size]
    number = struct.pack(rng.choice("<>") + "I", rng.choice(NUMBERS))
    piece: Any = {
        "flip": lambda: bytes([own[0] ^ 1 << rng.randrange(8)]) + own[1:],
        "number": lambda: number[: len(own)] + own[4:],
        "random": lambda: rng.randbytes(size),
        "zero": lambda: bytes(size),
        "delete": lambda: b"",
        "twice": lambda: own + own,
        "insert": lambda: rng.randbytes(rng.randrange(1, 9)) + own,
    }
    kind = rng.choice(("cut", "flip", "flip", *piece))
    return data[:at] if kind == "cut" else data[:at] + piece[kind]() + data[at + size :]


def changed_token(rng: random.Random, data: bytes) -> bytes:
    """Return text after one change of a word, a number, a sign or a line."""
    by_line = rng.random() < 0.2
    parts = data.splitlines(keepends=True) if by_line else TOKEN.findall(data)
    if not parts:
        return rng.choice(ODD).encode()
    at, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    kind = rng.choice(("odd", "odd", "odd", "insert", "delete", "twice", "swap", "other"))
    if kind == "swap":
        parts[at], parts[other] = parts[other], parts[at]
    else:
        odd = rng.choice(ODD).encode()
        parts[at : at + 1] = {
            "odd": [odd],
            "insert": [odd, parts[at]],
            "delete": [],
            "twice": [parts[at], parts[at]],
            "other": [parts[other]],
        }[kind]
    return b"".join(parts)
