"""Run tests as they would run on other processors, one variable at a time: `make test-widths`.

A variant that this processor or these libraries cannot run is named in the table, with the reason.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

# Those that simulate, fit, plan or track.
ROOMS = (
    *("alignment", "arm", "camera", "dynamics", "estimation", "lab", "planning", "reconstruction"),
    *("scoring", "stages", "studies", "tracking", "workflow/test_loop.py"),
)
# What a shell may choose of what is chosen here.
LIBRARIES = ("BLIS_", "GOTO_", "MKL_", "NPY_", "NUMBA_", "NVPL_", "OMP_", "OPENBLAS_")
OWN = ("STRANDCAST_REGISTER_BITS", "STRANDCAST_OPENBLAS_CORETYPE")
VARIANTS = (
    *("bits=0", "bits=128", "bits=256", "bits=512", "numba=generic"),
    *("blas=Nehalem", "blas=Haswell", "blas=Zen", "blas=SkylakeX", "numpy=v3", "numpy=baseline"),
)
# The kernels of OpenBLAS that are used, and those parts of numpy that are for this processor only.
PROBE = """
import json, numpy, scipy.linalg
from numpy._core import _multiarray_umath as core
from threadpoolctl import threadpool_info
numpy.linalg.svd(numpy.ones((64, 64)) @ numpy.ones((64, 64))), scipy.linalg.lu(numpy.ones((64, 64)))
kernels = {info["architecture"] for info in threadpool_info() if info["internal_api"] == "openblas"}
print(json.dumps([sorted(kernels), [name for name in core.__cpu_dispatch__ if core.__cpu_features__[name]]]))
"""


def environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Return this process's environment without what it chooses of the libraries, and with the variables."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith((*LIBRARIES, *OWN))}
    return kept | variables


def probed(variables: Mapping[str, str]) -> tuple[list[str], list[str]] | None:
    """Return what the libraries use with these variables; None if the processor cannot run that."""
    line = [sys.executable, "-c", PROBE]
    done = subprocess.run(line, env=environment(variables), stdout=subprocess.PIPE, check=False)
    return tuple(json.loads(done.stdout)) if done.returncode == 0 else None


def variables_of(variant: str) -> tuple[dict[str, str], str]:
    """Return the variables of a variant, and why it cannot run, if so."""
    kind, value = variant.split("=")
    if kind == "bits":
        return {OWN[0]: value}, ""
    if kind == "numba":
        return {"NUMBA_CPU_NAME": value}, ""
    if kind == "blas":
        variables = {"OPENBLAS_CORETYPE": value, OWN[1]: value}
        found = probed(variables)
        if found is None:
            return variables, "not for this processor"
        return variables, "" if found[0] == [value] else f"this OpenBLAS uses those of {' '.join(found[0])}"
    parts = (probed({}) or ([], []))[1]
    less = [part for part in parts if value != "v3" or part != "X86_V3"]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(less)}, "" if less else "numpy uses no more here"


def counts(arguments: list[str], variables: Mapping[str, str]) -> tuple[int, int, int]:
    """Run pytest; return how many tests passed, failed and were skipped. No test at all is a failure."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.xml")
        line = [sys.executable, "-m", "pytest", f"--junitxml={report}", *arguments]
        code = subprocess.run(line, env=environment(variables), check=False).returncode
        suites = list(ElementTree.parse(report).iter("testsuite")) if report.is_file() else []
    total, failed, skipped = (
        sum(int(suite.get(name, "0")) for suite in suites for name in names)
        for names in (["tests"], ["failures", "errors"], ["skipped"])
    )
    return total - failed - skipped, max(failed, int(code != 0)), skipped


def main(arguments: list[str]) -> int:
    """Run the variants and print the table; return 1 if a test failed in one of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help='variants, as "bits=0 blas=Haswell"')
    parser.add_argument("--tests", default=" ".join(f"tests/{room}" for room in ROOMS))
    chosen, others = parser.parse_known_args(arguments)
    wanted = chosen.only.split() or VARIANTS
    if unknown := set(wanted).difference(VARIANTS):
        parser.error(f"{', '.join(sorted(unknown))}: the variants are {', '.join(VARIANTS)}")
    rows, ok = [f"{'variant':16}{'passed':>8}{'failed':>8}{'skipped':>8}"], True
    for name in wanted:
        variables, wrong = variables_of(name)
        if wrong:
            rows.append(f"{name:16}not run: {wrong}")
            continue
        print(name, flush=True)
        found = counts([*chosen.tests.split(), *others], variables)
        ok &= found[1] == 0
        rows.append(f"{name:16}" + "".join(f"{count:8}" for count in found))
    print(*rows, sep="\n")
    return int(not ok)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
