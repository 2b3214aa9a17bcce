"""Whether this computer can run strandcast: what it offers, a fix for each problem, and room for a run."""

import ctypes
import importlib
import importlib.metadata
import os
import platform
import re
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Literal, NamedTuple

from strandcast.kernel_cache import PACKAGE
from strandcast.packages import (
    OPENCV,
    fault_of,
    install,
    installed_version,
    is_own_opencv,
    other_opencvs,
    reinstall,
    requirement_name,
)
from strandcast.records.files import check_room, existing_folder, free_bytes, in_bytes
from strandcast.records.folders import ExperimentFolder, is_project

PYTHONS = ((3, 11), (3, 14))  # the first that works, and the first that is not tested
NEED_BYTES = 1 << 30  # memory of the largest stage
ROOMY_BYTES = 3 << 30  # memory of the largest stage and the others that run beside it
SCRATCH_BYTES = 400_000_000  # the frames of a trial of the demo, while it is tracked: 300 MB
LEAST_FREE_BYTES = 150_000_000  # a trial of the demo: a film of 45 MB, twice while it is written, and results
TIME_ERROR = 5  # of adjtimex: no time server sets this clock
TIMEX_BYTES = 512  # more than any struct timex
DRIVERS = {
    "ur": ("ur_rtde", "rtde_control"),
    "franka": ("pylibfranka", "pylibfranka"),
    "xarm": ("xarm-python-sdk", "xarm"),
}

State = Literal["ok", "note", "problem"]


class Diagnosis(NamedTuple):
    """One thing that was examined."""

    name: str
    state: State
    found: str
    fix: str | None = None


def check_host(root: Path, experiments: Iterable[str]) -> None:
    """Refuse to start a workflow that this computer could not finish.

    Raises
    ------
    StrandcastError
        SC-R041 the disk is full; SC-W002 results cannot be written.
    """
    results = (ExperimentFolder(root, name).results for name in experiments)
    for place in (root / ".snakemake", *results):
        check_room(place, LEAST_FREE_BYTES)


def diagnose(root: Path) -> list[Diagnosis]:
    """Examine the environment; a check that fails in an unexpected way is a problem itself."""
    found: list[Diagnosis] = []
    for check in CHECKS:
        name = check.__name__.strip("_").replace("_", " ")
        try:
            found += check(root)
        except Exception as error:
            fix = "report it, with the output of strandcast doctor --json"
            found.append(Diagnosis(name, "problem", f"could not be examined: {error}", fix))
    return found


def _diagnosis(name: str, state: State, found: str, fix: str | None) -> Diagnosis:
    """Return what was found, with the fix if it is not fine."""
    return Diagnosis(name, state, found, None if state == "ok" else fix)


def _python(root: Path) -> Iterator[Diagnosis]:
    here = f"{platform.python_version()} at {sys.executable}, {platform.platform()}"
    state: State = "ok" if PYTHONS[0] <= sys.version_info[:2] < PYTHONS[1] else "problem"
    yield _diagnosis("python", state, here, "install strandcast with Python 3.11, 3.12 or 3.13")


def _packages(root: Path) -> Iterator[Diagnosis]:
    required = {requirement_name(each): each for each in _requirements()}
    versions = {name: installed_version(name) for name in required}
    missing = [name for name, version in versions.items() if version is None]
    if missing:
        fix = install([required[name] for name in missing])
        yield Diagnosis("packages", "problem", f"missing: {', '.join(missing)}", fix)
    faults = {name: fault_of(name) for name in required if name not in missing}
    broken = {name: fault for name, fault in faults.items() if fault is not None}
    for name, fault in broken.items():
        what = f"{name} {versions[name]} does not work: {fault.why}"
        yield Diagnosis("packages", "problem", what, fault.fix)
    pinned: dict[str, set[str]] = {}  # a package may have several versions, for several Pythons
    for name, version in re.findall(r"^([\w.-]+)==([^\s;\\]+)", _lock(), re.MULTILINE):
        pinned.setdefault(name, set()).add(version)
    other = [
        f"{name} {has}, not {' or '.join(sorted(pinned[name]))}"
        for name, has in versions.items()
        if name in pinned and has not in pinned[name]
    ]
    if other:
        fix = "results differ in their last digits; make demo installs the pinned versions"
        yield Diagnosis("packages", "note", f"not as pinned: {', '.join(other)}", fix)
    if not missing and not broken:
        what = "no list of pinned versions here" if not pinned else "as pinned" if not other else "see above"
        work = ", ".join(f"{name} {version}" for name, version in versions.items())
        yield Diagnosis("packages", "ok", f"{len(versions)} required packages work, {what}: {work}")


def _opencv(root: Path) -> Iterator[Diagnosis]:
    others = " and ".join(f"{name} {installed_version(name)}" for name in other_opencvs())
    if others and installed_version(OPENCV) is not None and fault_of(OPENCV) is None:
        last = OPENCV if is_own_opencv() else "another of them"
        what = f"{others}: installed beside {OPENCV}, in one folder, cv2; {last} was installed last"
        fix = f"remove one, and the other no longer works; leave one: {reinstall(OPENCV)}"
        yield Diagnosis("packages, OpenCV", "note", what, fix)


def _requirements() -> list[str]:
    try:
        return [each for each in importlib.metadata.requires("strandcast") or [] if "extra ==" not in each]
    except importlib.metadata.PackageNotFoundError:  # from the sources, not installed
        return []


def _lock() -> str:
    """Return the list of pinned versions, which a clone holds."""
    path = PACKAGE.parents[1] / "requirements" / "runtime.lock"
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _codecs(root: Path) -> Iterator[Diagnosis]:
    from strandcast.video.self_test import CLIPS, decode_problem

    for codec in CLIPS:
        problem, fix = decode_problem(codec), "install PyAV again: pip install --force av"
        state: State = "ok" if problem is None else "problem"
        yield _diagnosis(f"codec {codec}", state, problem or "a clip was decoded", fix)


def _cores(root: Path) -> Iterator[Diagnosis]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    words = f"{cores} for this process, of {os.cpu_count()}"
    few = "runs take about twice as long; allow two cores, and use --cores 1 if there is one"
    yield _diagnosis("cores", "ok" if cores > 1 else "note", words, few)


def _memory(root: Path) -> Iterator[Diagnosis]:
    free = _free_memory()
    if free is None:
        yield Diagnosis("memory", "note", "not known on this system")
        return
    fix = "end other programs, allow more (`ulimit -v`, the container's limit), or use --jobs 1"
    state: State = "problem" if free < NEED_BYTES else "note" if free < ROOMY_BYTES else "ok"
    yield _diagnosis("memory", state, f"{in_bytes(free)} free for this process", fix)


def _free_memory() -> int | None:
    """Return the memory [bytes] that this process may still take."""
    limits = []
    meminfo = Path("/proc/meminfo")
    if meminfo.is_file():
        found = re.search(r"^MemAvailable:\s+(\d+) kB", meminfo.read_text(), re.MULTILINE)
        limits += [int(found[1]) * 1024] if found else []
    group, used = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))
    if group.is_file() and used.is_file() and group.read_text().strip().isdigit():
        limits.append(int(group.read_text()) - int(used.read_text()))
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    limits += [] if allowed == resource.RLIM_INFINITY else [allowed]
    return min(limits, default=None)


def _disk(root: Path) -> Iterator[Diagnosis]:
    places = {
        "results": (root / "results", LEAST_FREE_BYTES),
        "temporary files": (Path(tempfile.gettempdir()), SCRATCH_BYTES),
    }
    for name, (place, least) in places.items():
        free, folder = free_bytes(place), existing_folder(place)
        state: State = "problem" if free < least else "ok"
        found = f"{in_bytes(free)} free at {folder}"
        fix = f"free {in_bytes(least)} or more; one trial's video and results need that"
        if not os.access(folder, os.W_OK):
            state, found, fix = "problem", f"{folder} cannot be written", "change its permissions"
        yield _diagnosis(f"disk, {name}", state, found, fix)


def _shared_memory(root: Path) -> Iterator[Diagnosis]:
    """Make a lock of several processes; only pages that are rendered again side by side need one."""
    try:
        get_context("fork").Lock()  # of the ways to start processes, the one that leaves nothing behind
    except OSError as error:
        fix = "run --report-only uses one core; to use several, mount /dev/shm writable (docker: --shm-size)"
        yield Diagnosis("shared memory", "note", f"closed: /dev/shm: {error.strerror}", fix)
    else:
        yield Diagnosis("shared memory", "ok", "processes can share locks")


def _clock(root: Path) -> Iterator[Diagnosis]:
    step_s = time.get_clock_info("monotonic").resolution
    fix = "joint logs need a clock with steps below 1 µs: use a real computer, not this virtual one"
    state: State = "note" if step_s > 1e-6 else "ok"
    yield _diagnosis("clock", state, f"monotonic, in steps of {step_s * 1e9:g} ns", fix)
    set_by_server = _is_synchronised()
    if set_by_server is None:
        yield Diagnosis("clock, date", "note", "whether a time server sets it is not known")
        return
    fix = "turn on NTP (`timedatectl set-ntp true`), so that files of several computers keep their order"
    found = "set by a time server" if set_by_server else "no time server sets it"
    yield _diagnosis("clock, date", "ok" if set_by_server else "note", found, fix)


def _is_synchronised() -> bool | None:
    """Return whether the kernel's clock is disciplined; None where that cannot be asked."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR


def _kernels(root: Path) -> Iterator[Diagnosis]:
    folder = Path(os.environ.get("NUMBA_CACHE_DIR", ""))
    wrong = "NUMBA_CACHE_DIR" not in os.environ or (folder.exists() and not folder.is_dir())
    if wrong or not os.access(existing_folder(folder), os.W_OK):
        fix = "set TMPDIR or NUMBA_CACHE_DIR to a folder that can be written"
        yield Diagnosis("kernels", "problem", f"compiled code cannot be kept at {folder}", fix)
        return
    kept = (path for path in PACKAGE.rglob("*.py") if b"cache=True" in path.read_bytes())
    modules = {path.with_suffix("").relative_to(PACKAGE) for path in kept}
    indices = list(folder.rglob("*.nbi"))  # one per kernel
    compiled = {path.relative_to(folder).parent / path.name.partition(".")[0] for path in indices}
    left = len(modules - compiled)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    place = f"{len(indices)} compiled, {in_bytes(size)} at {folder}"
    more = f"; {left} of {len(modules)} modules have none yet, and are compiled when first used, once"
    yield Diagnosis("kernels", "note" if left else "ok", f"{place}{more if left else ''}")


def _drivers(root: Path) -> Iterator[Diagnosis]:
    for extra, (package, module) in DRIVERS.items():
        version = installed_version(package)
        if version is None:
            fix = f"to move such an arm: pip install 'strandcast[{extra}]'"
            yield Diagnosis(f"driver {extra}", "note", f"{package} is not installed", fix)
            continue
        try:
            importlib.import_module(module)
        except Exception as error:
            fix = f"install it again for this Python: pip install --force-reinstall {package}"
            yield Diagnosis(f"driver {extra}", "problem", f"{package} {version}: {error}", fix)
        else:
            yield Diagnosis(f"driver {extra}", "ok", f"{package} {version}")


def _real_time(root: Path) -> Iterator[Diagnosis]:
    if not hasattr(os, "sched_setscheduler"):
        yield Diagnosis("real time", "note", "this system has no real-time scheduling: play from Linux")
        return
    kernel = "a PREEMPT_RT kernel" if "PREEMPT_RT" in platform.version() else "no PREEMPT_RT kernel"
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, parameter)
    except OSError:
        fix = (
            "to move a Franka arm: allow rtprio in /etc/security/limits.conf (see docs/reference/executor.md)"
        )
        yield Diagnosis("real time", "note", f"not permitted; {kernel}", fix)
    else:
        yield Diagnosis("real time", "ok", f"permitted; {kernel}")


def _project(root: Path) -> Iterator[Diagnosis]:
    found = str(root.resolve()) if is_project(root) else "this folder is in no project"
    fix = "change to a project's folder, or make one: strandcast new mylab"
    yield _diagnosis("project", "ok" if is_project(root) else "note", found, fix)


CHECKS: tuple[Callable[[Path], Iterator[Diagnosis]], ...] = (
    _python,
    _packages,
    _opencv,
    _codecs,
    _cores,
    _memory,
    _disk,
    _shared_memory,
    _clock,
    _kernels,
    _drivers,
    _real_time,
    _project,
)
