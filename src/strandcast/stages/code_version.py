"""Settings and code on which a stage depends, besides its files.

Snakemake notices neither an edit in `src/` nor a changed setting, but it compares `params`, which hold both.
"""

import functools
import hashlib
from typing import Any

from strandcast.config.experiment import Experiment
from strandcast.records.files import canonical_json
from strandcast.source_code import code_of, file_of, save_codes
from strandcast.stages.declarations import STAGES
from strandcast.stages.files import played_motions, this
from strandcast.stages.job import Job

PACKAGES = ("strandcast.", "strandcast_studies.")


def settings(job: Job, stage: str) -> str:
    """Return the settings that a stage reads, as one line of JSON."""
    declared = STAGES[stage]
    known = declared.without_motion and played_motions(this)(job)
    paths = declared.settings if known else declared.settings + declared.without_motion
    return settings_at(job.context.settings, *paths)


def settings_at(experiment: Experiment, *paths: str) -> str:
    """Return the settings at some paths, e.g. ``estimate.dt_s``, as one line of JSON."""
    values = experiment.model_dump(mode="json")
    return canonical_json({path: _at(values, path.split(".")) for path in paths})


def _at(values: Any, parts: list[str]) -> Any:
    """Return the value at a path; `*` stands for every key, as of the cameras, and `#` for their order."""
    if parts == ["#"]:
        return list(values)
    if not parts or values is None:  # a real experiment has no lab
        return values
    if parts[0] == "*":
        return {name: _at(value, parts[1:]) for name, value in values.items()}
    return _at(values[parts[0]], parts[1:])


@functools.cache
def code_version(stage: str) -> str:
    """Return a hash over a stage's module and all modules of strandcast that it imports.

    Comments, docstrings, descriptions of settings and layout do not count: the hash is over the syntax trees
    without docstrings and descriptions.
    """
    digest = hashlib.sha256()
    start = stage if "." in stage else f"strandcast.stages.{stage}"
    for module in sorted(_closure(start)):
        digest.update(module.encode() + b"\0" + _meaning(module))
    save_codes()
    return digest.hexdigest()[:16]


def _closure(module: str) -> set[str]:
    """Return a module and all modules of strandcast that it imports, directly or not."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting.extend(_imports(name))
    return found


@functools.cache
def _imports(module: str) -> tuple[str, ...]:
    """Return the modules of strandcast that a module imports anywhere, also within functions."""
    path = file_of(module)
    names = code_of(path).imports if path else ()
    return tuple(name for name in names if name.startswith(PACKAGES) and file_of(name))


@functools.cache
def _meaning(module: str) -> bytes:
    """Return the hash of a module's code and, for a package, the templates of pages in its folder."""
    path = file_of(module)
    if path is None:
        return b""
    templates = sorted(path.parent.rglob("*.jinja")) if path.name == "__init__.py" else []
    return code_of(path).sha256.encode() + b"".join(file.read_bytes() for file in templates)
