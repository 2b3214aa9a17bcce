"""One run at a time on an experiment: a lease file that says which process holds it, and since when.

A lease is renewed while its owner lives. A dead owner on this host is recognised at once, by its process id
and start time; one on another host, by a lease that is not renewed for `LEASE_S`. No clocks are compared.
"""

import atexit
import json
import os
import shlex
import socket
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from filelock import SoftFileLease, Timeout

from strandcast.errors import StrandcastError
from strandcast.records.files import remove_temporary_files, write_text
from strandcast.records.folders import WITHIN_WORKFLOW, ExperimentFolder, parted, trial_folders
from strandcast.records.record import read_json

LEASE_S = 60.0  # chosen: three renewals; a busy file server may delay each by many seconds
UNNAMED_S = 3.0  # chosen: an owner writes its name within milliseconds; filelock waits 2 s for it


class Owner(NamedTuple):
    """The process that holds a lease."""

    pid: int
    host: str
    since: str
    command: str

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host} since {self.since}: {self.command}"


@contextmanager
def lease(root: Path, experiment: str) -> Iterator[None]:
    """Hold an experiment's lease within the block; within a workflow, which holds it already, do nothing."""
    if WITHIN_WORKFLOW in os.environ:
        yield
        return
    held = take(root, experiment)
    try:
        yield
    finally:
        _release(root, experiment, held)


def hold_until_exit(
    root: Path,
    experiments: Iterable[str],
    check: Callable[[Path, Iterable[str]], None] | None = None,
) -> None:
    """Take the leases of experiments, all or none, and release them when this process ends.

    `check` is called with the root and the experiments while the leases are held, and may refuse by an error.
    """
    names = sorted(set(experiments))
    with ExitStack() as held:
        for name in names:
            held.callback(_release, root, name, take(root, name))
        if check is not None:
            check(root, names)
        atexit.register(held.pop_all().close)


def take(root: Path, experiment: str) -> SoftFileLease:
    """Take an experiment's lease; one of a process that no longer lives is taken over.

    Raises
    ------
    StrandcastError
        SC-W010 another process holds it.
    """
    path = _lease_file(root, experiment)
    path.parent.mkdir(parents=True, exist_ok=True)
    held = SoftFileLease(path, lease_duration=LEASE_S, is_singleton=False, thread_local=False)
    try:
        held.acquire(timeout=0)
    except Timeout:
        _wait_for_owner(held, root, experiment)
    try:
        _write_owner(path)
        _sweep(ExperimentFolder(root, parted(experiment)[0]))
    except BaseException:
        _release(root, experiment, held)
        raise
    return held


def _write_owner(path: Path) -> None:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    owner = Owner(os.getpid(), socket.gethostname(), now, command)
    write_text(_owner_file(path), json.dumps(owner._asdict(), indent=1) + "\n")


def _wait_for_owner(held: SoftFileLease, root: Path, experiment: str) -> None:
    """Take over a lease that nobody renews or that has no living owner; refuse that of another run."""
    path, owner = _lease_file(root, experiment), owner_of(root, experiment)
    here = owner is not None and owner.host == socket.gethostname()
    patience_s = 0.0
    if owner is None or _is_empty(path) or (here and not _lives(owner.pid)):
        patience_s = UNNAMED_S
    elif not here:
        patience_s = LEASE_S * 1.5
        print(f"waiting {LEASE_S:.0f} s to see whether it still runs: {owner}", file=sys.stderr, flush=True)
    with suppress(Timeout):
        held.acquire(timeout=patience_s)
        return
    owner = owner_of(root, experiment)
    ended = here and owner is not None and _is_zombie(owner.pid)  # for filelock, such a process lives
    if patience_s and (ended or _is_empty(path)):
        path.unlink(missing_ok=True)
        with suppress(Timeout):
            held.acquire(timeout=0)
            return
    raise StrandcastError(
        "SC-W010",
        f"another run works on this experiment ({owner or 'it gives no name'})",
        file=_lease_file(root, experiment).parent,
        cost="two runs at once would overwrite each other's files",
    )


def refuse_if_held(root: Path, experiment: str) -> None:
    """Raise SC-W010 if another process holds an experiment's lease."""
    if _lease_file(root, experiment).exists():
        _release(root, experiment, take(root, experiment))


def unlock(root: Path, experiment: str) -> str:
    """Remove the lease of a run that has ended; return in words what was found.

    Raises
    ------
    StrandcastError
        SC-W010 its owner lives.
    """
    if not _lease_file(root, experiment).exists():
        return f"{experiment}: no run holds it"
    owner = owner_of(root, experiment)
    _release(root, experiment, take(root, experiment))
    return f"{experiment}: released; it was held by {owner or 'an unknown process'}"


def owner_of(root: Path, experiment: str) -> Owner | None:
    """Return who took an experiment's lease last, None if that is not known."""
    try:
        data = read_json(_owner_file(_lease_file(root, experiment)))
        return Owner(int(data["pid"]), str(data["host"]), str(data["since"]), str(data["command"]))
    except (StrandcastError, KeyError, TypeError, ValueError):
        return None


def living_owner(root: Path, experiment: str) -> Owner | None:
    """Return who holds an experiment's lease; a process of another host may have ended."""
    owner = owner_of(root, experiment) if _lease_file(root, experiment).exists() else None
    here = owner is not None and owner.host == socket.gethostname()
    return None if owner is None or (here and not _lives(owner.pid)) else owner


def _release(root: Path, experiment: str, held: SoftFileLease) -> None:
    with suppress(OSError):  # what is left is taken over; the error that ended the run must not be hidden
        if held.is_locked:
            _owner_file(_lease_file(root, experiment)).unlink(missing_ok=True)
            held.release()


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's
        pass
    return not _is_zombie(pid)


def _is_zombie(pid: int) -> bool:
    """Return whether a process has ended and its parent does not know yet; in a container, it may never."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state in ("Z", "X")


def _is_empty(path: Path) -> bool:
    try:
        return path.stat().st_size == 0
    except FileNotFoundError:  # released meanwhile
        return False


def _lease_file(root: Path, experiment: str) -> Path:
    return ExperimentFolder(root, parted(experiment)[0]).results / ".lease"


def _owner_file(path: Path) -> Path:
    return path.with_name(".lease-owner.json")


def _sweep(folder: ExperimentFolder) -> None:
    """Remove temporary files of killed stages: nobody else writes results now."""
    of_cameras = (*folder.results.glob("*/trial-*"), *folder.results.glob("*/cameras"))
    of_trials = trial_folders(folder.results).values()
    for found in (folder.results, *of_trials, *folder.results.glob("cameras"), *of_cameras):
        remove_temporary_files(found)
