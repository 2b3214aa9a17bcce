"""Long runs of the readers' damage, each reader in a process of its own: `make fuzz`.

The cases are those of `test_readers.py`, or with --guided those of atheris, which keeps the files that reach
new branches of the Python code. It is not guided by the libraries' machine code.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

CASES = 10_000
LONGEST_CASE_S, MOST_MB = 60, 3000  # for atheris
INSTRUMENTED = ["strandcast.records", "strandcast.video", "tifffile", "PIL"]  # numba cannot compile the rest


def main() -> int:
    """Run all readers, or the named ones; return 1 if any misbehaved."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.nightly")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--cases", type=int, default=CASES)
    parser.add_argument(
        "--guided", action="store_true", help="let atheris find the cases of the binary readers"
    )
    parser.add_argument("--one", action="store_true", help="run one reader in this process")
    options = parser.parse_args()
    if options.one:
        run = run_guided if options.guided else run_random
        return run(options.names[0], options.cases)
    from .fuzzing import HEADS
    from .readers import readers

    binary = [name for name, reader in readers().items() if not (reader.text or reader.change)]
    names = options.names or (binary if options.guided else list(readers()))
    print(HEADS, flush=True)
    codes = [run_apart(name, options.cases, options.guided) for name in names]
    print(f"{sum(map(bool, codes))} of {len(codes)} readers misbehaved")
    return int(any(codes))


def run_apart(name: str, cases: int, guided: bool) -> int:
    """Run one reader in a process of its own; its decoders' messages are kept only if it misbehaves."""
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "tests.faults.nightly",
        "--one",
        f"--cases={cases}",
        name,
    ]
    done = subprocess.run(command + ["--guided"] * guided, capture_output=True, text=True, errors="replace")
    print(done.stdout, end="", flush=True)
    if done.returncode:
        print(f"  {name}: exit code {done.returncode}\n{done.stderr[-3000:]}", flush=True)
    return done.returncode


def run_random(name: str, cases: int) -> int:
    """Run one reader on the seeded cases."""
    from .fuzzing import fuzz
    from .readers import readers

    reader = readers()[name]
    with tempfile.TemporaryDirectory() as folder:
        tally = fuzz(reader, cases, Path(folder))
    return report(name, tally.line(name), tally.faults(reader))


def report(name: str, line: str, faults: list[str]) -> int:
    print(line, *(f"  {fault}" for fault in faults), sep="\n", flush=True)
    return int(bool(faults))


def run_guided(name: str, cases: int) -> int:
    """Run one reader on the cases of atheris; does not return."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        from .fuzzing import Tally, peak_mb
        from .readers import readers

    reader, tally, folder = readers()[name], Tally(), Path(tempfile.mkdtemp())
    corpus = Path(tempfile.mkdtemp())
    path = reader.write(folder)
    valid, expected = path.read_bytes(), reader.read(path)
    (corpus / "valid").write_bytes(valid)
    before_mb = peak_mb()

    def one_case(data: bytes) -> None:
        tally.add(reader, path, data, expected)
        if tally.tried == cases:
            tally.grown_mb = peak_mb() - before_mb
            os._exit(report(name, tally.line(name), tally.faults(reader)))

    limits = [
        f"-timeout={LONGEST_CASE_S}",
        f"-rss_limit_mb={MOST_MB}",
        f"-max_len={2 * len(valid)}",
        "-len_control=0",
    ]
    atheris.Setup([sys.argv[0], *limits, "-seed=1", f"-artifact_prefix={corpus}/", str(corpus)], one_case)
    atheris.Fuzz()
    return 1


if __name__ == "__main__":
    sys.exit(main())
