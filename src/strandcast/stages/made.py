"""What results were made from, noted beside them, and whether it is still what is there.

A stage leaves a note, results/<experiment>/[trial-NN/]made/<stage>.json: the hashes of what it read and
wrote, its settings and the version of its code. A result is as fresh as its note says, whatever the time of
any file, and wherever the project was copied to.
"""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from strandcast.core.trial_names import in_trial_order
from strandcast.records.files import canonical_json, write_text
from strandcast.records.known_hashes import content_sha256_of
from strandcast.records.lineage import changed_inputs, relative_to
from strandcast.stages.code_version import code_version, settings
from strandcast.stages.job import Files

MOST_CHANGES = 3  # that are named; chosen
UNKNOWN = "there is no note of what it was made from"


def made_from(files: Files) -> dict[str, Any]:
    """Return what a job is made from now: the hashes of its inputs, its settings, the version of its code."""
    return _facts(files) | {"inputs": _hashes(files, files.all_inputs())}


def write_note(files: Files, at_start: dict[str, Any]) -> None:
    """Write the note of a job that is done: `made_from` at its start, and hashes of what it has written."""
    note = at_start | {"outputs": _hashes(files, files.all_outputs())}
    write_text(_place(files), canonical_json(note) + "\n")


def changes_since_made(files: Files, inputs: Iterable[str] | None = None) -> list[str]:
    """Return in words what has changed since a job's results were made; nothing if they are fresh.

    What is missing is no change. Raw files that a stage wrote may be replaced: they are inputs of others.
    The job's inputs, relative to the project, are listed here unless they are given.

    Raises
    ------
    StrandcastError
        The inputs cannot be listed.
    """
    note = _read(_place(files))
    if note is None:
        return [UNKNOWN]
    root = files.job.context.folder.root
    inputs = set(inputs or (relative_to(root, path) for path in files.all_inputs()))
    added = in_trial_order(name for name in inputs - note["inputs"].keys() if (root / name).is_file())
    gone = in_trial_order(note["inputs"].keys() - inputs)
    results = {name: sha256 for name, sha256 in note["outputs"].items() if name.startswith("results/")}
    return [
        *(f"{name} changed" for name in _changed(root, note, inputs)[:MOST_CHANGES]),
        *_changed_facts(note, _facts(files)),
        *(f"{name} is a new input" for name in added[:MOST_CHANGES]),
        *(f"{name} is no longer an input" for name in gone[:MOST_CHANGES]),
        *(f"{name} is not the one that was made" for name in changed_inputs(root, results)[:MOST_CHANGES]),
    ]


def changed_files(files: Files) -> list[str]:
    """Return the inputs of a job that are not those that its results were made from."""
    note, root = _read(_place(files)), files.job.context.folder.root
    inputs = {relative_to(root, path) for path in files.all_inputs()}
    return [] if note is None else _changed(root, note, inputs)


def _changed(root: Path, note: dict[str, Any], inputs: set[str]) -> list[str]:
    return changed_inputs(root, {name: note["inputs"][name] for name in inputs & note["inputs"].keys()})


def _place(files: Files) -> Path:
    job = files.job
    folder = job.folder if job.trial else job.context.folder
    return folder.results / "made" / f"{files.stage.name}.json"


def _facts(files: Files) -> dict[str, Any]:
    """Return what a job depends on besides its files."""
    stage, job = files.stage.name, files.job
    return {
        "code": code_version(stage),
        "settings": json.loads(settings(job, stage)),
        "trials": list(job.trials),
    }


def _read(path: Path) -> dict[str, Any] | None:
    try:
        note = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    kinds = {"code": str, "settings": dict, "trials": list, "inputs": dict, "outputs": dict}
    sound = isinstance(note, dict) and all(isinstance(note.get(name), kind) for name, kind in kinds.items())
    return note if sound else None


def _hashes(files: Files, paths: Iterable[Path]) -> dict[str, str]:
    root = files.job.context.folder.root
    return {relative_to(root, path): content_sha256_of(path) for path in paths if path.is_file()}


def _changed_facts(before: dict[str, Any], now: dict[str, Any]) -> Iterator[str]:
    changed = list(_changed_settings(before["settings"], now["settings"]))
    yield from changed[:MOST_CHANGES]
    if len(changed) > MOST_CHANGES:
        yield f"{len(changed) - MOST_CHANGES} other settings changed"
    if before["trials"] != now["trials"]:
        yield f"there are other trials: {', '.join(map(str, now['trials'])) or 'none'}"
    if before["code"] != now["code"]:
        yield "the code of this stage changed"


def _changed_settings(old: Any, new: Any, place: str = "") -> Iterator[str]:
    """Yield the settings that differ, with the old and the new value."""
    if isinstance(old, dict) and isinstance(new, dict) and (old or new):
        for key in sorted({*old, *new}):
            yield from _changed_settings(old.get(key), new.get(key), f"{place}.{key}".lstrip("."))
    elif old != new:
        yield f"{place}: {_short(old)} → {_short(new)}"


def _short(value: Any) -> str:
    text = "none" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:37]}…"
