"""Faults planted in a copy of the simulator, to see which proof catches which.

``python tests/dynamics/planted_faults.py`` plants them all, one at a time, and prints the table; with names
of faults, only these. Each copy of the package is compiled again, which takes most of the time.
"""

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from proofs import PROOFS

import strandcast

PACKAGE = Path(strandcast.__file__).parent
HERE = Path(__file__).parent
VARIANT = "lfcn"
NO_LONGER_THAN_S = 600


@dataclass(frozen=True)
class Fault:
    """A fault by name: in a file of `strandcast.dynamics`, every `right` becomes `wrong`."""

    name: str
    file: str
    right: str
    wrong: str


NONE = Fault("unbroken", "__init__.py", "", "")
FAULTS = tuple(
    Fault(name, **edit) for name, edit in tomllib.loads((HERE / "faults.toml").read_text()).items()
)


def faulty(fault: Fault) -> str:
    """Return the text of the fault's file with the fault in it."""
    text = (PACKAGE / "dynamics" / fault.file).read_text()
    if fault.right not in text:
        raise LookupError(f"{fault.name}: {fault.file} no longer contains {fault.right!r}")
    return text.replace(fault.right, fault.wrong)


def planted(fault: Fault, folder: Path) -> Path:
    """Copy the package to `folder` with the fault in it; the folder to put on the path."""
    copy = folder / "strandcast"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "dynamics" / fault.file).write_text(faulty(fault))
    return folder


def errors_with(fault: Fault, names: Iterable[str], variant: str = VARIANT) -> dict[str, float]:
    """Errors of the named proofs on a copy of the simulator with the fault in it, in another process."""
    with tempfile.TemporaryDirectory(prefix="strandcast-fault-") as name:
        folder = planted(fault, Path(name))
        environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "kernels")}
        done = subprocess.run(
            [sys.executable, str(HERE / "proofs.py"), variant, *names],
            env=environment,
            capture_output=True,
            text=True,
            timeout=NO_LONGER_THAN_S,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{fault.name}: the proofs stopped\n{done.stderr[-2000:]}")
        answer = json.loads(done.stdout)
        assert Path(answer["package"]).is_relative_to(folder.resolve()), answer["package"]
        return answer["errors"]


def catches(name: str, error: float, variant: str = VARIANT) -> bool:
    return not PROOFS[name].holds(variant, error)


def row(fault: Fault, names: list[str]) -> str:
    """One line of the table: each error in tolerances, in bold where it is caught."""
    found = errors_with(fault, names)
    cells = []
    for name in names:
        ratio = found[name] / PROOFS[name].tolerance[VARIANT]
        shown = "diverged" if math.isnan(ratio) else f"{ratio:.2g}"
        cells.append(f"**{shown}**" if catches(name, found[name]) else shown)
    caught = sum(catches(name, found[name]) for name in names)
    return f"| {fault.name} | {' | '.join(cells)} | {caught} |"


def main(wanted: list[str]) -> None:
    names = [name for name, proof in PROOFS.items() if VARIANT in proof.tolerance]
    print(f"| fault | {' | '.join(names)} | caught by |\n|{'---|' * (len(names) + 2)}", flush=True)
    for each in (NONE, *FAULTS):
        if not wanted or each.name in wanted:
            print(row(each, names), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
